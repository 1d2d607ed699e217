"""Cauchy errors: tails so heavy that there is no mean; a component of mixtures."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from flowlik.likelihood.families.base import (
    LOG,
    MAGNITUDE_FLOOR_PX,
    ErrorFamily,
    Parameter,
    weighted_quantile,
)
from flowlik.support.arrays import Array


class Cauchy(ErrorFamily):
    r"""Density :math:`\gamma / (\pi (\gamma^2 + z^2))` with ``gamma`` [px], the median magnitude."""

    name: ClassVar[str] = "cauchy"
    parameters: ClassVar[tuple[Parameter, ...]] = (Parameter("gamma", "px", 0.0, np.inf, LOG),)

    def logpdf(self, z: ArrayLike, theta: Array) -> Array:
        """Log-density [nat] at z [px]."""
        (gamma,) = theta
        return np.log(gamma / np.pi) - np.log(np.asarray(z, dtype=np.float64) ** 2 + gamma**2)

    def gradient(self, z: ArrayLike, theta: Array) -> tuple[Array, Array]:
        """Derivatives of `logpdf` by z and by gamma."""
        (gamma,) = theta
        z = np.asarray(z, dtype=np.float64)
        over = 1 / (z**2 + gamma**2)
        return -2 * z * over, (1 / gamma - 2 * gamma * over)[None]

    def magnitude_cdf(self, magnitude: ArrayLike, theta: Array) -> Array:
        """Probability that abs(z) is at most ``magnitude`` [px]."""
        (gamma,) = theta
        return 2 / np.pi * np.arctan(np.asarray(magnitude) / gamma)

    def sample_magnitude(self, theta: Array, size: int | tuple[int, ...], rng: np.random.Generator) -> Array:
        """Random abs(z) [px]."""
        (gamma,) = theta
        return gamma * np.abs(rng.standard_cauchy(size=size))

    def start(self, magnitude: Array, count: Array) -> Array:
        """Median magnitude (1,)."""
        return np.array([max(weighted_quantile(magnitude, count, 0.5), MAGNITUDE_FLOOR_PX)])

    def improve(self, magnitude: Array, count: Array, theta: Array) -> Array:
        """One fixed-point step of gamma, the Cauchy as a scale mixture of Gaussians."""
        square = theta[0] ** 2
        step = 2 * square * np.average(magnitude**2 / (square + magnitude**2), weights=count)
        return np.array([max(np.sqrt(step), MAGNITUDE_FLOOR_PX)])
