"""Moments of a frame's total score: what the covariance is made of (docs/theory-covariance.md)."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from flowlik.egomotion._kernels import retract
from flowlik.egomotion.covariance import observed_sensitivity, sandwich, score_covariance
from flowlik.egomotion.residual import Chosen, Residual, composite_weight
from flowlik.egomotion.result import Status, conditioned
from flowlik.support.arrays import Array

if TYPE_CHECKING:
    from flowlik.egomotion.estimator import Estimator


def component_information(
    estimator: Estimator, residual: Residual, T: Array, x: Array, used: NDArray[np.bool_]
) -> Array:
    """Information (C,) [1/px^2] of each component's score at a motion T (3, 4); 0 where it does not enter.

    ``x`` (C,) are the components' coordinates there.

    The inliers of a cut likelihood move with the motion, so that every used component counts with the
    information of a score cut off at its bound; RANSAC's inliers count as least squares has them.
    """
    cut = None if estimator.refine_all or estimator.radius_px is not None else estimator.confidence
    counting = used if estimator.radius_px is None else estimator.inlying(residual, T, used)
    return np.where(counting, estimator.likelihood.fisher(x, cut), 0.0)


def score_moments(
    estimator: Estimator, residual: Residual, T: Array, used: NDArray[np.bool_]
) -> tuple[Array, Array]:
    """A and B (6, 6) of the sandwich: expected sensitivity and covariance of the total score at a motion.

    Without a correlation of scores B is that of independent ones.
    """
    _, J = residual.linearise(T)
    likelihood = estimator.likelihood
    x = residual.coordinates(T, likelihood.schedule.index)
    fisher = component_information(estimator, residual, T, x, used)
    weight = composite_weight(residual, likelihood, x)
    A = J.T @ ((weight * fisher)[:, None] * J)
    variance = weight**2 * fisher
    if likelihood.correlation is None:
        return A, J.T @ (variance[:, None] * J)
    m, directions = residual.measurements, residual.directions(T)
    return A, score_covariance(m, directions, J, variance, likelihood.correlation)


def sensitivity(
    estimator: Estimator, residual: Residual, T: Array, used: NDArray[np.bool_], A: Array, B: Array
) -> Array:
    """Observed sensitivity (6, 6); A where correlations or a direction are unknown."""
    basis, likelihood = residual.basis(T), estimator.likelihood
    if likelihood.correlation is None or conditioned(basis, A)[0] is not Status.SOLVED:
        return A
    x = residual.coordinates(T, likelihood.schedule.index)
    held = Chosen.of(residual, likelihood, x, used)
    bounds = np.full(len(x), np.inf) if estimator.refine_all else estimator.bound(x)

    def gradient(step: Array) -> Array:
        return residual.total_score(residual.normalise(retract(T, step)), held, bounds)

    return observed_sensitivity(gradient, A, sandwich(A, B, basis), basis)
