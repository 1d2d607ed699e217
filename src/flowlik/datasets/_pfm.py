"""Portable float maps (.pfm): disparity in one channel, flow in three."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from flowlik.datasets._images import MAX_PIXELS
from flowlik.errors import DataError

_HEADER = re.compile(rb"P([Ff])\s+(\d{1,9})\s+(\d{1,9})\s+(-?\d[0-9.eE+-]{0,30})\s")


def read_pfm(path: Path, channels: int) -> NDArray[np.floating]:
    """Values of a .pfm file of float32: rows run from bottom to top, a negative scale says little-endian.

    Parameters
    ----------
    path : Path
        File.
    channels : {1, 3}
        What is expected.

    Returns
    -------
    float32 array (H, W), or (H, W, 3)
        In the file's byte order, the first row at the top.

    Raises
    ------
    DataError
        If it is not such a file, has other channels, or is truncated.
    """
    try:
        with path.open("rb") as file:
            header = _HEADER.match(file.read(100))
    except OSError as error:
        raise DataError(f"{path}: cannot be read ({error.strerror})") from error
    letters = {1: "Pf", 3: "PF"}[channels]
    if header is None or (header[1] == b"F") != (channels == 3):
        count = {1: "one channel", 3: "three channels"}[channels]
        expected = f"{letters}, width, height, scale"
        raise DataError(f"{path}: not a .pfm file of {count} (it must begin with {expected})")
    width, height = int(header[2]), int(header[3])
    try:
        scale = float(header[4])
    except ValueError:
        scale = 0.0
    if scale == 0 or not 0 < width * height <= MAX_PIXELS:
        raise DataError(f"{path}: impossible header {width} x {height}, scale {header[4].decode()}")
    size, found = header.end() + 4 * channels * width * height, path.stat().st_size
    if found != size:
        raise DataError(f"{path}: {found} bytes, but {width} x {height} values take {size} (truncated?)")
    values = np.fromfile(path, dtype="<f4" if scale < 0 else ">f4", offset=header.end())
    return values.reshape((height, width) if channels == 1 else (height, width, channels))[::-1]
