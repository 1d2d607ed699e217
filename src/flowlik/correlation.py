"""Correlation of neighbouring scores, which a product of likelihoods ignores (docs/theory-covariance.md)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from flowlik.camera import Array
from flowlik.errors import ModelError

SCALES_PX = (4.0, 8.0, 16.0, 32.0, 64.0, 128.0, 256.0)


@dataclass(frozen=True)
class ScoreCorrelation:
    """Correlation of two vectors' whitened scores u in {i} over their distance d [px].

    ``E[u_i u_j^T] = rho(d) I + rho_flow(d) n_i n_j^T``, with n the directions of the measured flow:
    neighbours share errors of any direction, a whole image those along its flow. Each rho is a sum
    ``w_own [d = 0] + sum_m w_m exp(-d^2 / (2 scale_m^2)) + w_image`` with weights of at least 0, so that
    every matrix of correlations is positive semi-definite.

    Attributes
    ----------
    scales_px : array (S,)
        Lengths [px] of the Gaussians.
    isotropic, along : array (S + 2,)
        Weights of rho and rho_flow: own, one a scale, image.

    Raises
    ------
    ModelError
        If a weight or a scale is negative or not finite, or their numbers differ.
    """

    scales_px: Array
    isotropic: Array
    along: Array

    def __post_init__(self) -> None:
        count = len(self.scales_px) + 2
        if len(self.isotropic) != count or len(self.along) != count:
            raise ModelError(f"a correlation over {count - 2} scales needs {count} weights of each kind")
        weights = np.concatenate([self.isotropic, self.along])
        if not (np.isfinite(weights).all() and (weights >= 0).all() and (self.scales_px > 0).all()):
            raise ModelError("weights of a correlation must be finite and at least 0, scales positive")

    def at(self, distance_px: Array) -> Array:
        """Both correlations (2, ...), rho and rho_flow, at distances (...) [px]."""
        basis = shapes(distance_px, self.scales_px)
        return np.stack([basis @ self.isotropic, basis @ self.along])

    def values(self) -> dict[str, list[float]]:
        """Plain JSON values, as `of_values` takes them."""
        arrays = {"scale_px": self.scales_px, "isotropic": self.isotropic, "along": self.along}
        return {name: np.asarray(array).tolist() for name, array in arrays.items()}

    @classmethod
    def of_values(cls, values: dict[str, list[float]]) -> ScoreCorrelation:
        """Correlation of what `values` gave."""
        if set(values) != {"scale_px", "isotropic", "along"}:
            raise ModelError(f"a correlation needs scale_px, isotropic and along, not {sorted(values)}")
        return cls(*(np.array(values[name], np.float64) for name in ("scale_px", "isotropic", "along")))


def shapes(distance_px: Array, scales_px: Array) -> Array:
    """Functions of distance (..., S + 2) that a correlation is a weighted sum of."""
    d = np.asarray(distance_px, dtype=np.float64)[..., None]
    near = np.exp(-(d**2) / (2 * np.asarray(scales_px) ** 2))
    return np.concatenate([(d == 0).astype(np.float64), near, np.ones_like(d)], axis=-1)


def flow_directions(flow: Array) -> Array:
    """Unit vectors (N, 2) along flow (N, 2) [px], 0 where nothing moves."""
    length = np.linalg.norm(flow, axis=1, keepdims=True)
    return flow / np.where(length > 0, length, 1.0)
