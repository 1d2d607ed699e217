"""Flow of points at infinity: a rotation alone, which needs no depth."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from flowlik.egomotion.consensus import ANNEALING, anneal
from flowlik.egomotion.epipolar import Epipolar
from flowlik.egomotion.known_depth import KnownDepth
from flowlik.egomotion.maximise import refine
from flowlik.egomotion.problem import Explanation, Problem, View
from flowlik.egomotion.residual import Chosen, Equations, Linearised
from flowlik.likelihood.schedule import Index
from flowlik.support.arrays import Array

ROTATION = np.eye(6)[:, :3]
ROTATION.setflags(write=False)
# parallax of so many bounds is not seen, and turns the rotation that explains the flow alone
HIDDEN_BOUNDS = 0.5


class AtInfinity(KnownDepth):
    """Flow of points at infinity, two eigen-components a vector: it observes the rotation alone."""

    def at(self, T: Array, index: Index) -> Linearised:
        """Errors z (2N,) [px] of eigen-components at a rotation."""
        return super().at(T, index)._replace(basis=ROTATION)

    def equations(self, T: Array, chosen: Chosen, widened: float = 1.0) -> Equations:
        """Normal equations of the chosen components."""
        return super().equations(T, chosen, widened)._replace(basis=ROTATION)


def at_infinity(problem: Problem) -> Problem:
    """Return the problem without depth as if its points were all at infinity."""
    residual = problem.residual
    assert isinstance(residual, Epipolar)
    m = residual.measurements
    return replace(problem, residual=AtInfinity(m, residual.camera, np.zeros(len(m)), residual.excluded))


def rough_rotation(problem: Problem, T: Array) -> Array:
    """Follow the likelihood from the rotation of a motion (3, 4), errors taken to be wide: cheap.

    `problem` is one at infinity. A translation and a rotation share much of a flow: the rotation of the two
    together is not the one that explains the flow alone.
    """
    return anneal(problem, np.column_stack([T[:, :3], np.zeros(3)]), ANNEALING[:1])


def nearest_rotation(problem: Problem, rough: Array) -> Explanation:
    """Follow the likelihood on from a rough rotation (3, 4)."""
    errors, log_prob = refine(problem, anneal(problem, rough, ANNEALING[1:]))
    return Explanation(problem.look(errors), log_prob)


def hidden_parallax_px(problem: Problem, view: View) -> float:
    """Parallax [px] that hides in errors: a share of the median bound of what is known well."""
    bounds = view.bounds[view.used]
    return HIDDEN_BOUNDS * float(np.median(np.minimum(bounds, problem.widest_px)))
