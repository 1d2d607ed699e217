"""Reader of GPS positions in a table whose columns name their units and frame."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from flowlik.errors import DataError
from flowlik.geometry.times import check_times
from flowlik.support.arrays import Array
from flowlik.support.files import numbers, read_csv, read_text

GPS_COLUMNS = ("time_s", "x_n_m", "y_n_m", "z_n_m", "sigma_x_m", "sigma_y_m", "sigma_z_m")
"""Time [s], position [m] in {n} and its standard deviations [m]."""


@dataclass(frozen=True, eq=False)
class GpsFixes:
    """Positions that a GPS receiver told.

    Attributes
    ----------
    times_s : array (N,)
        Times [s], increasing.
    positions_n_m : array (N, 3)
        Positions [m] of the antenna in {n}.
    sigma_m : array (N, 3)
        Standard deviations [m] that the receiver claims, above 0.
    """

    times_s: Array
    positions_n_m: Array
    sigma_m: Array


def read_gps(path: Path | str) -> GpsFixes:
    """Read a table of GPS positions; its first row names the columns, in any order: `GPS_COLUMNS`.

    Parameters
    ----------
    path : Path or str
        The table, or a folder with ``gps0/data.csv``.

    Raises
    ------
    DataError
        If the file is missing or empty, columns are missing, unknown or double, a number is not finite, a
        standard deviation is not positive, or times do not increase.
    """
    path = Path(path)
    if path.is_dir():
        path = path / "gps0" / "data.csv"
    first = next((line for line in read_text(path).splitlines() if line.strip()), "")
    named = [word.strip() for word in first.lstrip("#").split(",")]
    if sorted(named) != sorted(GPS_COLUMNS):
        raise DataError(
            f"{path}: columns {', '.join(named) or 'none'}, but expected {', '.join(GPS_COLUMNS)}: "
            "units and frame stand in the names"
        )
    rows, places = [], []
    for where, words in read_csv(path, len(named), ", ".join(named)):
        if words == named:
            continue
        if len(words) != len(named):
            raise DataError(f"{where}: {len(words)} columns, but expected {len(named)}")
        rows.append(numbers(words, where))
        places.append(where)
    if not rows:
        raise DataError(f"{path}: no fix")
    table = np.array(rows)[:, [named.index(name) for name in GPS_COLUMNS]]
    not_positive = np.flatnonzero((table[:, 4:] <= 0).any(axis=1))
    if not_positive.size:
        raise DataError(f"{places[not_positive[0]]}: a standard deviation is not positive")
    check_times(table[:, 0], str(path))
    return GpsFixes(table[:, 0], table[:, 1:4], table[:, 4:])
