"""How a model holds on a sequence's own errors: score, coverage, predicted against found sizes."""

from __future__ import annotations

from collections.abc import Sequence as Seq
from dataclasses import dataclass

import numpy as np

from flowlik.likelihood.likelihood import FlowLikelihood
from flowlik.self_supervision.cross_fit import MotionErrors
from flowlik.support.arrays import Array

LEVELS = (0.5, 0.68, 0.9, 0.95)
FIFTHS = 5
SIZES = 12
"""Groups of equal number by the size predicted, of which the size found is told."""


@dataclass(frozen=True)
class Reading:
    """How a model holds on errors: negative log-density [nat] a component, coverage at each of `LEVELS`."""

    nll: float
    coverage: tuple[float, ...]
    components: int

    def values(self) -> dict[str, float]:
        """Figures by the names of metrics."""
        covered = {f"coverage_{100 * level:.0f}": c for level, c in zip(LEVELS, self.coverage)}
        return {"nll": self.nll, **covered}

    @classmethod
    def of(cls, likelihood: FlowLikelihood, errors: Seq[MotionErrors]) -> Reading:
        """Read a model on the errors of pairs, all components alike."""
        x, z = _pooled(likelihood, errors)
        held = tuple(float(np.mean(np.abs(z) <= likelihood.bound(x, level))) for level in LEVELS)
        return cls(float(-likelihood.log_prob(z, x).mean()), held, len(z))


def independent_pairs(likelihood: FlowLikelihood, errors: Seq[MotionErrors]) -> float:
    """How many independent pairs these amount to for a table: neighbours show the same things.

    The mean log-density of a pair is a series over time; its length over one plus twice the sum of its
    autocorrelations, up to the first that is not above 0.
    """
    each = np.array([Reading.of(likelihood, [e]).nll for e in errors])
    return effective_number(each)


def effective_number(series: Array) -> float:
    """Length of a series (N,) of correlated values as so many independent ones."""
    centred = series - series.mean()
    variance = float(centred @ centred)
    total = 0.0
    if variance > 0:
        for lag in range(1, len(series)):
            rho = float(centred[lag:] @ centred[:-lag]) / variance
            if rho <= 0:
                break
            total += rho
    return len(series) / (1 + 2 * total)


def by_fifths(likelihood: FlowLikelihood, errors: Seq[MotionErrors], covariate: str | None = None) -> Array:
    """Coverage (L, 5) at each of `LEVELS` of the fifths of components, by x or by a covariate."""
    x, z = _pooled(likelihood, errors)
    key = x if covariate is None else np.concatenate([e.values[covariate] for e in errors])
    order = np.argsort(key, kind="stable")
    return np.array(
        [
            [
                np.mean(part)
                for part in np.array_split((np.abs(z) <= likelihood.bound(x, level))[order], FIFTHS)
            ]
            for level in LEVELS
        ]
    )


def predicted_and_found(
    likelihood: FlowLikelihood, errors: Seq[MotionErrors], level: float = 0.68
) -> tuple[Array, Array]:
    """Sizes (12,) [px] that hold a level of errors, as predicted and as found, of equally many components."""
    x, z = _pooled(likelihood, errors)
    bound, magnitude = likelihood.bound(x, level), np.abs(z)
    groups = np.array_split(np.argsort(bound, kind="stable"), SIZES)
    predicted = np.array([np.median(bound[g]) for g in groups])
    return predicted, np.array([np.quantile(magnitude[g], level) for g in groups])


def _pooled(likelihood: FlowLikelihood, errors: Seq[MotionErrors]) -> tuple[Array, Array]:
    """Coordinates and errors of all components."""
    index = likelihood.schedule.index
    return np.concatenate([e.coordinates(index) for e in errors]), np.concatenate([e.z for e in errors])
