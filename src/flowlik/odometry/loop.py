"""Odometry over a sequence: flow of the next pair beside the estimate of the last."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Literal

import numpy as np

from flowlik.datasets.base import ImageSequence
from flowlik.datasets.selection import whole_pair
from flowlik.egomotion import EgoMotion
from flowlik.flow.base import method_for_pair
from flowlik.measurement.measurements import Measurements
from flowlik.odometry.odometry import Odometry
from flowlik.support.arrays import Array

ResidualKind = Literal["depth", "epipolar"]


def true_move(sequence: ImageSequence, k: int) -> Array:
    """Move (3,) [m] of the true camera from frame k - 1 to k, in its frame at k - 1."""
    return np.asarray((sequence.T_n_c(k - 1).inv() * sequence.T_n_c(k)).translation, dtype=np.float64)


def run_odometry(
    sequence: ImageSequence,
    odometry: Odometry,
    residual: ResidualKind,
    frames: int | None = None,
) -> Iterator[EgoMotion]:
    """Loop over a sequence; afterwards ``odometry.poses`` holds the trajectory.

    The flow of the next pair is measured on a thread while a motion is estimated.

    Parameters
    ----------
    sequence : ImageSequence
        Images, with depth for the residual of known depth, and poses where a boresight is asked for.
    odometry : Odometry
        Fresh odometry.
    residual : {"depth", "epipolar"}
        Which residual.
    frames : int, optional
        Only the first so many frames.

    Yields
    ------
    EgoMotion
        Of every frame after the first.

    Raises
    ------
    DataError
        If the sequence lacks a field asked for.
    """
    count = len(sequence) if frames is None else min(frames, len(sequence))
    method = odometry.method
    waiting: tuple[Future[Measurements], Array | None, Array | None] | None = None
    with ThreadPoolExecutor(1, thread_name_prefix="flowlik-ahead") as ahead:
        for k in range(count):
            if k > 0:
                odometry.method = method_for_pair(method, *whole_pair(sequence, k - 1))
            # the last frame's depth is never used, and data sets may lack it
            depth = sequence.depth(k) if residual == "depth" and k < count - 1 else None
            reference = true_move(sequence, k) if odometry.boresight is not None and k > 0 else None
            pair = odometry.take(sequence.image(k), sequence.timestamp(k), depth)
            following = pair and (ahead.submit(odometry.measure, pair), pair.depth, reference)
            if waiting is not None:
                yield _advanced(odometry, *waiting)
            waiting = following
        if waiting is not None:
            yield _advanced(odometry, *waiting)
    odometry.method = method


def _advanced(
    odometry: Odometry, measured: Future[Measurements], depth: Array | None, reference_m: Array | None
) -> EgoMotion:
    return odometry.advance(measured.result(), depth, reference_m=reference_m)
