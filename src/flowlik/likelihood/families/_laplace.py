"""Laplace errors: what least absolute deviations assumes."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from flowlik.likelihood.families.base import LOG, MAGNITUDE_FLOOR_PX, ErrorFamily, Parameter
from flowlik.support.arrays import Array


class Laplace(ErrorFamily):
    r"""Double exponential density :math:`e^{-|z| / b} / (2 b)` with ``scale`` b [px], its mean magnitude."""

    name: ClassVar[str] = "laplace"
    parameters: ClassVar[tuple[Parameter, ...]] = (Parameter("scale", "px", 0.0, np.inf, LOG),)

    def logpdf(self, z: ArrayLike, theta: Array) -> Array:
        """Log-density [nat] at z [px]."""
        (scale,) = theta
        return np.abs(np.asarray(z, dtype=np.float64)) * (-1 / scale) - np.log(2 * scale)

    def gradient(self, z: ArrayLike, theta: Array) -> tuple[Array, Array]:
        """Derivatives of `logpdf` by z (0 at the cusp) and by the scale."""
        (scale,) = theta
        z = np.asarray(z, dtype=np.float64)
        by_z, by_scale = np.broadcast_arrays(-np.sign(z) / scale, np.abs(z) * (1 / scale**2) - 1 / scale)
        return by_z, by_scale[None]

    def magnitude_cdf(self, magnitude: ArrayLike, theta: Array) -> Array:
        """Probability that abs(z) is at most ``magnitude`` [px]."""
        (scale,) = theta
        return -np.expm1(-np.asarray(magnitude) / scale)

    def magnitude_ppf(self, confidence: ArrayLike, theta: Array) -> Array:
        """Half-width b [px] of the central region, in closed form."""
        (scale,) = theta
        return -scale * np.log1p(-np.asarray(confidence))

    def sample_magnitude(self, theta: Array, size: int | tuple[int, ...], rng: np.random.Generator) -> Array:
        """Random abs(z) [px]."""
        (scale,) = theta
        return scale * rng.exponential(size=size)

    def start(self, magnitude: Array, count: Array) -> Array:
        """Mean magnitude (1,): already the best constant."""
        return np.array([max(np.average(magnitude, weights=count), MAGNITUDE_FLOOR_PX)])
