"""Intervals of trajectory errors, and errors by length and speed of segments."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from flowlik.errors import DataError
from flowlik.evaluation.motion._drift import KITTI_LENGTHS_M, Segments, kitti_errors
from flowlik.geometry.trajectory import Trajectory, chain
from flowlik.support.arrays import Array

BLOCK = 10
SPEED_STEP_MPS = 2.0


@dataclass(frozen=True)
class Interval:
    """Central interval of a resampled figure."""

    low: float
    high: float
    replicates: int


def t_err_interval(
    estimated: Trajectory,
    truth: Trajectory,
    rng: np.random.Generator,
    replicates: int = 200,
    confidence: float = 0.95,
    block: int = BLOCK,
) -> Interval:
    """Interval of `t_err_percent` [%] over blocks of frames.

    Each frame's relative error, true motion undone, belongs to a block of neighbouring frames. Blocks are
    drawn with replacement until every frame has an error again, these are chained along the true trajectory,
    and the KITTI metric is computed of each. A constant error stays: it is in every block.

    Raises
    ------
    DataError
        If the trajectories differ in number of poses, or the true path holds no segment of 100 m.
    """
    reason = kitti_errors(estimated, truth).reason
    if reason:
        raise DataError(reason)
    steps = truth.poses[1:].inv() * truth.poses[:-1]
    errors = (estimated.poses[1:].inv() * estimated.poses[:-1]) * steps.inv()
    count, drawn = len(errors), []
    starts = np.arange(0, count, block)
    for _ in range(replicates):
        chosen = np.concatenate(
            [np.arange(s, min(s + block, count)) for s in rng.choice(starts, len(starts) + 1)]
        )
        while len(chosen) < count:
            chosen = np.concatenate([chosen, chosen])
        poses = chain(list(errors[chosen[:count]] * steps))
        value = kitti_errors(Trajectory(truth.timestamps, poses), truth).t_err_percent
        assert value is not None
        drawn.append(value)
    low, high = np.quantile(drawn, [(1 - confidence) / 2, (1 + confidence) / 2])
    return Interval(float(low), float(high), replicates)


def errors_by_length(segments: Segments) -> list[tuple[float, float, float, int]]:
    """Rows (length [m], t_err [%], r_err [deg/100 m], segments), of the lengths that occur."""
    rows = []
    for length in KITTI_LENGTHS_M:
        mine = segments.length_m == length
        if mine.any():
            rows.append((float(length), *_means(segments, mine)))
    return rows


def errors_by_speed(segments: Segments, truth: Trajectory) -> list[tuple[float, float, float, int]]:
    """Rows (speed [m/s], t_err [%], r_err [deg/100 m], segments), in bins of 2 m/s at their centres."""
    speed = segments.length_m / (truth.timestamps[segments.last] - truth.timestamps[segments.first])
    bins = np.floor(speed / SPEED_STEP_MPS).astype(int)
    return [((b + 0.5) * SPEED_STEP_MPS, *_means(segments, bins == b)) for b in np.unique(bins)]


def _means(segments: Segments, mine: Array) -> tuple[float, float, int]:
    t_err, r_err = segments.t_err_percent[mine].mean(), segments.r_err_deg_per_100m[mine].mean()
    return float(t_err), float(r_err), int(mine.sum())
