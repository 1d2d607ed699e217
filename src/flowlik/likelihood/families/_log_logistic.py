"""Log-logistic error magnitudes, VOLDOR's family, as a density of the signed error."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import expit

from flowlik.likelihood.families.base import (
    LOG,
    MAGNITUDE_FLOOR_PX,
    ErrorFamily,
    Parameter,
    weighted_quantile,
)
from flowlik.support.arrays import Array


class LogLogistic(ErrorFamily):
    """Half the log-logistic density of abs(z), with ``scale`` [px] (its median) and ``shape``.

    Where the shape is below 1 the density is infinite at 0 and above 1 it vanishes there; within
    1e-4 px of 0 it is replaced by its average over that interval, for any shape.
    """

    name: ClassVar[str] = "log-logistic"
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter("scale", "px", 0.0, np.inf, LOG),
        Parameter("shape", "1", 0.0, np.inf, LOG),
    )

    def logpdf(self, z: ArrayLike, theta: Array) -> Array:
        """Log-density [nat] at z [px]."""
        scale, shape = theta
        magnitude = np.abs(np.asarray(z, dtype=np.float64))
        v = shape * (np.log(np.maximum(magnitude, MAGNITUDE_FLOOR_PX)) - np.log(scale))
        density = (
            np.log(shape) + v - 2 * np.logaddexp(0, v) - np.log(np.maximum(magnitude, MAGNITUDE_FLOOR_PX))
        )
        average = v - np.logaddexp(0, v) - np.log(MAGNITUDE_FLOOR_PX)
        return np.where(magnitude < MAGNITUDE_FLOOR_PX, average, density) - np.log(2)

    def gradient(self, z: ArrayLike, theta: Array) -> tuple[Array, Array]:
        """Derivatives of `logpdf` by z (0 within the averaged interval) and by (scale, shape)."""
        scale, shape = theta
        z = np.asarray(z, dtype=np.float64)
        averaged = np.abs(z) < MAGNITUDE_FLOOR_PX
        magnitude = np.maximum(np.abs(z), MAGNITUDE_FLOOR_PX)
        ratio = np.log(magnitude) - np.log(scale)
        # d logpdf / dv, v = shape * ratio
        slope = np.where(averaged, expit(-shape * ratio), 1 - 2 * expit(shape * ratio))
        by_z = np.where(averaged, 0.0, np.sign(z) * (shape * slope - 1) / magnitude)
        by_scale = -slope * shape / scale
        by_shape = slope * ratio + np.where(averaged, 0.0, 1 / shape)
        return by_z, np.stack(np.broadcast_arrays(by_scale, by_shape))

    def magnitude_cdf(self, magnitude: ArrayLike, theta: Array) -> Array:
        """Probability that abs(z) is at most ``magnitude`` [px]."""
        scale, shape = theta
        magnitude = np.asarray(magnitude, dtype=np.float64)
        above = np.maximum(magnitude, MAGNITUDE_FLOOR_PX)
        return expit(shape * np.log(above / scale)) * np.minimum(magnitude / MAGNITUDE_FLOOR_PX, 1.0)

    def sample_magnitude(self, theta: Array, size: int | tuple[int, ...], rng: np.random.Generator) -> Array:
        """Random abs(z) [px]."""
        scale, shape = theta
        u = np.maximum(rng.random(size=size), 1e-300)
        magnitude = scale * np.exp((np.log(u) - np.log1p(-u)) / shape)
        return np.where(magnitude < MAGNITUDE_FLOOR_PX, MAGNITUDE_FLOOR_PX * rng.random(size=size), magnitude)

    def start(self, magnitude: Array, count: Array) -> Array:
        """Median and shape (2,) from the quartiles."""
        low, middle, high = (weighted_quantile(magnitude, count, q) for q in (0.25, 0.5, 0.75))
        spread = np.log(max(high, 2e-4) / max(low, MAGNITUDE_FLOOR_PX))
        return np.array(
            [max(middle, MAGNITUDE_FLOOR_PX), np.clip(2 * np.log(3) / max(spread, 0.1), 0.3, 5.0)]
        )
