"""ErrorSketch: mergeable counts of error components, small enough to forget the samples."""

from __future__ import annotations

import io
import json
from collections.abc import Iterable
from dataclasses import asdict, dataclass, field
from functools import reduce
from pathlib import Path

import numpy as np
from numba import njit
from numpy.typing import NDArray

from flowlik.camera import Array
from flowlik.errors import CalibrationError, DataError
from flowlik.files import atomic_write
from flowlik.schedule import Index, Term
from flowlik.tables import Z_NODES, magnitude_nodes, magnitude_position

BINS_PER_LEVEL = 4
LEVELS_PER_DECADE = 8
FIRST_DECADE, LAST_DECADE = -2, 5
X_BINS = (LAST_DECADE - FIRST_DECADE) * LEVELS_PER_DECADE * BINS_PER_LEVEL
Z_BINS = Z_NODES - 1
RESERVOIR_ROWS = 20_000


def x_edges() -> Array:
    """Edges (X + 1,) of the bins of x: 32 a decade of exp(x), from 1e-2 to 1e5."""
    return np.log(10) * np.linspace(FIRST_DECADE, LAST_DECADE, X_BINS + 1)


def bin_centres() -> Array:
    """Centres (X,) of the bins of x."""
    return 0.5 * (x_edges()[1:] + x_edges()[:-1])


def magnitude_centres() -> Array:
    """Representative abs(z) (Z,) [px] of each error bin; the first bin reaches down to 0."""
    edges = magnitude_nodes()
    edges[0] /= 2
    return np.sqrt(edges[:-1] * edges[1:])


@njit(cache=True)
def _count(x, z, sign, first, inverse_step, counts):  # type: ignore[no-untyped-def]
    for i in range(len(z)):
        row = min(max(int((x[i] - first) * inverse_step), 0), counts.shape[0] - 1)
        column, _ = magnitude_position(abs(z[i]))
        counts[row, 0 if z[i] * sign[i] < 0 else 1, column] += 1


@dataclass(frozen=True, eq=False)
class ErrorSketch:
    """Counts of signed errors over the schedule's coordinate, and a reservoir of raw rows.

    Merging is associative and commutative and counts are integers, so any order gives the same sketch.

    Attributes
    ----------
    index : Index
        What x is.
    counts : int64 array (X, 2, Z)
        Components by bin of x, sign of ``s z`` (0: negative, the flow falls short) and bin of abs(z).
        Values beyond the outer bins are counted in them.
    frames : int64 array (X,)
        Image pairs that have a component in each bin of x.
    pairs : int
        Image pairs.
    keys : array (K,)
        Random key of each reservoir row; a merge keeps the rows of smallest keys.
    rows : array (K, C + 1)
        Covariates of the index's terms and ``s z`` [px] of a random choice of components.
    excluded : dict
        Counts of pixels left out, by reason.
    """

    index: Index
    counts: NDArray[np.int64]
    frames: NDArray[np.int64]
    pairs: int
    keys: Array
    rows: Array
    excluded: dict[str, int] = field(default_factory=dict)

    @classmethod
    def empty(cls, index: Index) -> ErrorSketch:
        """Sketch of nothing."""
        counts = np.zeros((X_BINS, 2, Z_BINS), np.int64)
        rows = np.empty((0, len(index.terms) + 1))
        return cls(index, counts, np.zeros(X_BINS, np.int64), 0, np.empty(0), rows)

    @classmethod
    def of(
        cls,
        index: Index,
        covariates: dict[str, Array],
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
        covariates : dict of str to array (...)
            Covariates of each component.
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
            If an error or a coordinate is not finite.
        """
        x, z, sign = index.of(covariates).ravel(), np.ravel(z), np.ravel(sign)
        if not (np.isfinite(z).all() and np.isfinite(x).all()):
            raise CalibrationError("errors and covariates to be sketched must be finite")
        sketch = cls.empty(index)
        edges = x_edges()
        _count(x, z, sign, edges[0], 1 / (edges[1] - edges[0]), sketch.counts)
        keys = rng.random(len(z))
        chosen = _smallest(keys)
        columns = [np.ravel(covariates[term.covariate])[chosen] for term in index.terms]
        rows = np.stack([*columns, (z * sign)[chosen]], axis=-1)
        frames = (sketch.counts.sum(axis=(1, 2)) > 0).astype(np.int64)
        return cls(index, sketch.counts, frames, 1, keys[chosen], rows, dict(excluded or {}))

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
            If the two are over different indices.
        """
        if self.index != other.index:
            raise CalibrationError("cannot merge sketches over different indices")
        keys = np.concatenate([self.keys, other.keys])
        rows = np.concatenate([self.rows, other.rows])
        chosen = _smallest(keys)
        reasons = self.excluded.keys() | other.excluded.keys()
        excluded = {r: self.excluded.get(r, 0) + other.excluded.get(r, 0) for r in sorted(reasons)}
        return ErrorSketch(
            self.index,
            self.counts + other.counts,
            self.frames + other.frames,
            self.pairs + other.pairs,
            keys[chosen],
            rows[chosen],
            excluded,
        )

    def save(self, path: Path | str) -> None:
        """Write the sketch as a compressed .npz, atomically."""
        header = {"index": asdict(self.index), "pairs": self.pairs, "excluded": self.excluded}
        with atomic_write(Path(path), "wb") as file:
            np.savez_compressed(
                file, header=json.dumps(header), counts=self.counts, frames=self.frames, keys=self.keys,
                rows=self.rows,
            )  # fmt: skip

    @classmethod
    def load(cls, path: Path | str) -> ErrorSketch:
        """Read a sketch.

        Raises
        ------
        DataError
            If the file is missing, damaged, or has other bins.
        """
        path = Path(path)
        try:
            with np.load(io.BytesIO(path.read_bytes()), allow_pickle=False) as data:
                header = json.loads(str(data["header"]))
                index = Index(tuple(Term(**term) for term in header["index"]["terms"]))
                sketch = cls(
                    index, data["counts"], data["frames"], int(header["pairs"]), data["keys"], data["rows"],
                    {str(k): int(v) for k, v in header["excluded"].items()},
                )  # fmt: skip
        except OSError as error:
            raise DataError(f"{path}: cannot read the sketch ({error.strerror or error})") from None
        except Exception as error:  # zip, zlib and numpy's parser of headers raise a dozen kinds
            reason = " ".join(str(error).split())
            raise DataError(f"{path}: not a flowlik sketch ({reason})") from None
        if sketch.counts.shape != (X_BINS, 2, Z_BINS) or sketch.counts.dtype != np.int64:
            raise DataError(f"{path}: a sketch with other bins, {sketch.counts.shape}; sketch the data again")
        return sketch


def merge_all(sketches: Iterable[ErrorSketch], index: Index) -> ErrorSketch:
    """Merge any number of sketches, in any order."""
    return reduce(ErrorSketch.merge, sketches, ErrorSketch.empty(index))


def _smallest(keys: Array) -> NDArray[np.intp]:
    """Order of the smallest keys, so that equal sets give equal reservoirs."""
    if len(keys) > RESERVOIR_ROWS:
        candidates = np.argpartition(keys, RESERVOIR_ROWS)[:RESERVOIR_ROWS]
        return candidates[np.argsort(keys[candidates])]
    return np.argsort(keys)
