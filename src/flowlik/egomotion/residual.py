"""The Residual protocol: what turns a motion into error components (z, J, x) for a likelihood."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, ClassVar, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from flowlik.likelihood.likelihood import FlowLikelihood
from flowlik.likelihood.schedule import Index
from flowlik.likelihood.tables import LikelihoodTables, normal_equations
from flowlik.measurement.measurements import Measurements
from flowlik.support.arrays import Array
from flowlik.support.threads import in_bands

SCORED_TOGETHER = 25

Bound = Callable[[Array], Array]
InliersOf = Callable[[Array], NDArray[np.bool_]]


class Chosen(NamedTuple):
    """Components of a maximisation and what the likelihood says of them, their coordinates held.

    ``used`` (C,) tells which enter; ``rows`` (C,) are their rows in the tables, ``fisher`` (C,) [1/px^2]
    their information, both times the composite weight.
    """

    used: NDArray[np.bool_]
    rows: Array
    fisher: Array
    tables: LikelihoodTables

    @classmethod
    def of(cls, residual: Residual, likelihood: FlowLikelihood, x: Array, used: NDArray[np.bool_]) -> Chosen:
        """Components of a residual at coordinates x (C,), of which some are used."""
        tables = likelihood.composite if residual.metric else likelihood.compiled
        return cls(
            used, tables.rows(x), likelihood.fisher(x) * composite_weight(residual, likelihood, x), tables
        )


class Equations(NamedTuple):
    """Information H (6, 6), gradient b (6,), log-density [nat], and components without an image."""

    H: Array
    b: Array
    log_prob: float
    lost: int


class Residual(Protocol):
    """The four steps of an estimator need this much of a problem.

    Motions are (3, 4) matrices ``[R | t]`` of ``T_k_prev``. A hypothesis is what a minimal sample gives:
    a motion for known depth, an essential matrix for the epipolar residual.
    """

    minimal: ClassVar[int]
    components_per_vector: ClassVar[int]
    metric: ClassVar[bool]
    counted_px: ClassVar[float]
    """Widest bound [px] of a component that counts: one near any motion at all is no witness of it."""

    @property
    def measurements(self) -> Measurements:
        """Flow vectors in use."""
        ...

    @property
    def excluded(self) -> dict[str, int]:
        """Flow vectors left out, by reason."""
        ...

    def __len__(self) -> int:
        """Return the number of flow vectors."""
        ...

    def linearise(self, T: Array) -> tuple[Array, Array]:
        """Errors z (C,) [px] and their Jacobian (C, 6) at a motion; NaN errors where there is no image."""
        ...

    def coordinates(self, T: Array, index: Index) -> Array:
        """Schedule coordinates x (C,) of the errors at a motion."""
        ...

    def eigen_coordinates(self, index: Index) -> Array:
        """Schedule coordinates x (N, 2) of the vectors' eigen-components."""
        ...

    def equations(self, T: Array, chosen: Chosen, widened: float = 1.0) -> Equations:
        """Normal equations of the chosen components, errors taken to be `widened` times as wide."""
        ...

    def total_score(self, T: Array, chosen: Chosen, bounds: Array) -> Array:
        """Gradient (6,) of the log-density of the chosen components within their bounds (C,) [px]."""
        ...

    def directions(self, T: Array) -> Array:
        """Unit vectors (C, 2) in {i} along which the errors are, those of one vector side by side."""
        ...

    def basis(self, T: Array) -> Array:
        """Observable directions (6, D) of the tangent at a motion."""
        ...

    def propose(self, samples: NDArray[np.intp], start: Array) -> Array:
        """Hypotheses (M, ...) of minimal samples (K, minimal) of vectors."""
        ...

    def hypothesis(self, T: Array) -> Array:
        """Hypothesis that stands for a motion (3, 4)."""
        ...

    def bounds(self, bound: Bound, index: Index, kept: NDArray[np.bool_]) -> Array:
        """Bounds [px] in the form `score` takes; components not in ``kept`` (N, 2) are left out."""
        ...

    def score(self, hypotheses: Array, bounds: Array, by_vector: bool) -> NDArray[np.int64]:
        """Inliers of each hypothesis."""
        ...

    def motion(self, hypothesis: Array, inliers_of: InliersOf) -> tuple[Array, bool]:
        """Motion (3, 4) that a hypothesis stands for, and whether another explains the data as well."""
        ...

    def still(self) -> bool:
        """Whether nothing moves, so that the residual says nothing about a motion."""
        ...

    def rotation_share(self, T: Array, bound: Bound, index: Index) -> float:
        """Share of eigen-components that the motion's rotation alone explains within their bounds."""
        ...

    def kept_components(self, kept: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Which components (C,) a gate on eigen-components (N, 2) keeps."""
        ...

    def normalise(self, T: Array) -> Array:
        """Return the motion with what is unobservable set by convention."""
        ...


def composite_weight(residual: Residual, likelihood: FlowLikelihood, x: Array) -> Array:
    """Weight (C,) of each component's log-density in an estimate.

    Without depth it is 1: the emphasis is calibrated on whole vectors, of which an epipolar error
    is the part across its line (docs/decisions.md).
    """
    return likelihood.composite_weight(x) if residual.metric else np.ones(len(x))


def equations_of(z: Array, J: Array, chosen: Chosen, widened: float) -> Equations:
    """Normal equations of linearised errors."""
    if widened != 1.0:
        z, J = z / widened, J / widened
    usable = chosen.used & np.isfinite(z)
    H, b, log_prob = normal_equations(
        z, J, chosen.rows, chosen.fisher, usable, chosen.tables.log_prob, chosen.tables.weight
    )
    return Equations(H, b, log_prob, int(chosen.used.sum() - usable.sum()))


def count_inliers(kernel: Callable[..., None], inputs: tuple[Any, ...], hypotheses: int) -> NDArray[np.int64]:
    """Inliers of hypotheses (K,) by a scoring kernel, in bands on threads."""
    counts = np.zeros(hypotheses, np.int64)
    in_bands(lambda first, last: kernel(*inputs, first, last, counts), hypotheses, SCORED_TOGETHER)
    return counts


def draw_samples(weights: Array, count: int, size: int, rng: np.random.Generator) -> NDArray[np.intp]:
    """Samples (K, size) of distinct vectors, K <= count: those that repeat a vector are dropped."""
    cumulated = np.cumsum(weights)
    drawn = np.searchsorted(cumulated, rng.random((count, size)) * cumulated[-1], side="right")
    drawn = np.sort(np.minimum(drawn, len(weights) - 1), axis=1)
    distinct = drawn[(np.diff(drawn, axis=1) > 0).all(axis=1)]
    # a handful of vectors rarely gives a distinct draw
    return distinct if len(distinct) else rng.permutation(len(weights))[None, :size]
