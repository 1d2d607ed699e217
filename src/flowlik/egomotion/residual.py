"""What a problem of ego-motion must offer: errors at a motion, normal equations, and minimal samples."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from flowlik.likelihood.likelihood import FlowLikelihood
from flowlik.likelihood.schedule import Index
from flowlik.likelihood.tables import LikelihoodTables, normal_equations
from flowlik.measurement.measurements import Measurements
from flowlik.support.arrays import Array
from flowlik.support.threads import in_bands

# hypotheses that a thread takes at a time
SCORED_TOGETHER = 25
# a component whose bound is at most this wide [px] is known well
KNOWN_PX = 2.0

Bound = Callable[[Array], Array]
InliersOf = Callable[[Array], NDArray[np.bool_]]


class Linearised(NamedTuple):
    """Errors of a residual at a motion T (3, 4), looked up once.

    Attributes
    ----------
    T : array (3, 4)
        Motion.
    z : array (C,)
        Errors [px], those of a vector side by side; NaN where there is no image.
    J : array (C, 6)
        Their Jacobian by the left tangent.
    x : array (C,)
        Schedule coordinates.
    directions : array (C, 2)
        Unit vectors in {i} along which the errors are.
    basis : array (6, D)
        Observable directions of the tangent, orthonormal.
    """

    T: Array
    z: Array
    J: Array
    x: Array
    directions: Array
    basis: Array


class Weighting(NamedTuple):
    """How a likelihood's components enter an estimate.

    Attributes
    ----------
    tables : LikelihoodTables
        Times the composite weight.
    weight : callable
        Composite weight (C,) of components at coordinates x (C,).
    widest_px : float
        Widest bound [px] of a component that counts: one near any motion at all is no witness of it.
    """

    tables: LikelihoodTables
    weight: Callable[[Array], Array]
    widest_px: float


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
    def of(
        cls, likelihood: FlowLikelihood, weighting: Weighting, x: Array, used: NDArray[np.bool_]
    ) -> Chosen:
        """Components at coordinates x (C,), of which some are used."""
        tables = weighting.tables
        return cls(used, tables.rows(x), likelihood.fisher(x) * weighting.weight(x), tables)


class Equations(NamedTuple):
    """Normal equations at a motion.

    Attributes
    ----------
    H : array (6, 6)
        Information.
    b : array (6,)
        Gradient of the log-density.
    log_prob : float
        Log-density [nat].
    lost : int
        Components without an image.
    basis : array (6, D)
        Observable directions of the tangent.
    """

    H: Array
    b: Array
    log_prob: float
    lost: int
    basis: Array


class Residual(Protocol):
    """A problem of ego-motion. Motions are (3, 4) matrices ``[R | t]`` of ``T_k_prev``."""

    @property
    def metric(self) -> bool:
        """Whether the translation has a scale."""
        ...

    @property
    def measurements(self) -> Measurements:
        """Flow vectors in use."""
        ...

    @property
    def excluded(self) -> dict[str, int]:
        """Flow vectors left out, by reason."""
        ...

    @property
    def sampling(self) -> Sampling:
        """Minimal samples of the vectors and the motions through them."""
        ...

    def at(self, T: Array, index: Index) -> Linearised:
        """Errors at a motion."""
        ...

    def equations(self, T: Array, chosen: Chosen, widened: float = 1.0) -> Equations:
        """Normal equations of the chosen components, errors taken to be `widened` times as wide."""
        ...

    def total_scores(self, motions: Array, chosen: Chosen, bounds: Array) -> Array:
        """Gradients (K, 6) at motions (K, 3, 4) of the log-density of the chosen within bounds (C,) [px]."""
        ...

    def retract(self, T: Array, step: Array) -> Array:
        """Motion after a step (6,) along the tangent, what is unobservable set by convention."""
        ...


class Sampling(Protocol):
    """Minimal samples of a residual: what they propose, and how many components support that.

    A hypothesis is what a minimal sample gives: a motion (3, 4), or what several motions share.
    """

    @property
    def minimal(self) -> int:
        """Vectors of a minimal sample."""
        ...

    def among(self, which: NDArray[np.bool_]) -> Residual:
        """Return the residual of some of the vectors (N,) alone."""
        ...

    def coordinates(self, index: Index) -> Array:
        """Schedule coordinates x (N, 2) of the vectors' eigen-components."""
        ...

    def propose(self, samples: NDArray[np.intp], start: Array) -> Array:
        """Hypotheses (M, ...) of samples (K, minimal) of vectors."""
        ...

    def components(self, kept: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Which components (C,) a gate on eigen-components (N, 2) keeps."""
        ...

    def bounds(self, bound: Bound, index: Index) -> Array:
        """Bounds (C, A) [px] of the components, each at A directions."""
        ...

    def support(self, hypotheses: Array, bounds: Array, by_vector: bool) -> NDArray[np.int64]:
        """Inliers (M,) of each hypothesis, components or vectors; a bound of -1 leaves a component out."""
        ...

    def resolve(self, hypothesis: Array, inliers_of: InliersOf) -> Array:
        """Of a hypothesis' motions the likeliest; of a motion (3, 4), those with the same errors."""
        ...


def check_serves(likelihood: FlowLikelihood, residual: Residual) -> None:
    """Check that a likelihood is of the residual's vectors, and of its errors.

    Raises
    ------
    ModelError
        If it belongs to another flow method or texture definition, or tells nothing of errors along epipolar
        lines, which known depth has.
    """
    likelihood.check(residual.measurements)
    if residual.metric:
        likelihood.check_components()


def weighting(residual: Residual, likelihood: FlowLikelihood) -> Weighting:
    """How a residual's components enter an estimate.

    With known depth each counts by its composite weight. The power of that is calibrated on whole vectors, of
    which an epipolar error is the part across its line: without depth components count alike, but only
    those known well (docs/decisions.md).
    """
    if residual.metric:
        return Weighting(likelihood.composite, likelihood.composite_weight, np.inf)
    return Weighting(likelihood.compiled, np.ones_like, KNOWN_PX)


def equations_of(z: Array, J: Array, basis: Array, chosen: Chosen, widened: float = 1.0) -> Equations:
    """Normal equations of linearised errors z (C,), J (C, 6)."""
    if widened != 1.0:
        z, J = z / widened, J / widened
    usable = chosen.used & np.isfinite(z)
    H, b, log_prob = normal_equations(
        z, J, chosen.rows, chosen.fisher, usable, chosen.tables.log_prob, chosen.tables.weight
    )
    return Equations(H, b, log_prob, int(chosen.used.sum() - usable.sum()), basis)


def count_support(kernel: Callable[..., None], inputs: tuple[Any, ...], hypotheses: int) -> NDArray[np.int64]:
    """Inliers of hypotheses (M,) by a counting kernel, in bands on threads."""
    counts = np.zeros(hypotheses, np.int64)
    in_bands(lambda first, last: kernel(*inputs, first, last, counts), hypotheses, SCORED_TOGETHER)
    return counts
