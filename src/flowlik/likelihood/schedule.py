"""Schedules: the look-up table theta(x; u) over an index of covariates (paper, Sec. II-F)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from flowlik.errors import ModelError
from flowlik.likelihood.covariates import covariate, of_components
from flowlik.likelihood.families.base import ErrorFamily
from flowlik.measurement.measurements import Measurements
from flowlik.support.arrays import Array

TEXTURE_RANGE = (float(np.log(1e-2)), float(np.log(1e5)))


@dataclass(frozen=True)
class Input:
    """A covariate as an index takes it: clipped to the range in which it was calibrated.

    Parameters
    ----------
    covariate : str
        Name in `flowlik.likelihood.covariates.COVARIATES`.
    low, high : float
        Range [the covariate's unit], low > 0.
    """

    covariate: str
    low: float
    high: float = np.inf


@dataclass(frozen=True)
class Term:
    """A weight times the product of one or two inputs' logarithms."""

    covariates: tuple[str, ...]
    weight: float = 1.0


@dataclass(frozen=True)
class Index:
    """The schedule's coordinate of a component, ``x = offset + sum_j weight_j prod_i ln c_ij``.

    The c are clipped covariates. The paper's schedule is the single term ln t.

    Attributes
    ----------
    inputs : tuple of Input
        Covariates and their ranges.
    terms : tuple of Term
        What is added up.
    offset : float
        Constant.
    low, high : float
        Range of x that sketches bin; values beyond are counted in the outer bins.

    Raises
    ------
    ModelError
        If a covariate is unknown, a term is not of the inputs, or weights or ranges are not sensible.
    """

    inputs: tuple[Input, ...] = (Input("texture", 1e-2),)
    terms: tuple[Term, ...] = (Term(("texture",)),)
    offset: float = 0.0
    low: float = TEXTURE_RANGE[0]
    high: float = TEXTURE_RANGE[1]

    def __post_init__(self) -> None:
        names = self.covariates
        for name in names:
            covariate(name)
        unknown = {name for term in self.terms for name in term.covariates} - set(names)
        if unknown or len(set(names)) != len(names) or not self.terms:
            raise ModelError(
                f"an index needs terms of its inputs {list(names)}, each once; not {sorted(unknown)}"
            )
        ranges = all(0 < i.low < i.high for i in self.inputs) and self.low < self.high
        weights = np.array([self.offset, self.low, self.high, *(t.weight for t in self.terms)])
        if not ranges or not np.isfinite(weights).all():
            raise ModelError("an index needs finite weights and increasing, positive ranges")

    @property
    def name(self) -> str:
        """Short name in results: ``"texture"`` for the paper's, ``"flow"`` for VOLDOR's, else ``"index"``."""
        return self.covariates[0] if len(self.inputs) == 1 else "index"

    @property
    def covariates(self) -> tuple[str, ...]:
        """Names of the inputs."""
        return tuple(i.covariate for i in self.inputs)

    @property
    def signals(self) -> tuple[str, ...]:
        """Signals that must be measured for this index."""
        return tuple(sorted({s for name in self.covariates for s in covariate(name).signals}))

    def moved(self, shift: float, factor: float = 1.0) -> Index:
        """Index whose coordinate is ``shift + factor x``."""
        terms = tuple(Term(term.covariates, factor * term.weight) for term in self.terms)
        low, high = (shift + factor * end for end in (self.low, self.high))
        return Index(self.inputs, terms, shift + factor * self.offset, low, high)

    def of(self, m: Measurements) -> Array:
        """Coordinates x (N, 2) of the eigen-components of measurements.

        Raises
        ------
        ModelError
            If a signal that it needs was not measured.
        """
        held = {name: logarithm[:, None] for name, logarithm in self.isotropic(m).items()}
        values = {name: of_components(name, m) for name in self.covariates if name not in held}
        return np.asarray(np.broadcast_to(self.combine(values, held), (len(m), 2)))

    def along(self, m: Measurements, normal: Array, held: Mapping[str, Array] | None = None) -> Array:
        """Coordinates x (N,) of the error along unit vectors ``normal`` (N, 2) in {i}.

        ``held`` is what `isotropic` gave of these measurements: it saves time where many directions are asked
        for.

        Raises
        ------
        ModelError
            If a signal that it needs was not measured.
        """
        held = held or {}
        return self.combine(
            {n: covariate(n).along(m, normal) for n in self.covariates if n not in held}, held
        )

    def isotropic(self, m: Measurements) -> dict[str, Array]:
        """Logarithms (N,) of the clipped covariates that are the same along every direction.

        Raises
        ------
        ModelError
            If a signal that it needs was not measured.
        """
        any_direction = np.tile([1.0, 0.0], (len(m), 1))
        return {
            i.covariate: np.log(np.clip(covariate(i.covariate).along(m, any_direction), i.low, i.high))
            for i in self.inputs
            if covariate(i.covariate).isotropic
        }

    def combine(self, values: Mapping[str, Array], held: Mapping[str, Array] | None = None) -> Array:
        """Coordinates x (...) of covariates (...), by name, and of logarithms that are `held`."""
        logs = {
            i.covariate: np.log(np.clip(values[i.covariate], i.low, i.high))
            for i in self.inputs
            if i.covariate in values
        } | dict(held or {})
        x = np.full(np.broadcast_shapes(*(np.shape(logarithm) for logarithm in logs.values())), self.offset)
        for term in self.terms:
            product = logs[term.covariates[0]]
            for name in term.covariates[1:]:
                product = product * logs[name]
            x += term.weight * product
        return x


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

    Raises
    ------
    ModelError
        If knots do not increase, or the table does not fit them or is not finite.
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
        """``"constant"``, or the name of the index: ``"texture"`` is the paper's schedule."""
        return self.index.name if np.ptp(self.values, axis=1).any() else "constant"

    def theta(self, x: Array | float) -> Array:
        """Parameters (P, ...) at coordinates x (...)."""
        return np.stack([np.interp(x, self.knots, row) for row in self.values])

    def hats(self, x: Array) -> Array:
        """Interpolation weights (M, X) of the knots at x (X,)."""
        return hat_weights(self.knots, x)

    def outside(self, x: Array) -> float:
        """Share of coordinates beyond the outer knots, where the table was never calibrated."""
        return float(np.mean((x < self.knots[0]) | (x > self.knots[-1]))) if np.size(x) else 0.0


def hat_weights(knots: Array, x: Array) -> Array:
    """Interpolation weights (M, X) of knots (M,) at x (X,), constant beyond the outer ones."""
    return np.stack([np.interp(x, knots, row) for row in np.eye(len(knots))])


def check_values(family: ErrorFamily, schedule: Schedule) -> None:
    """Check that the table holds the family's parameters, within their bounds.

    Raises
    ------
    ModelError
        If it does not.
    """
    if len(schedule.values) != len(family.parameters):
        raise ModelError(
            f"family {family.name} has {len(family.parameters)} parameters, the table {len(schedule.values)}"
        )
    for parameter, row in zip(family.parameters, schedule.values):
        if not ((row > parameter.lower) & (row < parameter.upper)).all():
            raise ModelError(f"{parameter.name} leaves its bounds ({parameter.lower}, {parameter.upper})")


def index_values(index: Index) -> dict[str, Any]:
    """Plain JSON values of an index; an unlimited range has ``high`` null."""
    values = asdict(index)
    for row in values["inputs"]:
        row["high"] = row["high"] if np.isfinite(row["high"]) else None
    return values


def index_of_values(values: dict[str, Any]) -> Index:
    """Index of what `index_values` gave."""
    inputs = tuple(
        Input(v["covariate"], v["low"], np.inf if v["high"] is None else v["high"]) for v in values["inputs"]
    )
    terms = tuple(Term(tuple(v["covariates"]), v["weight"]) for v in values["terms"])
    return Index(inputs, terms, values["offset"], values["low"], values["high"])
