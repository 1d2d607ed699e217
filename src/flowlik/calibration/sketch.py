"""ErrorSketch: mergeable counts of error components, small enough to forget the samples."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from functools import reduce

import numpy as np
from numpy.typing import NDArray

from flowlik.calibration._kernels import count
from flowlik.errors import CalibrationError
from flowlik.likelihood.schedule import TEXTURE_RANGE, Index
from flowlik.likelihood.tables import Z_NODES, magnitude_nodes
from flowlik.support.arrays import Array

X_BINS = 224
LEVELS = 56
"""Texture levels of K-S: 8 a decade, 1e-2 to 1e5."""

Z_BINS = Z_NODES - 1
RESERVOIR_ROWS = 20_000
# decimals of a row's error [px]: the last bits, which differ between processes, would not let a fit end alike
ROUNDED_TO = 6
PIECE = 1 << 14


def x_edges(index: Index) -> Array:
    """Edges (X + 1,) of the bins of x; for the paper's index 32 a decade of texture."""
    return np.linspace(index.low, index.high, X_BINS + 1)


def bin_centres(index: Index) -> Array:
    """Centres (X,) of the bins of x."""
    edges = x_edges(index)
    return 0.5 * (edges[1:] + edges[:-1])


def level_edges() -> Array:
    """Edges (L + 1,) of the texture levels [intensity^2/px^2]."""
    return np.exp(np.linspace(*TEXTURE_RANGE, LEVELS + 1))


def level_centres() -> Array:
    """Centres (L,) of the texture levels [intensity^2/px^2]."""
    edges = level_edges()
    return np.sqrt(edges[1:] * edges[:-1])


def magnitude_centres() -> Array:
    """Representative abs(z) (Z,) [px] of each error bin; the first bin reaches down to 0."""
    edges = magnitude_nodes()
    edges[0] /= 2
    return np.sqrt(edges[:-1] * edges[1:])


