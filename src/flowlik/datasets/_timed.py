"""Files listed with their times, as TUM RGB-D and EuRoC have them."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np

from flowlik.geometry.times import check_times, in_time_order
from flowlik.support.arrays import Array


class TimedFiles(NamedTuple):
    """Files of a list in time order.

    Attributes
    ----------
    times_s : array (N,)
        Times [s], increasing.
    files : list of Path
        Their files.
    notes : tuple of str
        How many rows were left out, if any.
    """

    times_s: Array
    files: list[Path]
    notes: tuple[str, ...]


def timed_files(times: list[float], files: list[Path], path: Path, lenient: bool) -> TimedFiles:
    """Put the rows of a list in time order.

    Parameters
    ----------
    times, files : list
        Of each row.
    path : Path
        The list, for errors.
    lenient : bool
        Rows may go back in time or be double: they are sorted, and of double ones the first is kept.

    Raises
    ------
    DataError
        If times are not finite, or do not increase where they must.
    """
    times_s = np.array(times)
    if not lenient:
        check_times(times_s, str(path))
        return TimedFiles(times_s, files, ())
    kept = in_time_order(times_s)
    return TimedFiles(times_s[kept], [files[i] for i in kept], left_out(path, len(times_s) - len(kept)))


def left_out(path: Path, rows: int) -> tuple[str, ...]:
    """What to tell of rows that were left out of a list, if any."""
    return (f"{path}: {rows} rows left out, whose time another row has",) if rows else ()
