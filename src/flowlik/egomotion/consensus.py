"""Sampling consensus: the motion that most components support (paper, Sec. II-G)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform

from flowlik.egomotion.maximise import maximise
from flowlik.egomotion.problem import Problem
from flowlik.support.arrays import Array

# samples drawn at first, to check a start by, and at a time from then on
FIRST_BATCH, BATCH = 12, 50
# steps of a local optimisation
LOCAL_STEPS = 3
# how many times as wide as the likelihood says errors are taken to be, on the way from a start to the motion
ANNEALING = (8.0, 4.0, 2.0, 1.0)


class Found(NamedTuple):
    """Motion (3, 4) of most support, None without any; samples drawn."""

    T: Array | None
    drawn: int


def consensus(
    problem: Problem, start: RigidTransform | None, rng: np.random.Generator, most_drawn: int, success: float
) -> Found:
    """Sample, propose and count support until a good sample has almost surely been drawn.

    A start is the first hypothesis: where it explains the data, few samples remain to check it by.
    """
    sampling = problem.residual.sampling
    bounds, weights = _support_bounds(problem), _sampling_weights(problem)

    def inliers_of(T: Array) -> NDArray[np.bool_]:
        return problem.at(T).inliers

    def draws(inliers: NDArray[np.bool_]) -> int:
        return _draws(problem, weights, inliers, most_drawn, success)

    best, most, drawn, needed = None, 0, 0, most_drawn
    begin = np.eye(4)[:3] if start is None else start.as_matrix()[:3]
    if start is not None:
        best = sampling.resolve(anneal(problem, begin), inliers_of)
        inliers = inliers_of(best)
        most, needed = problem.count(inliers), draws(inliers)
    while drawn < needed:
        batch = BATCH if drawn else FIRST_BATCH
        samples = draw_samples(weights, min(batch, needed - drawn), sampling.minimal, rng)
        drawn += len(samples)
        hypotheses = sampling.propose(samples, begin)
        if not len(hypotheses):
            continue
        support = sampling.support(hypotheses, bounds, problem.rule.unit == "vector")
        if support.max() > most:
            most = int(support.max())
            best = sampling.resolve(hypotheses[support.argmax()], inliers_of)
            # local optimisation: a minimal sample carries its own noise
            view = problem.at(best)
            better, _ = maximise(problem, view.errors, view.inliers, LOCAL_STEPS)
            inliers, chosen = view.inliers, inliers_of(better)
            if (count := problem.count(chosen)) >= most:
                best, most, inliers = better, count, chosen
            needed = draws(inliers)
    return Found(best, drawn)


def draw_samples(weights: Array, count: int, size: int, rng: np.random.Generator) -> NDArray[np.intp]:
    """Samples (K, size) of distinct vectors, K <= count: those that repeat a vector are dropped."""
    cumulated = np.cumsum(weights)
    drawn = np.searchsorted(cumulated, rng.random((count, size)) * cumulated[-1], side="right")
    drawn = np.sort(np.minimum(drawn, len(weights) - 1), axis=1)
    distinct = drawn[(np.diff(drawn, axis=1) > 0).all(axis=1)]
    # a handful of vectors rarely gives a distinct draw
    return distinct if len(distinct) else rng.permutation(len(weights))[None, :size]


def anneal(problem: Problem, T: Array, widths: Sequence[float] = ANNEALING) -> Array:
    """Follow the likelihood from a guess, its errors first taken to be several times as wide."""
    T = problem.residual.retract(T, np.zeros(6))
    for widened in widths:
        view = problem.at(T, problem.components, widened)
        T, _ = maximise(problem, view.errors, view.inliers, LOCAL_STEPS, widened)
    return T


def _support_bounds(problem: Problem) -> Array:
    """Bounds (C, A) [px] by which support is counted; -1 where a component does not count."""
    bounds = problem.residual.sampling.bounds(problem.bound, problem.index)
    bounds = np.where(problem.components[:, None], bounds, -1.0)
    narrow = bounds <= problem.widest_px
    enough = (narrow & (bounds >= 0)).any(axis=1).sum() >= problem.enough
    return np.where(narrow, bounds, -1.0) if enough else bounds


def _sampling_weights(problem: Problem) -> Array:
    """Draw a vector in proportion to the root of its weaker component's information; gated ones last."""
    x = problem.coordinates
    reliability = np.sqrt(np.where(problem.kept, problem.likelihood.fisher(x), 0.0).min(axis=1))
    return np.asarray(reliability + 1e-6 * reliability.max() + 1e-300)


def _draws(
    problem: Problem, weights: Array, inliers: NDArray[np.bool_], most_drawn: int, success: float
) -> int:
    """Samples until one of inliers alone has been drawn, as probable as asked."""
    shape = problem.vectors, -1
    good = (inliers | ~problem.components).reshape(shape).all(axis=1) & inliers.reshape(shape).any(axis=1)
    share = float(weights[good].sum() / weights.sum()) ** problem.residual.sampling.minimal
    if share <= 0:
        return most_drawn
    return min(most_drawn, int(np.log(1 - success) / np.log1p(-min(share, 1 - 1e-12))) + 1)
