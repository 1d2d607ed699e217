"""PIT: where errors fall in the model's own distribution, from a sketch."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from flowlik.calibration.sketch import ErrorSketch
from flowlik.evaluation.likelihood._goodness import magnitude_cdf
from flowlik.likelihood.likelihood import FlowLikelihood
from flowlik.support.arrays import Array

BINS = 20
FINER = 10


@dataclass(frozen=True)
class Pit:
    """Distribution of ``u = F(s z; theta(x))``; uniform where the model is right.

    Attributes
    ----------
    cumulated : array (201,)
        Share of components with u up to 0, 0.005, ... 1.
    """

    cumulated: Array

    @property
    def shares(self) -> Array:
        """Share (20,) of components in each bin of u; 0.05 where the model is right."""
        return np.diff(self.cumulated[::FINER])

    @property
    def deviation(self) -> float:
        """Largest relative deviation of a bin from its due share."""
        return float(np.abs(BINS * self.shares - 1).max())

    @property
    def ks(self) -> float:
        """K-S distance of u from the uniform distribution."""
        return float(np.abs(self.cumulated - np.linspace(0, 1, len(self.cumulated))).max())


def pit(sketch: ErrorSketch, likelihood: FlowLikelihood) -> Pit:
    """Probability integral transform of the signed errors ``s z``.

    The mass of each cell (x, z) is spread evenly between the model's distribution function at its edges;
    the outermost cells reach to 0 and to infinity.
    """
    upper = magnitude_cdf(likelihood).copy()
    upper[:, -1] = 1.0
    lower = np.concatenate([np.zeros((len(upper), 1)), upper[:, :-1]], axis=1)
    low = np.stack([0.5 - 0.5 * upper, 0.5 + 0.5 * lower], axis=1)
    filled = sketch.counts > 0
    low, mass = low[filled], sketch.counts[filled] / sketch.total
    width = np.broadcast_to(np.maximum(0.5 * (upper - lower), 1e-12)[:, None], filled.shape)[filled]
    edges = np.linspace(0, 1, BINS * FINER + 1)
    return Pit(np.array([mass @ np.clip((edge - low) / width, 0, 1) for edge in edges]))


def pit_arrays(sketches: Mapping[str, tuple[ErrorSketch, FlowLikelihood]]) -> dict[str, Any]:
    """Arrays of the PIT figure: density of u, 1 where the model is right, of each model."""
    return {
        "edges": np.linspace(0, 1, BINS + 1),
        "names": np.array(list(sketches)),
        "density": np.array([BINS * pit(*pair).shares for pair in sketches.values()]),
    }
