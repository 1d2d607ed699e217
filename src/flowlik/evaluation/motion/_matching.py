"""Which row of an estimated trajectory's file belongs to which row of the true one's."""

from __future__ import annotations

from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from flowlik.errors import DataError
from flowlik.geometry.pose_table import PoseTable
from flowlik.geometry.times import mutual, time_text
from flowlik.geometry.trajectory import FRAME_RATE, Trajectory
from flowlik.support.arrays import Array

MAX_DIFFERENCE_S = 0.01
"""Rows further apart in time are not of one instant, unless told otherwise."""


class Matched(NamedTuple):
    """Two trajectories of the same instants.

    Attributes
    ----------
    estimated, truth : Trajectory
        N poses each, at the estimate's times [s]; frame / 10 s where files have none.
    by : {"time", "number", "row"}
        What matched them.
    apart_s : float
        Largest difference of the times [s] of two matched rows.
    """

    estimated: Trajectory
    truth: Trajectory
    by: Literal["time", "number", "row"]
    apart_s: float


def match(estimated: PoseTable, truth: PoseTable, max_difference_s: float = MAX_DIFFERENCE_S) -> Matched:
    """Match rows by time where both files have times, else by number; a file without numbers counts rows.

    Rows without a partner are left out. Files that have neither must have a row for every frame both.

    Parameters
    ----------
    estimated, truth : PoseTable
        The files.
    max_difference_s : float
        Largest difference [s] of times that match; each row serves only the one nearest to it.

    Raises
    ------
    DataError
        If only one file has times, two files without times and numbers differ in length, or fewer than two
        rows match.
    """
    if not 0 <= max_difference_s < np.inf:
        raise DataError(f"the largest difference of times must be at least 0 s, not {max_difference_s}")
    if (estimated.times_s is None) != (truth.times_s is None):
        name = "estimated" if estimated.times_s is None else "true"
        raise DataError(f"the {name} trajectory has no times, the other has: --times gives them, one a row")
    if estimated.times_s is not None and truth.times_s is not None:
        found = mutual(estimated.times_s, truth.times_s, max_difference_s)
        mine, theirs = np.flatnonzero(found >= 0), found[found >= 0]
        if len(mine) < 2:
            ranges = (
                f"{time_text(t[0])} to {time_text(t[-1])} s" for t in (estimated.times_s, truth.times_s)
            )
            spans = "the estimate is of {}, the truth of {}".format(*ranges)
            raise DataError(f"{len(mine)} rows match within {max_difference_s:g} s in time: {spans}")
        times_s = estimated.times_s[mine]
        apart_s = float(np.abs(truth.times_s[theirs] - times_s).max())
        return _matched(estimated, truth, (mine, theirs), times_s, "time", apart_s)
    if estimated.frames is None and truth.frames is None:
        if len(estimated) != len(truth):
            raise DataError(
                f"the estimated trajectory has {len(estimated)} rows, the true one {len(truth)}, and neither "
                "has times or frame numbers to match them by"
            )
        every = np.arange(len(truth))
        return _matched(estimated, truth, (every, every), every / FRAME_RATE, "row", 0.0)
    a, b = (np.arange(len(t)) if t.frames is None else t.frames for t in (estimated, truth))
    shared, mine, theirs = np.intersect1d(a, b, assume_unique=True, return_indices=True)
    if len(shared) < 2:
        raise DataError(f"{len(shared)} frame numbers are in both trajectories")
    return _matched(estimated, truth, (mine, theirs), shared / FRAME_RATE, "number", 0.0)


def _matched(
    estimated: PoseTable,
    truth: PoseTable,
    rows: tuple[NDArray[np.int64], NDArray[np.int64]],
    times_s: Array,
    by: Literal["time", "number", "row"],
    apart_s: float,
) -> Matched:
    first, second = (Trajectory(times_s, t.poses[r]) for t, r in zip((estimated, truth), rows))
    return Matched(first, second, by, apart_s)
