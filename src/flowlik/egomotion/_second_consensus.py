"""A second motion among what the first leaves over: a vehicle that fills the image, tracks along a rail."""

from __future__ import annotations

import numpy as np

from flowlik.egomotion.consensus import consensus
from flowlik.egomotion.maximise import refine
from flowlik.egomotion.problem import Explanation, Problem, View
from flowlik.egomotion.residual import KNOWN_PX

# vectors known well that a motion leaves over: where they are so large a share of all, they are asked
LEFT_OVER_SHARE = 0.25
# and so large a share of theirs must agree
AGREE_SHARE = 0.6


def second_consensus(
    problem: Problem, view: View, rng: np.random.Generator, most_drawn: int, success: float
) -> Explanation | None:
    """Return the motion on which most of what another leaves over agrees; None if there is none.

    Errors do not agree on a motion. Where a fourth of all vectors does, nothing in one image pair tells
    which motion is the camera's, not even that it has more of them.
    """
    shape = problem.vectors, -1
    known = ((view.bounds <= KNOWN_PX) & view.used).reshape(shape).all(axis=1)
    over = np.asarray(known & ~view.inliers.reshape(shape).any(axis=1))
    if over.sum() < max(LEFT_OVER_SHARE * known.sum(), 4 * problem.residual.sampling.minimal):
        return None
    rest = problem.among(over)
    found = consensus(rest, None, rng, most_drawn, success)
    if found.T is None or rest.at(found.T, rest.components).inliers.mean() < AGREE_SHARE:
        return None
    errors, log_prob = refine(problem, refine(rest, found.T)[0].T)
    second = problem.look(errors, view.used)
    agree = np.asarray(second.inliers.reshape(shape).any(axis=1))[over].mean()
    return Explanation(second, log_prob) if agree >= AGREE_SHARE else None
