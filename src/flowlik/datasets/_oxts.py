"""KITTI raw's OXTS files: rows of the GPS and inertial unit, with their times."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from flowlik.datasets._raw_text import read_stamps
from flowlik.errors import DataError
from flowlik.geometry.times import check_times
from flowlik.support.arrays import Array
from flowlik.support.files import read_table

OXTS_COLUMNS = 30
POSITION, FORCE, RATE = slice(0, 3), slice(11, 14), slice(17, 20)
"""Latitude, longitude [deg], altitude [m]; force [m/s²] and rate [rad/s], x forward, y left, z up."""
ACCURACY = 23
"""Standard deviation of a position [m]."""


def is_oxts(path: Path) -> bool:
    """Whether a folder is a drive of KITTI raw with OXTS, or its ``oxts``."""
    return (_folder(path) / "data").is_dir() and any((_folder(path) / "data").glob("*.txt"))


def read_oxts(path: Path) -> tuple[Array, Array]:
    """Times (N,) [s] from the first row on, and rows (N, 30).

    Raises
    ------
    DataError
        If a row is malformed, ``timestamps.txt`` is missing or has another number of times, or times do not
        increase.
    """
    folder = _folder(path)
    layout = f"{OXTS_COLUMNS} numbers (KITTI OXTS: lat lon alt roll pitch yaw …)"
    files = sorted((folder / "data").glob("*.txt"))
    rows = np.array([read_table(file, OXTS_COLUMNS, layout)[0][0] for file in files])
    stamps = read_stamps(folder / "timestamps.txt")
    times_s = np.asarray((stamps - stamps[:1]).astype(np.int64) / 1e9, dtype=np.float64)
    if len(times_s) != len(rows):
        raise DataError(f"{folder}: {len(rows)} rows of OXTS, but {len(times_s)} times in timestamps.txt")
    check_times(times_s, str(folder / "timestamps.txt"))
    return times_s, rows


def _folder(path: Path) -> Path:
    return path / "oxts" if (path / "oxts").is_dir() else path
