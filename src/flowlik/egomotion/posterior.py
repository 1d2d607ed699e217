"""Bayesian use of flow: log-density of a motion given measurements, and a Gaussian prior on it."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import RigidTransform

from flowlik.egomotion.residual import Residual, check_serves
from flowlik.errors import DataError
from flowlik.geometry.motion import inverse_left_jacobian
from flowlik.likelihood.likelihood import FlowLikelihood
from flowlik.support.arrays import Array

# a vector that leaves the image's half-space must not make a motion look better
LOST_NAT = 50.0


class LogProb(NamedTuple):
    """Log-density [nat] of a motion, gradient (6,) and Fisher information (6, 6) along the left tangent."""

    value: float
    gradient: Array
    information: Array


def log_prob(likelihood: FlowLikelihood, residual: Residual, T_k_prev: RigidTransform) -> LogProb:
    """Log-likelihood of a motion, with components taken as independent: what a filter or smoother asks for.

    The gradient holds the coordinates x, which along epipolar lines depend a little on the motion.
    Components without an image (behind the camera) count -50 nat each.

    Parameters
    ----------
    likelihood : FlowLikelihood
        Calibrated density.
    residual : Residual
        Measurements with known depth, or the epipolar constraint.
    T_k_prev : RigidTransform
        Motion; for the epipolar residual the length of its translation does not matter.

    Raises
    ------
    ModelError
        If the likelihood belongs to another flow method or texture definition.
    """
    check_serves(likelihood, residual)
    T = residual.retract(T_k_prev.as_matrix()[:3], np.zeros(6))
    _, z, J, x, _, _ = residual.at(T, likelihood.schedule.index)
    seen = np.isfinite(z)
    z, J, x = z[seen], J[seen], x[seen]
    value = float(likelihood.log_prob(z, x).sum()) - LOST_NAT * int((~seen).sum())
    return LogProb(value, J.T @ likelihood.score(z, x), J.T @ (likelihood.fisher(x)[:, None] * J))


@dataclass(frozen=True, eq=False)
class GaussianPrior:
    """Gaussian belief about a motion: ``T_k_prev = exp(xi) mean`` with xi ~ N(0, covariance).

    Attributes
    ----------
    mean : RigidTransform
        Expected motion.
    covariance : array (6, 6)
        Of (rotation vector [rad], translation [m]), left perturbation in {c} of image k.

    Raises
    ------
    DataError
        If the covariance is not a symmetric positive definite (6, 6) matrix: what is known exactly, or
        not at all, cannot be said by one.
    """

    mean: RigidTransform
    covariance: Array
    information: Array = field(init=False, repr=False)

    def __post_init__(self) -> None:
        C = np.asarray(self.covariance, dtype=np.float64)
        if C.shape != (6, 6) or not np.isfinite(C).all() or not np.allclose(C, C.T, rtol=1e-6, atol=0):
            raise DataError(f"a prior needs a finite, symmetric (6, 6) covariance, not {C.shape}")
        scale = np.sqrt(np.maximum(np.diag(C), 0.0))
        if not (scale > 0).all() or np.linalg.eigvalsh(C / np.outer(scale, scale))[0] < 1e-12:
            raise DataError("the prior's covariance is singular: every direction needs a variance above 0")
        inverse = np.linalg.inv(C / np.outer(scale, scale)) / np.outer(scale, scale)
        object.__setattr__(self, "information", 0.5 * (inverse + inverse.T))

    def log_prob(self, T_k_prev: RigidTransform) -> LogProb:
        """Log-density up to a constant; its information is that at the mean, turned to the motion."""
        xi = (T_k_prev * self.mean.inv()).as_exp_coords()
        D = inverse_left_jacobian(xi)
        return LogProb(
            -0.5 * float(xi @ self.information @ xi),
            -D.T @ self.information @ xi,
            D.T @ self.information @ D,
        )


@dataclass(frozen=True, eq=False)
class Tempered:
    """A prior and the power of the likelihood that it is weighed against.

    Correlated components together know less than their product says; raised to the power kappa the product
    is worth on average what they know (`flowlik.egomotion.covariance.temperature`).
    """

    prior: GaussianPrior
    kappa: float

    def add(self, T: RigidTransform, H: Array, b: Array, log_prob: float) -> tuple[Array, Array, float]:
        """Normal equations and log-density of the posterior, of those of the likelihood."""
        prior = self.prior.log_prob(T)
        value = self.kappa * log_prob + prior.value
        return self.kappa * H + prior.information, self.kappa * b + prior.gradient, value

    def posterior(self, A: Array, B: Array) -> tuple[Array, Array]:
        """Sensitivity and variability of the posterior's score, of those of the likelihood's."""
        return self.kappa * A + self.prior.information, self.kappa**2 * B + self.prior.information
