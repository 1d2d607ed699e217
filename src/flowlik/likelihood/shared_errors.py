"""What the errors of an image share, and a product of likelihoods ignores (docs/theory-covariance.md)."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from flowlik.errors import ModelError
from flowlik.likelihood.over_time import OverTime, Persistence
from flowlik.support.arrays import Array

KEYS = ("scale_px", "isotropic", "along", "vertical")
MOST_POWER = 3.0
SCALES_PX = (4.0, 8.0, 16.0, 32.0, 64.0, 128.0, 256.0)


@dataclass(frozen=True)
class ScoreCorrelation:
    """Correlation of two vectors' whitened scores u in {i} over their distance d [px].

    ``E[u_i u_j^T] = rho(d) I + rho_flow(d) n_i n_j^T + rho_v(d) e_v e_v^T``, with n the directions of the
    measured flow and e_v the image's vertical: neighbours share errors of any direction, a whole image those
    along its flow, and those down the image, since ground lies below and far things above. Each rho is a sum
    ``w_own [d = 0] + sum_m w_m exp(-d^2 / (2 scale_m^2)) + w_image`` with weights of at least 0, so that
    every matrix of correlations is positive semi-definite.

    Attributes
    ----------
    scales_px : array (S,)
        Lengths [px] of the Gaussians.
    isotropic, along, vertical : array (S + 2,)
        Weights of rho, rho_flow and rho_v: own, one a scale, image.

    Raises
    ------
    ModelError
        If a weight or a scale is negative or not finite, or their numbers differ.
    """

    scales_px: Array
    isotropic: Array
    along: Array
    vertical: Array

    def __post_init__(self) -> None:
        count = len(self.scales_px) + 2
        kinds = self.isotropic, self.along, self.vertical
        if any(len(kind) != count for kind in kinds):
            raise ModelError(f"a correlation over {count - 2} scales needs {count} weights of each kind")
        weights = np.concatenate(kinds)
        if not (np.isfinite(weights).all() and (weights >= 0).all() and (self.scales_px > 0).all()):
            raise ModelError("weights of a correlation must be finite and at least 0, scales positive")

    def at(self, distance_px: Array) -> Array:
        """All correlations (3, ...), rho, rho_flow and rho_v, at distances (...) [px]."""
        basis = shapes(distance_px, self.scales_px)
        return np.stack([basis @ self.isotropic, basis @ self.along, basis @ self.vertical])

    def values(self) -> dict[str, list[float]]:
        """Plain JSON values, as `of_values` takes them."""
        arrays = (self.scales_px, self.isotropic, self.along, self.vertical)
        return {name: np.asarray(array).tolist() for name, array in zip(KEYS, arrays)}

    @classmethod
    def of_values(cls, values: dict[str, list[float]]) -> ScoreCorrelation:
        """Correlation of what `values` gave.

        Raises
        ------
        ModelError
            If its parts are others, or their numbers do not fit.
        """
        # files of before the vertical term have none
        vertical = [0.0] * len(values.get("along", ()))
        values = {"vertical": vertical, **values}
        if set(values) != set(KEYS):
            raise ModelError(f"a correlation needs {', '.join(KEYS)}, not {', '.join(sorted(values))}")
        return cls(*(np.array(values[name], np.float64) for name in KEYS))


@dataclass(frozen=True, eq=False)
class SharedErrors:
    """What the errors of an image, and of those after it, have in common.

    Attributes
    ----------
    correlation : ScoreCorrelation or None
        How scores of neighbouring vectors go together; None where it was not measured.
    composite_power : float
        Power of its information that a component counts with in an estimate over many
        (`flowlik.likelihood.likelihood.FlowLikelihood.composite_weight`).
    over_time : OverTime or None
        How the errors of motions of known depth stay; None where it was not measured.

    Raises
    ------
    ModelError
        If the power is out of range.
    """

    correlation: ScoreCorrelation | None = None
    composite_power: float = 0.0
    over_time: OverTime | None = None

    def __post_init__(self) -> None:
        if not 0 <= self.composite_power <= MOST_POWER:
            raise ModelError(
                f"a composite power must lie between 0 and {MOST_POWER:g}, not {self.composite_power}"
            )

    def values(self) -> dict[str, Any]:
        """Plain JSON values, as `of_values` takes them."""
        correlation = None if self.correlation is None else self.correlation.values()
        over_time = None if self.over_time is None else asdict(self.over_time)
        return {"correlation": correlation, "composite_power": self.composite_power, "over_time": over_time}

    @classmethod
    def of_values(cls, values: dict[str, Any]) -> SharedErrors:
        """Shared errors of what `values` gave.

        Raises
        ------
        ModelError
            If a number is out of range or missing.
        """
        correlation = values["correlation"]
        found = None if correlation is None else ScoreCorrelation.of_values(correlation)
        kinds = values.get("over_time")
        over_time = None if kinds is None else OverTime(**{k: Persistence(**v) for k, v in kinds.items()})
        return cls(found, values["composite_power"], over_time)


def shapes(distance_px: Array, scales_px: Array) -> Array:
    """Functions of distance (..., S + 2) that a correlation is a weighted sum of."""
    d = np.asarray(distance_px, dtype=np.float64)[..., None]
    near = np.exp(-(d**2) / (2 * np.asarray(scales_px) ** 2))
    return np.concatenate([(d == 0).astype(np.float64), near, np.ones_like(d)], axis=-1)


def flow_directions(flow: Array) -> Array:
    """Unit vectors (N, 2) along flow (N, 2) [px], 0 where nothing moves."""
    length = np.linalg.norm(flow, axis=1, keepdims=True)
    return flow / np.where(length > 0, length, 1.0)
