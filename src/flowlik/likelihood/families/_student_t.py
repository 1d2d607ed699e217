"""Student's t: one parameter for the width of errors, one for the weight of their tails."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import betainc, betaincc, digamma, gammaln

from flowlik.likelihood.families.base import (
    LOG,
    MAGNITUDE_FLOOR_PX,
    ErrorFamily,
    Parameter,
    log_between,
    weighted_quantile,
)
from flowlik.support.arrays import Array

NU_LOWER, NU_UPPER = 0.3, 100.0


class StudentT(ErrorFamily):
    r"""Density proportional to :math:`(1 + z^2 / (\nu s^2))^{-(\nu + 1) / 2}`.

    Parameters ``scale`` s > 0 [px] and ``nu`` in (0.3, 100): the tail of abs(z) falls as its power -nu;
    nu = 1 is the Cauchy, nu = 100 as good as the Gaussian.
    """

    name: ClassVar[str] = "student-t"
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter("scale", "px", 0.0, np.inf, LOG),
        Parameter("nu", "1", NU_LOWER, NU_UPPER, log_between(NU_LOWER, NU_UPPER)),
    )

    def logpdf(self, z: ArrayLike, theta: Array) -> Array:
        """Log-density [nat] at z [px]."""
        grown, height = self._terms(z, theta)
        return height - np.log(grown) * (0.5 * (theta[1] + 1))

    def gradient(self, z: ArrayLike, theta: Array) -> tuple[Array, Array]:
        """Derivatives of `logpdf` by z and by (scale, nu)."""
        scale, nu = theta
        z = np.asarray(z, dtype=np.float64)
        over = 1 / self._terms(z, theta)[0]
        return -z * over * ((nu + 1) / (nu * scale**2)), self.logpdf_and_gradient(z, theta)[1]

    def logpdf_and_gradient(self, z: ArrayLike, theta: Array) -> tuple[Array, Array]:
        """Log-density [nat] and its derivatives by (scale, nu)."""
        scale, nu = theta
        grown, height = self._terms(z, theta)
        logarithm, over = np.log(grown), 1 / grown
        by_scale = nu / scale - over * ((nu + 1) / scale)
        constant = digamma(0.5 * (nu + 1)) - digamma(0.5 * nu) + 1
        by_nu = 0.5 * (constant - logarithm - over * ((nu + 1) / nu))
        return height - logarithm * (0.5 * (nu + 1)), np.stack([by_scale, by_nu])

    @staticmethod
    def _terms(z: ArrayLike, theta: Array) -> tuple[Array, Array]:
        """``1 + z^2 / (nu s^2)``, and the log-density at 0."""
        scale, nu = theta
        height = gammaln(0.5 * (nu + 1)) - gammaln(0.5 * nu) - 0.5 * np.log(np.pi * nu) - np.log(scale)
        return np.asarray(z, dtype=np.float64) ** 2 * (1 / (nu * scale**2)) + 1, height

    def magnitude_cdf(self, magnitude: ArrayLike, theta: Array) -> Array:
        """Probability that abs(z) is at most ``magnitude`` [px]."""
        scale, nu = theta
        y = np.asarray(magnitude, dtype=np.float64) ** 2 / (nu * scale**2)
        # either form loses all digits where the other is exact
        near, far = betainc(0.5, 0.5 * nu, y / (1 + y)), betaincc(0.5 * nu, 0.5, 1 / (1 + y))
        return np.where(y < 1, near, far)

    def sample_magnitude(self, theta: Array, size: int | tuple[int, ...], rng: np.random.Generator) -> Array:
        """Random abs(z) [px]."""
        scale, nu = theta
        return scale * np.abs(rng.standard_t(nu, size=size))

    def start(self, magnitude: Array, count: Array) -> Array:
        """Parameters (2,) after some steps from the median and two degrees of freedom."""
        theta = np.array([max(weighted_quantile(magnitude, count, 0.5), MAGNITUDE_FLOOR_PX), 2.0])
        for _ in range(60):
            theta = self.improve(magnitude, count, theta)
        return theta

    def improve(self, magnitude: Array, count: Array, theta: Array) -> Array:
        """One step: nu climbs by a tenth or stays, then the scale's fixed point."""
        scale, nu = theta
        trial = np.clip(nu * np.array([0.9, 1.0, 1.1]), 1.01 * NU_LOWER, 0.99 * NU_UPPER)
        score = self.logpdf(magnitude, np.stack([np.full(3, scale), trial])[..., None]) @ count
        nu = trial[np.argmax(score)]
        pull = (nu + 1) / (nu + (magnitude / scale) ** 2)
        scale = np.sqrt(np.average(pull * magnitude**2, weights=count))
        return np.array([max(scale, MAGNITUDE_FLOOR_PX), nu])
