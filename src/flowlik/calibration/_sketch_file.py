"""Sketches on disk: compressed .npz, written whole or not at all."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from flowlik.calibration.sketch import ErrorSketch
from flowlik.errors import DataError
from flowlik.likelihood.schedule import index_of_values, index_values
from flowlik.support.files import read_npz, write_npz

LAYOUT = 1
"""Number of what sketches count and how they are kept; one more makes saved ones of older code unusable."""

ARRAYS = ("counts", "by_level", "errors", "frames", "keys", "rows")


def save_sketch(sketch: ErrorSketch, path: Path | str) -> None:
    """Write a sketch, atomically.

    Raises
    ------
    DataError
        If the place cannot be written to.
    """
    header = {
        "index": index_values(sketch.index), "pairs": sketch.pairs, "columns": sketch.columns,
        "excluded": sketch.excluded,
    }  # fmt: skip
    write_npz(path, {"header": json.dumps(header), **{name: getattr(sketch, name) for name in ARRAYS}})


def load_sketch(path: Path | str) -> ErrorSketch:
    """Read a sketch.

    Raises
    ------
    DataError
        If the file is missing, damaged, or has other bins.
    """
    path = Path(path)
    if not path.is_file():
        raise DataError(f"{path}: cannot read the sketch (no such file)")
    try:
        data: Any = read_npz(path)
        header = json.loads(str(data["header"]))
        sketch = ErrorSketch(
            index=index_of_values(header["index"]),
            pairs=int(header["pairs"]),
            columns=tuple(str(name) for name in header["columns"]),
            excluded={str(k): int(v) for k, v in header["excluded"].items()},
            **{name: data[name] for name in ARRAYS},
        )
    except Exception as error:  # of a header, anything may be missing or of another type
        reason = " ".join(str(error).split())
        raise DataError(f"{path}: not a flowlik sketch ({reason})") from None
    empty = ErrorSketch.empty(sketch.index, sketch.columns)
    for name in ARRAYS:
        mine, other = getattr(empty, name), getattr(sketch, name)
        # the reservoir may have any length
        fits = mine.shape[1:] == other.shape[1:] if name in ("keys", "rows") else mine.shape == other.shape
        if not fits or mine.dtype != other.dtype or len(sketch.keys) != len(sketch.rows):
            raise DataError(
                f"{path}: a sketch with other bins, {name} is {other.shape}; sketch the data again"
            )
    return sketch
