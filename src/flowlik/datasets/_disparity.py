"""Disparity on disk: portable float maps (.pfm) and compressed NumPy arrays (.npz)."""

from __future__ import annotations

import zipfile
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from flowlik.datasets._images import MAX_PIXELS
from flowlik.datasets._pfm import read_pfm
from flowlik.errors import DataError

Array = NDArray[np.float64]


def read_disparity(path: Path | str) -> Array:
    """Read a disparity map; its suffix (.pfm, .npz) names the format.

    Returns
    -------
    array (H, W)
        Disparity d [px]: a point at column u of the left image is at u - d in the right one; NaN where
        unknown (infinite or NaN in the file).

    Raises
    ------
    DataError
        If the suffix is another, or the file is missing, truncated or not of that format.
    """
    path = Path(path)
    readers = {".pfm": lambda path: read_pfm(path, 1), ".npz": _read_npz}
    if path.suffix.lower() not in readers:
        raise DataError(f"{path}: unknown disparity format, expected one of {', '.join(readers)}")
    if not path.is_file():
        raise DataError(f"{path}: no such disparity file")
    with np.errstate(invalid="ignore"):  # a signalling NaN is as unknown as any other
        values = readers[path.suffix.lower()](path).astype(np.float64)
    values[~np.isfinite(values)] = np.nan
    return values


def _read_npz(path: Path) -> NDArray:
    """The one array of the archive; its size is checked before it is unpacked."""
    try:
        with zipfile.ZipFile(path) as archive:
            members = archive.infolist()
            if len(members) != 1:
                raise DataError(f"{path}: {len(members)} arrays, but expected one (the disparity)")
            with archive.open(members[0]) as file:
                version = np.lib.format.read_magic(file)
                read_header = {
                    (1, 0): np.lib.format.read_array_header_1_0,
                    (2, 0): np.lib.format.read_array_header_2_0,
                }[version]
                shape, by_columns, dtype = read_header(file)
                if dtype.kind != "f" or len(shape) != 2 or min(shape) < 1 or shape[0] * shape[1] > MAX_PIXELS:
                    raise DataError(f"{path}: an array {shape} of {dtype}, but expected (H, W) of floats")
                size = shape[0] * shape[1] * dtype.itemsize
                data = file.read(size + 1)
    except DataError:
        raise
    except Exception as error:  # damaged archives make zipfile, its decoders and NumPy raise nearly anything
        raise DataError(f"{path}: not a readable .npz file (truncated or damaged)") from error
    if len(data) != size:
        raise DataError(f"{path}: truncated, or longer than an array {shape} of {dtype}")
    return np.frombuffer(data, dtype=dtype).reshape(shape, order="F" if by_columns else "C")
