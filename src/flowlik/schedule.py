"""Schedules: the look-up table theta(x; u) over an index of covariates (paper, Sec. II-F)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from flowlik.camera import Array
from flowlik.errors import ModelError
from flowlik.families.base import ErrorFamily
from flowlik.measurements import Measurements


@dataclass(frozen=True)
class Term:
    """One term of an index: the logarithm of a covariate, floored, times a weight.

    Parameters
    ----------
    covariate : str
        Name in `Measurements.covariates`.
    floor : float
        Least value, in the covariate's unit.
    weight : float
        Factor of ln(covariate).
    """

    covariate: str
    floor: float
    weight: float = 1.0


@dataclass(frozen=True)
class Index:
    """The schedule's coordinate ``x = sum_j weight_j ln(max(covariate_j, floor_j))`` of a component.

    The paper's schedule is the single term ln t.
    """

    terms: tuple[Term, ...] = (Term("texture", 1e-2),)

    def of(self, covariates: dict[str, Array]) -> Array:
        """Coordinates x of covariates of any one shape."""
        missing = [term.covariate for term in self.terms if term.covariate not in covariates]
        if missing:
            raise ModelError(f"the schedule needs the covariates {missing}, which were not measured")
        x = sum(t.weight * np.log(np.maximum(covariates[t.covariate], t.floor)) for t in self.terms)
        return np.asarray(x, dtype=np.float64)

    def along(self, measurements: Measurements, normal: Array) -> Array:
        """Coordinates x (N,) of the error along unit vectors ``normal`` (N, 2) in {i}.

        A covariate along n is the quadratic form of its two eigen-components, as ``t_n = n^T S n``.
        """
        share = np.einsum("nij,ni->nj", measurements.R_i_e, normal) ** 2
        needed = {term.covariate for term in self.terms} & set(measurements.covariates)
        return self.of({name: (measurements.covariates[name] * share).sum(axis=1) for name in needed})


@dataclass(frozen=True)
class Schedule:
    """Look-up table: parameters at knots of x, linear between, constant beyond the outer knots.

    The family's own parameters are interpolated, as in the paper.

    Attributes
    ----------
    index : Index
        Gives x from covariates.
    knots : array (M,)
        Increasing knots of x.
    values : array (P, M)
        Parameters at the knots.
    """

    index: Index
    knots: Array
    values: Array

    def __post_init__(self) -> None:
        if self.knots.ndim != 1 or self.values.ndim != 2 or self.values.shape[1] != len(self.knots):
            raise ModelError(f"table of shape {self.values.shape} does not fit {self.knots.shape} knots")
        if len(self.knots) < 2 or not (np.diff(self.knots) > 0).all() or not np.isfinite(self.values).all():
            raise ModelError("a table needs two or more increasing knots and finite values")

    @classmethod
    def constant(cls, theta: Array) -> Schedule:
        """Return a schedule of the same parameters (P,) everywhere."""
        return cls(Index(), np.array([-1e3, 1e3]), np.repeat(np.asarray(theta, float)[:, None], 2, axis=1))

    @property
    def name(self) -> str:
        """``"constant"``, or the covariates of the index: ``"texture"`` is the paper's schedule."""
        if not np.ptp(self.values, axis=1).any():
            return "constant"
        return "+".join(term.covariate for term in self.index.terms)

    def theta(self, x: Array | float) -> Array:
        """Parameters (P, ...) at coordinates x (...)."""
        return np.stack([np.interp(x, self.knots, row) for row in self.values])

    def hats(self, x: Array) -> Array:
        """Interpolation weights (M, X) of the knots at x (X,): ``theta(x) = values @ hats(x)``."""
        return np.stack([np.interp(x, self.knots, row) for row in np.eye(len(self.knots))])

    def outside(self, x: Array) -> float:
        """Share of coordinates beyond the outer knots, where the table was never calibrated."""
        return float(np.mean((x < self.knots[0]) | (x > self.knots[-1]))) if np.size(x) else 0.0


def check_values(family: ErrorFamily, schedule: Schedule) -> None:
    """Raise ModelError unless the table holds the family's parameters within their bounds."""
    if len(schedule.values) != len(family.parameters):
        raise ModelError(
            f"family {family.name} has {len(family.parameters)} parameters, the table {len(schedule.values)}"
        )
    for parameter, row in zip(family.parameters, schedule.values):
        if not ((row > parameter.lower) & (row < parameter.upper)).all():
            raise ModelError(f"{parameter.name} leaves its bounds ({parameter.lower}, {parameter.upper})")
