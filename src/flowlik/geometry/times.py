"""Times of frames: read, checked, put in order, and matched to one another."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from flowlik.errors import DataError
from flowlik.support.arrays import Array
from flowlik.support.files import read_table


def time_text(time_s: float) -> str:
    """Time [s] as text, with all digits that tell it from its neighbours: epoch times have many."""
    return np.format_float_positional(time_s, trim="-")


def check_times(timestamps: Array, where: str) -> None:
    """Refuse timestamps (N,) [s] that are not finite or do not increase.

    Raises
    ------
    DataError
        Beginning with ``where``, which number and what times.
    """
    if not np.isfinite(timestamps).all():
        raise DataError(f"{where}: a timestamp is not a finite number")
    back = np.flatnonzero(np.diff(timestamps) <= 0)
    if back.size:
        k = int(back[0])
        a, b = (time_text(t) for t in timestamps[k : k + 2])
        raise DataError(f"{where}: times must increase, but number {k} is {a} s and the next {b} s")


def read_times(path: Path | str, increasing: bool = True) -> Array:
    """Read times (N,) [s], one a row.

    Raises
    ------
    DataError
        If the file cannot be read, or times are not numbers, or go back and ``increasing`` is asked for.
    """
    seconds = read_table(path, 1, "1 number (a time in seconds)")[0][:, 0]
    if increasing:
        check_times(seconds, str(path))
    return seconds


def in_time_order(timestamps: Array) -> NDArray[np.int64]:
    """Indices that sort timestamps (N,) [s]; of equal ones only the first."""
    order = np.argsort(timestamps, kind="stable")
    return order[np.diff(timestamps[order], prepend=-np.inf) > 0]


def nearest(times: Array, others: Array, tolerance_s: float) -> NDArray[np.int64]:
    """Index (N,) into increasing times ``others`` of the one nearest to each of ``times``.

    It is -1 where none lies within the tolerance [s].
    """
    if len(others) == 0:
        return np.full(len(times), -1)
    right = np.clip(np.searchsorted(others, times), 1, max(len(others) - 1, 1))
    right = np.minimum(right, len(others) - 1)
    left = np.maximum(right - 1, 0)
    found = np.where(np.abs(others[left] - times) <= np.abs(others[right] - times), left, right)
    return np.where(np.abs(others[found] - times) <= tolerance_s, found, -1)


def mutual(times: Array, others: Array, tolerance_s: float) -> NDArray[np.int64]:
    """As `nearest`, but each of ``others`` serves only that one of ``times`` that is nearest to it."""
    found = nearest(times, others, tolerance_s)
    back = nearest(others, times, tolerance_s)
    return np.where((found >= 0) & (back[found] == np.arange(len(times))), found, -1)
