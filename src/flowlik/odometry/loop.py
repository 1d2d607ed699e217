"""The loop over a sequence: flow of the next pair of frames beside what is made of the last."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from flowlik.datasets.base import ImageSequence, mask_of
from flowlik.datasets.selection import whole_pair
from flowlik.egomotion import EgoMotion
from flowlik.flow.base import FlowMethod, Image, method_for_pair
from flowlik.likelihood.likelihood import FlowLikelihood
from flowlik.measurement.features import measure_features
from flowlik.measurement.measurements import Measurements
from flowlik.odometry.odometry import Odometry, check_frame
from flowlik.support.arrays import Array
from flowlik.support.threads import map_ahead

ResidualKind = Literal["depth", "epipolar"]


class MeasuredPair(NamedTuple):
    """What is measured from frame k - 1 to k, the time [s] of frame k, and the depth (H, W) [m] of k - 1."""

    k: int
    timestamp: float
    measurements: Measurements
    depth: Array | None


class _Pair(NamedTuple):
    """Frames k - 1 and k as they are read, and the flow method between them."""

    k: int
    timestamp: float
    previous: Image
    current: Image
    depth: Array | None
    method: FlowMethod
    usable: NDArray[np.bool_] | None


def measure_sequence(
    sequence: ImageSequence,
    method: FlowMethod,
    likelihood: FlowLikelihood,
    seed: int = 0,
    depth: bool = False,
    frames: int | None = None,
    map: Callable[..., Iterator[MeasuredPair]] = map_ahead,
) -> Iterator[MeasuredPair]:
    """Loop over a sequence: its pairs of neighbouring frames, measured; any estimators may use them.

    Parameters
    ----------
    sequence : ImageSequence
        Images. Each is read once, in order, on the thread of the caller.
    method : FlowMethod
        Flow.
    likelihood : FlowLikelihood
        Says which texture and signals are measured.
    seed : int
        Pixels of a dense method are drawn for frame k by ``seed + k``.
    depth : bool
        Whether to read depth too, of all frames but the last.
    frames : int, optional
        Only the first so many frames.
    map : callable
        Like the built-in one, which measures a pair when it is asked for. By default the next pair is
        measured on a thread while the last one is used.

    Yields
    ------
    MeasuredPair
        Of every frame after the first.

    Raises
    ------
    DataError
        If the sequence lacks a field asked for, or a frame does not fit the camera.
    """

    def measured(pair: _Pair) -> MeasuredPair:
        m = measure_features(
            pair.previous, pair.current, pair.method, likelihood.texture, seed + pair.k, likelihood.signals,
            pair.usable,
        )  # fmt: skip
        return MeasuredPair(pair.k, pair.timestamp, m, pair.depth)

    count = len(sequence) if frames is None else min(frames, len(sequence))
    return map(measured, _pairs(sequence, method, depth, count))


def _pairs(sequence: ImageSequence, method: FlowMethod, depth: bool, count: int) -> Iterator[_Pair]:
    previous: tuple[Image, Array | None] | None = None
    for k in range(count):
        # the last frame's depth is never used, and data sets may lack it
        frame = sequence.image(k), sequence.depth(k) if depth and k < count - 1 else None
        check_frame(sequence.camera, *frame)
        if previous is not None:
            own = method_for_pair(method, *whole_pair(sequence, k - 1))
            usable = mask_of(sequence, k - 1)
            yield _Pair(k, sequence.timestamp(k), previous[0], frame[0], previous[1], own, usable)
        previous = frame


def true_move(sequence: ImageSequence, k: int) -> Array:
    """Move (3,) [m] of the true camera from frame k - 1 to k, in its frame at k - 1."""
    return np.asarray((sequence.T_n_c(k - 1).inv() * sequence.T_n_c(k)).translation, dtype=np.float64)


def run_odometry(
    sequence: ImageSequence,
    odometry: Odometry,
    residual: ResidualKind,
    frames: int | None = None,
) -> Iterator[EgoMotion]:
    """Run an odometry over a sequence; afterwards ``odometry.poses`` holds the trajectory.

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
        If the sequence lacks a field asked for, a frame does not fit the camera, or time does not advance.
    """
    likelihood = odometry.estimator.likelihood
    odometry.begin(sequence.timestamp(0))
    for pair in measure_sequence(
        sequence, odometry.method, likelihood, odometry.seed, residual == "depth", frames
    ):
        reference_m = true_move(sequence, pair.k) if odometry.boresight is not None else None
        yield odometry.advance(
            pair.measurements, pair.depth, reference_m=reference_m, timestamp=pair.timestamp
        )
