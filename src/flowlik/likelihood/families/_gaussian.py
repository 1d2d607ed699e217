"""Gaussian errors: the noise model behind least squares."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import erf, ndtri

from flowlik.likelihood.families.base import LOG, MAGNITUDE_FLOOR_PX, ErrorFamily, Parameter
from flowlik.support.arrays import Array


class Gaussian(ErrorFamily):
    """Zero-mean normal density with standard deviation ``sigma`` [px]."""

    name: ClassVar[str] = "gaussian"
    parameters: ClassVar[tuple[Parameter, ...]] = (Parameter("sigma", "px", 0.0, np.inf, LOG),)

    def logpdf(self, z: ArrayLike, theta: Array) -> Array:
        """Log-density [nat] at z [px]."""
        (sigma,) = theta
        return -0.5 * (np.asarray(z) / sigma) ** 2 - np.log(sigma) - 0.5 * np.log(2 * np.pi)

    def gradient(self, z: ArrayLike, theta: Array) -> tuple[Array, Array]:
        """Derivatives of `logpdf` by z and by sigma."""
        (sigma,) = theta
        z = np.asarray(z, dtype=np.float64)
        by_z, by_sigma = np.broadcast_arrays(-z / sigma**2, z**2 / sigma**3 - 1 / sigma)
        return by_z, by_sigma[None]

    def magnitude_cdf(self, magnitude: ArrayLike, theta: Array) -> Array:
        """Probability that abs(z) is at most ``magnitude`` [px]."""
        (sigma,) = theta
        return erf(np.asarray(magnitude) / (np.sqrt(2) * sigma))

    def magnitude_ppf(self, confidence: ArrayLike, theta: Array) -> Array:
        """Half-width b [px] of the central region, in closed form."""
        (sigma,) = theta
        return sigma * ndtri(0.5 + 0.5 * np.asarray(confidence))

    def sample_magnitude(self, theta: Array, size: int | tuple[int, ...], rng: np.random.Generator) -> Array:
        """Random abs(z) [px]."""
        (sigma,) = theta
        return sigma * np.abs(rng.standard_normal(size=size))

    def start(self, magnitude: Array, count: Array) -> Array:
        """Root mean square (1,): already the best constant."""
        return np.array([max(np.sqrt(np.average(magnitude**2, weights=count)), MAGNITUDE_FLOOR_PX)])
