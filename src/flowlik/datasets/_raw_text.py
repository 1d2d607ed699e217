"""Text files of KITTI raw: rows of its calibration, and its time stamps."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flowlik.errors import DataError
from flowlik.support.arrays import Array
from flowlik.support.files import numbers, read_text


def calibration_row(path: Path, name: str, count: int) -> Array:
    """Numbers (count,) of a row such as ``R: …`` of a calibration file.

    Raises
    ------
    DataError
        If there is no such file or row, or it has another count of numbers.
    """
    for line in read_text(path).splitlines():
        key, colon, values = line.partition(":")
        if colon and key.strip() == name:
            found = numbers(values.split(), f"{path}, row {name}")
            if len(found) != count:
                raise DataError(f"{path}, row {name}: {len(found)} numbers, but expected {count}")
            return np.array(found)
    raise DataError(f"{path}: no row {name}")


def read_stamps(path: Path) -> NDArray[Any]:
    """Time stamps (N,) of a ``timestamps.txt``, as ``datetime64[ns]``.

    Raises
    ------
    DataError
        If there is no such file, or a line of it is no time.
    """
    try:
        return np.array([np.datetime64(line.strip(), "ns") for line in read_text(path).split("\n") if line])
    except ValueError as error:
        raise DataError(f"{path}: not times such as '2011-09-26 13:02:25.964389445' ({error})") from error
