"""Whether flow says anything about a motion, and whether it says it of one motion alone."""

from __future__ import annotations

import numpy as np

from flowlik.egomotion.epipolar import Epipolar
from flowlik.egomotion.known_depth import KnownDepth
from flowlik.egomotion.problem import Problem, View
from flowlik.egomotion.result import Status
from flowlik.support.arrays import Array

# an information's smallest and largest eigenvalue, scaled, whose ratio is above this
LEAST_RECIPROCAL_CONDITION = 1e-9
# without depth: flow shorter than this [px] in half of the vectors is none
STILL_PX = 0.1
# share of the inliers' share that a rotation alone may explain
NO_PARALLAX_SHARE = 0.95


def determines(information: Array, basis: Array) -> bool:
    """Whether an information (6, 6) determines every observable direction (6, D)."""
    A = basis.T @ information @ basis
    scale = np.sqrt(np.diag(A))
    if not (scale > 0).all():
        return False
    eigenvalues = np.linalg.eigvalsh(A / np.outer(scale, scale))
    return bool(eigenvalues[0] > LEAST_RECIPROCAL_CONDITION * eigenvalues[-1])


def too_little(problem: Problem) -> tuple[Status, str] | None:
    """Why there is nothing to estimate from; None if there is."""
    n, needed = int(problem.kept.any(axis=1).sum()), problem.residual.sampling.minimal
    if n < needed:
        return Status.TOO_FEW, f"{n} flow vectors, {needed} needed"
    # with known depth a standstill is a motion like any other
    flow = problem.residual.measurements.flow
    if not problem.residual.metric and np.median(np.linalg.norm(flow, axis=1)) < STILL_PX:
        return Status.STILL, "the flow is zero"
    return None


def judged(problem: Problem, view: View, information: Array, ambiguous: bool) -> tuple[Status, str]:
    """Status of a motion that was found, and why it is not solved."""
    if rotation_share(problem, view.errors.T) > NO_PARALLAX_SHARE * view.inliers.sum() / view.used.sum():
        return Status.DEGENERATE, "a rotation alone explains the flow: no parallax, no direction"
    if not determines(information, view.errors.basis):
        return Status.DEGENERATE, "the measurements do not determine every direction of the motion"
    if ambiguous:
        return Status.AMBIGUOUS, "two motions have nearly as many points in front of the camera"
    return Status.SOLVED, ""


def rotation_share(problem: Problem, T: Array) -> float:
    """Share of eigen-components that points at infinity would explain: near 1 there is no parallax.

    0 with known depth, where a rotation is a motion like any other.
    """
    if not isinstance(problem.residual, Epipolar):
        return 0.0
    m = problem.residual.measurements
    errors = KnownDepth(m, problem.residual.camera, np.zeros(len(m))).at(T, problem.index)
    return float(np.mean(np.abs(errors.z) <= problem.bound(errors.x)))