@dataclass(frozen=True, eq=False)
class ErrorSketch:
    """Counts of signed errors over the schedule's coordinate and over texture, and a reservoir of raw rows.

    Merging is associative and commutative and counts are integers, so any order gives the same sketch.

    Attributes
    ----------
    index : Index
        What x is.
    counts : int64 array (X, 2, Z)
        Components by bin of x, sign of ``s z`` (0: negative, the flow falls short) and bin of abs(z).
        Values beyond the outer bins are counted in them.
    by_level : int64 array (L, X)
        Components by texture level and bin of x: what a model predicts at a level.
    errors : int64 array (L, 2, Z)
        Components by texture level, sign and bin of abs(z): what was found there.
    frames : int64 array (L,)
        Image pairs that have a component at each level.
    pairs : int
        Image pairs.
    columns : tuple of str
        Covariates in the rows.
    keys : array (K,)
        Random key of each reservoir row; a merge keeps the rows of smallest keys.
    rows : array (K, C + 1)
        Covariates and ``s z`` [px], to 1e-6 px, of a random choice of components.
    excluded : dict
        Counts of pixels left out, by reason.
    """

    index: Index
    counts: NDArray[np.int64]
    by_level: NDArray[np.int64]
    errors: NDArray[np.int64]
    frames: NDArray[np.int64]
    pairs: int
    columns: tuple[str, ...]
    keys: Array
    rows: Array
    excluded: dict[str, int] = field(default_factory=dict)

    @classmethod
    def empty(cls, index: Index, columns: tuple[str, ...] = ("texture",)) -> ErrorSketch:
        """Sketch of nothing, whose rows have the given covariates."""
        shapes = ((X_BINS, 2, Z_BINS), (LEVELS, X_BINS), (LEVELS, 2, Z_BINS), (LEVELS,))
        counts, by_level, errors, frames = (np.zeros(shape, np.int64) for shape in shapes)
        rows = np.empty((0, len(columns) + 1))
        return cls(index, counts, by_level, errors, frames, 0, columns, np.empty(0), rows)

    @classmethod
    def of(
        cls,
        index: Index,
        covariates: Mapping[str, Array],
        z: Array,
        sign: Array,
        rng: np.random.Generator,
        excluded: dict[str, int] | None = None,
    ) -> ErrorSketch:
        """Sketch of one image pair.

        Parameters
        ----------
        index : Index
            Schedule coordinate.
        covariates : mapping of str to array (...)
            Covariates of each component: texture, those of the index, and what the reservoir shall keep.
        z : array (...)
            Error components [px].
        sign : array (...)
            Sign of the measured flow's component, +1 at 0.
        rng : numpy.random.Generator
            Draws the reservoir's keys; seed it by pair, so that order does not matter.
        excluded : dict, optional
            Pixels left out, by reason.

        Raises
        ------
        CalibrationError
            If an error or a texture is not finite, or another covariate is NaN.
        """
        z, sign = np.ravel(z), np.ravel(sign)
        values = {name: np.ravel(covariate) for name, covariate in covariates.items()}
        if not (np.isfinite(z).all() and np.isfinite(values["texture"]).all()):
            raise CalibrationError("errors and textures to be sketched must be finite")
        if any(np.isnan(column).any() for column in values.values()):
            raise CalibrationError("a covariate to be sketched is NaN")
        sketch = cls.empty(index, tuple(values))
        keys = rng.random(len(z))
        chosen = _smallest(keys)
        short = z[chosen] * sign[chosen]
        rows = np.stack(
            [*(column[chosen] for column in values.values()), np.round(short, ROUNDED_TO)], axis=-1
        )
        sketch._count(values, z, sign)
        frames = (sketch.by_level.sum(axis=1) > 0).astype(np.int64)
        return cls(
            index, sketch.counts, sketch.by_level, sketch.errors, frames, 1, sketch.columns, keys[chosen],
            rows, dict(excluded or {}),
        )  # fmt: skip

    def over(self, index: Index) -> ErrorSketch:
        """Sketch of this one's reservoir over another index of the covariates that it keeps.

        Its counts are those of a random choice of components. Image pairs and what was left out are the
        whole sketch's.
        """
        sketch = ErrorSketch.empty(index, self.columns)
        values = dict(zip(self.columns, np.ascontiguousarray(self.rows.T[:-1])))
        sketch._count(values, self.rows[:, -1].copy(), np.ones(len(self.rows)))
        return ErrorSketch(
            index, sketch.counts, sketch.by_level, sketch.errors, self.frames, self.pairs, self.columns,
            self.keys, self.rows, self.excluded,
        )  # fmt: skip

    def _count(self, values: Mapping[str, Array], z: Array, sign: Array) -> None:
        index, (low, high) = self.index, TEXTURE_RANGE
        plain = index == Index()
        # pieces whose logarithms stay in the cache
        for first in range(0, len(z), PIECE):
            piece = slice(first, first + PIECE)
            ln_t = np.log(np.maximum(values["texture"][piece], 1e-12))
            x = ln_t if plain else index.combine({name: values[name][piece] for name in index.covariates})
            count(
                x, ln_t, z[piece], sign[piece], index.low, X_BINS / (index.high - index.low),
                low, LEVELS / (high - low), self.counts, self.by_level, self.errors,
            )  # fmt: skip

    @property
    def magnitude_counts(self) -> NDArray[np.int64]:
        """Counts (X, Z) of abs(z)."""
        return self.counts.sum(axis=1)

    @property
    def total(self) -> int:
        """Number of components."""
        return int(self.counts.sum())

    def merge(self, other: ErrorSketch) -> ErrorSketch:
        """Sketch of both populations.

        Raises
        ------
        CalibrationError
            If the two are over different indices or keep different covariates.
        """
        if self.index != other.index or self.columns != other.columns:
            raise CalibrationError("cannot merge sketches over different indices or covariates")
        keys = np.concatenate([self.keys, other.keys])
        rows = np.concatenate([self.rows, other.rows])
        chosen = _smallest(keys)
        reasons = self.excluded.keys() | other.excluded.keys()
        excluded = {r: self.excluded.get(r, 0) + other.excluded.get(r, 0) for r in sorted(reasons)}
        return ErrorSketch(
            self.index,
            self.counts + other.counts,
            self.by_level + other.by_level,
            self.errors + other.errors,
            self.frames + other.frames,
            self.pairs + other.pairs,
            self.columns,
            keys[chosen],
            rows[chosen],
            excluded,
        )


def merge_all(sketches: Iterable[ErrorSketch]) -> ErrorSketch:
    """Merge one or more sketches, in any order."""
    return reduce(ErrorSketch.merge, sketches)


def _smallest(keys: Array) -> NDArray[np.intp]:
    """Order of the smallest keys, so that equal sets give equal reservoirs."""
    # of uniform keys these hold the smallest, but for a chance of 1e-100
    candidates = np.flatnonzero(keys < 1.2 * RESERVOIR_ROWS / max(len(keys), 1))
    if len(candidates) < min(len(keys), RESERVOIR_ROWS):
        candidates = np.arange(len(keys))
    return candidates[np.argsort(keys[candidates])[:RESERVOIR_ROWS]]
