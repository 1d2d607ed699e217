"""Moments of a frame's total score: what the covariance is made of (docs/theory-covariance.md)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from flowlik.egomotion.covariance import (
    common_variability,
    observed_sensitivity,
    sandwich,
    score_covariance,
    subpixel_variability,
    temperature,
)
from flowlik.egomotion.posterior import GaussianPrior, Tempered
from flowlik.egomotion.problem import Problem, View
from flowlik.support.arrays import Array

# an information's smallest and largest eigenvalue, scaled, whose ratio is above this
LEAST_RECIPROCAL_CONDITION = 1e-9


class Moments(NamedTuple):
    """Of the total score along the left tangent, each (6, 6).

    Attributes
    ----------
    information : array (6, 6)
        A, expected sensitivity: how fast the score falls, were the density exact.
    variability : array (6, 6)
        B, covariance of the score.
    sensitivity : array (6, 6)
        A as this frame has it; the expected one where correlations or a direction are unknown.
    """

    information: Array
    variability: Array
    sensitivity: Array

    def covariance(self, basis: Array) -> Array:
        """Covariance (6, 6) of the motion within the observable directions (6, D); NaN if one is open."""
        if not determines(self.information, basis):
            return np.full((6, 6), np.nan)
        return sandwich(self.sensitivity, self.variability, basis)

    def facing(self, in_front: float) -> Moments:
        """Moments of a motion without scale, when only a share of the parallax is of points in front.

        The rest is errors along the lines, which look like parallax and tell no direction.
        """
        known = np.repeat([1.0, in_front], 3)
        return Moments(*(matrix * np.outer(known, known) for matrix in self))

    def tempered(self, prior: GaussianPrior) -> Tempered:
        """A prior, with the power of the likelihood that is worth what it knows."""
        return Tempered(prior, temperature(self.sensitivity, self.variability))

    def with_prior(self, belief: Tempered) -> Moments:
        """Moments of the posterior's score."""
        A, B = belief.posterior(self.information, self.variability)
        return Moments(A, B, belief.posterior(self.sensitivity, self.variability)[0])


def determines(information: Array, basis: Array) -> bool:
    """Whether an information (6, 6) determines every observable direction (6, D)."""
    A = basis.T @ information @ basis
    scale = np.sqrt(np.diag(A))
    if not (scale > 0).all():
        return False
    eigenvalues = np.linalg.eigvalsh(A / np.outer(scale, scale))
    return bool(eigenvalues[0] > LEAST_RECIPROCAL_CONDITION * eigenvalues[-1])


def score_moments(problem: Problem, view: View, common_bias_px: float = 0.0) -> Moments:
    """Moments at a motion. Without a correlation of scores they are those of independent ones.

    A bias [px] that the whole image may share comes to their variability.
    """
    J, x, directions = view.errors.J, view.errors.x, view.errors.directions
    fisher, weight = problem.information(view), problem.weighting.weight(x)
    A = J.T @ ((weight * fisher)[:, None] * J)
    variance = weight**2 * fisher
    correlation = problem.likelihood.shared_errors.correlation
    if correlation is None:
        return Moments(A, J.T @ (variance[:, None] * J), A)
    m = problem.residual.measurements
    B = score_covariance(m, directions, J, variance, correlation)
    B += subpixel_variability(m, directions, J, weight * fisher)
    B += common_variability(common_bias_px, directions, J, weight * fisher)
    return Moments(A, B, _sensitivity(problem, view, A, B) if determines(A, view.errors.basis) else A)


def _sensitivity(problem: Problem, view: View, A: Array, B: Array) -> Array:
    """Observed sensitivity (6, 6)."""
    residual, (T, _, _, x, _, basis) = problem.residual, view.errors
    held = problem.chosen(x, view.used)
    bounds = np.full(len(x), np.inf) if problem.refine_all else view.bounds

    def gradients(steps: Array) -> Array:
        motions = np.array([residual.retract(T, step) for step in steps])
        return residual.total_scores(motions, held, bounds)

    return observed_sensitivity(gradients, A, sandwich(A, B, basis), basis)
