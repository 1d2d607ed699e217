"""Laplace-Cauchy mixture (LCM), the paper's Eq. (10)."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from flowlik.likelihood.families.base import LOG, LOGIT, ErrorFamily, Link, Parameter, weighted_quantile
from flowlik.support.arrays import Array


def _beta(u: Array) -> Array:
    return 2 / np.pi * np.arctan(np.exp(u))


# the free variable of beta is ln(lambda), lambda = tan(pi beta / 2): beta itself is flat near 1
LOG_TAN = Link(_beta, lambda b: np.log(np.tan(np.pi / 2 * b)), lambda u: 1 / (np.pi * np.cosh(u)))


class LaplaceCauchy(ErrorFamily):
    r"""Mixture of a Laplace core and Cauchy tails.

    .. math:: w_L \tfrac{\lambda}{2} e^{-\lambda |z|} + (1 - w_L) \frac{\gamma}{\pi (\gamma^2 + z^2)},
              \qquad \lambda = \tan(\tfrac{\pi}{2}\beta)

    Parameters ``beta`` in (0, 1) (``lambda`` is in 1/px), ``gamma`` > 0 [px], ``w_L`` in (0, 1).
    """

    name: ClassVar[str] = "lcm"
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter("beta", "1", 0.0, 1.0, LOG_TAN),
        Parameter("gamma", "px", 0.0, np.inf, LOG),
        Parameter("w_L", "1", 0.0, 1.0, LOGIT),
    )

    def _terms(self, z: ArrayLike, theta: Array) -> tuple[Array, Array, Array, Array]:
        magnitude = np.abs(np.asarray(z, dtype=np.float64))
        beta, gamma, weight = theta
        rate = np.tan(np.pi / 2 * beta)
        with np.errstate(divide="ignore"):
            laplace = np.log(weight) + np.log(0.5 * rate) - rate * magnitude
            cauchy = np.log1p(-weight) + np.log(gamma / np.pi) - np.log(gamma**2 + magnitude**2)
        return magnitude, rate, laplace, cauchy

    def logpdf(self, z: ArrayLike, theta: Array) -> Array:
        """Log-density [nat] at z [px]."""
        _, _, laplace, cauchy = self._terms(z, theta)
        return np.logaddexp(laplace, cauchy)

    def gradient(self, z: ArrayLike, theta: Array) -> tuple[Array, Array]:
        """Derivatives of `logpdf` by z (0 at the cusp) and by (beta, gamma, w_L)."""
        magnitude, rate, laplace, cauchy = self._terms(z, theta)
        gamma = theta[1]
        total = np.logaddexp(laplace, cauchy)
        core, tail = np.exp(laplace - total), np.exp(cauchy - total)
        square = gamma**2 + magnitude**2
        by_z = -np.sign(z) * (core * rate + tail * 2 * magnitude / square)
        by_beta = core * (1 / rate - magnitude) * np.pi / 2 * (1 + rate**2)
        by_gamma = tail * (1 / gamma - 2 * gamma / square)
        # densities rather than responsibilities over weights, which may be 0 or 1
        by_weight = np.exp(np.log(0.5 * rate) - rate * magnitude - total) - gamma / np.pi / square * np.exp(
            -total
        )
        return by_z, np.stack(np.broadcast_arrays(by_beta, by_gamma, by_weight))

    def magnitude_cdf(self, magnitude: ArrayLike, theta: Array) -> Array:
        """Probability that abs(z) is at most ``magnitude`` [px]."""
        beta, gamma, weight = theta
        magnitude = np.asarray(magnitude, dtype=np.float64)
        laplace = -np.expm1(-magnitude * np.tan(np.pi / 2 * beta))
        return weight * laplace + (1 - weight) * 2 / np.pi * np.arctan(magnitude / gamma)

    def sample_magnitude(self, theta: Array, size: int | tuple[int, ...], rng: np.random.Generator) -> Array:
        """Random abs(z) [px]."""
        beta, gamma, weight = theta
        laplace = rng.exponential(size=size) / np.tan(np.pi / 2 * beta)
        cauchy = gamma * np.abs(rng.standard_cauchy(size=size))
        return np.where(rng.random(size=size) < weight, laplace, cauchy)

    def start(self, magnitude: Array, count: Array) -> Array:
        """Parameters (3,) after a few steps of expectation maximisation from the quartiles."""
        middle = max(weighted_quantile(magnitude, count, 0.5), 1e-3)
        rate, gamma, weight = np.log(2) / middle, 2 * middle, 0.6
        for _ in range(50):
            theta = np.array([2 / np.pi * np.arctan(rate), gamma, weight])
            _, _, laplace, cauchy = self._terms(magnitude, theta)
            core = count * np.exp(laplace - np.logaddexp(laplace, cauchy))
            tail = count - core
            weight = float(np.clip(core.sum() / count.sum(), 0.02, 0.98))
            rate = core.sum() / max((core * magnitude).sum(), 1e-12)
            # the Cauchy as a scale mixture of Gaussians: one fixed-point step for its scale
            gamma = np.sqrt(
                (tail * magnitude**2 / (gamma**2 + magnitude**2)).sum() * 2 * gamma**2 / tail.sum()
            )
            gamma = float(np.clip(gamma, 1e-4, 1e3))
        return np.array([2 / np.pi * np.arctan(rate), gamma, weight])
