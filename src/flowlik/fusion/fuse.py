"""A whole flight through the smoother."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform, Rotation

from flowlik.datasets.gps import GpsFixes
from flowlik.datasets.inertial import ImuNoise, ImuSamples
from flowlik.errors import DataError
from flowlik.fusion.direction_factor import DirectionFactor
from flowlik.fusion.innovations import GpsInnovations
from flowlik.fusion.smoother import FixedLagSmoother
from flowlik.fusion.state import FusedState, FusionSettings, GpsFix, ImuSegment
from flowlik.geometry.times import time_text
from flowlik.geometry.trajectory import Trajectory
from flowlik.odometry import FlowFactor
from flowlik.support.arrays import Array

MOST_CARRIED_S = 0.05
"""A fix that is farther from every frame [s] gets a node of its own."""


@dataclass(frozen=True, eq=False)
class Fused:
    """A flight as the smoother tells it, each moment by what came until then.

    Attributes
    ----------
    states : tuple of FusedState
        At every frame, the start first.
    innovations : GpsInnovations
        Of the fixes used.
    used_fixes : bool array (N,)
        Which fixes were: those after the first frame and not after the last.
    flow_factors : int
        Frames whose flow was used.
    """

    states: tuple[FusedState, ...]
    innovations: GpsInnovations
    used_fixes: NDArray[np.bool_]
    flow_factors: int

    @cached_property
    def times_s(self) -> Array:
        """Times (N,) [s] of the frames."""
        return np.array([state.time_s for state in self.states])

    @cached_property
    def covariances(self) -> Array:
        """Covariances (N, 15, 15) of the error states."""
        return np.array([state.covariance for state in self.states])

    @property
    def trajectory(self) -> Trajectory:
        """Poses ``T_n_b`` of the frames."""
        return Trajectory(self.times_s, RigidTransform.concatenate([state.T_n_b for state in self.states]))

    def after(self, time_s: float) -> Fused:
        """Return the flight from a time [s] on: its states and innovations there."""
        told = self.innovations
        late = told.times_s > time_s
        kept = GpsInnovations(*(getattr(told, field.name)[late] for field in fields(told)))
        states = tuple(state for state in self.states if state.time_s >= time_s - 1e-6)
        return replace(self, states=states, innovations=kept)

    def then(self, other: Fused, time_s: float) -> Fused:
        """Return this flight until a time [s], and another's states after it."""
        states = [state for state in self.states if state.time_s <= time_s]
        states += [state for state in other.states if state.time_s > time_s]
        return replace(self, states=tuple(states))


class _Node:
    """A moment of the graph: its frame, if one was taken, and the fixes that are taken there."""

    __slots__ = ("fixes", "frame", "time_s")

    def __init__(self, time_s: float, frame: int | None) -> None:
        self.time_s, self.frame = time_s, frame
        self.fixes: list[int] = []


def fuse(
    start: FusedState,
    frame_times_s: Array,
    flows: Sequence[FlowFactor | DirectionFactor | None],
    imu: ImuSamples,
    fixes: GpsFixes | None,
    settings: FusionSettings,
) -> Fused:
    """Fuse a flight.

    Parameters
    ----------
    start : FusedState
        What is known at the first frame.
    frame_times_s : array (N,)
        Times [s] of the frames, increasing, all within the IMU's.
    flows : sequence of N - 1 FlowFactor, DirectionFactor or None
        Of every frame after the first; None where its images tell no motion, or over more than the lag.
    imu : ImuSamples
        IMU in {b}, with its noise.
    fixes : GpsFixes, optional
        GPS in {n}.
    settings : FusionSettings
        How the sensors sit and err.

    Raises
    ------
    DataError
        If times do not fit, the IMU does not cover the frames, or its noise is not known.
    MissingExtraError
        If GTSAM is not installed.
    """
    frame_times_s = np.asarray(frame_times_s, dtype=np.float64)
    if len(flows) != len(frame_times_s) - 1:
        raise DataError(f"{len(frame_times_s)} frames have {len(flows)} flow factors, expected one less")
    if abs(start.time_s - frame_times_s[0]) > 1e-6:
        raise DataError(
            f"the start is of {time_text(start.time_s)} s, the first frame of {time_text(frame_times_s[0])} s"
        )
    smoother = FixedLagSmoother(start, _noise(imu), settings)
    nodes, used = _nodes(frame_times_s, fixes, settings.lag_s / 4)
    segments = imu_segments(imu, np.array([node.time_s for node in nodes]))
    states = [start]
    for node, segment in zip(nodes[1:], segments):
        taken = [] if fixes is None else [_fix(fixes, n) for n in node.fixes]
        flow = None if node.frame is None else flows[node.frame - 1]
        state = smoother.step(segment, flow, taken, node.frame is not None)
        if node.frame is not None:
            states.append(state)
    return Fused(tuple(states), smoother.innovations, used, smoother.flow_factors)


def covers(imu: ImuSamples, times_s: Array) -> NDArray[np.bool_]:
    """Whether the IMU was on at times (N,) [s]: each sample stands for a period to either side."""
    period_s = 1.001 * float(np.median(np.diff(imu.times_s)))
    return np.asarray((times_s >= imu.times_s[0] - period_s) & (times_s <= imu.times_s[-1] + period_s))


def imu_segments(imu: ImuSamples, times_s: Array) -> Iterator[ImuSegment]:
    """IMU between moments: samples are joined by straight lines.

    Parameters
    ----------
    imu : ImuSamples
        What was measured.
    times_s : array (N,)
        Moments [s], increasing.

    Returns
    -------
    iterator of N - 1 ImuSegment

    Raises
    ------
    DataError
        If the IMU does not cover them.
    """
    first, last = imu.times_s[0], imu.times_s[-1]
    if not covers(imu, times_s).all():
        raise DataError(
            f"IMU from {time_text(first)} to {time_text(last)} s does not cover the frames from "
            f"{time_text(times_s[0])} to {time_text(times_s[-1])} s"
        )
    inside = imu.times_s[(imu.times_s > times_s[0]) & (imu.times_s < times_s[-1])]
    at = np.union1d(inside, times_s)
    # moments that coincide but for rounding are one
    keep = np.concatenate([[True], np.diff(at) > 1e-9]) | np.isin(at, times_s)
    at = at[keep]
    measured = np.hstack([imu.angular_rate_radps, imu.specific_force_mps2])
    values = np.column_stack([np.interp(at, imu.times_s, column) for column in measured.T])
    steps_s, rates = np.diff(at), (values[:-1, :3] + values[1:, :3]) / 2
    later = Rotation.from_rotvec(rates * steps_s[:, None]).apply(values[1:, 3:])
    forces = (values[:-1, 3:] + later) / 2
    ends = np.searchsorted(at, times_s)
    for begin, end in pairwise(ends):
        one = slice(begin, end)
        yield ImuSegment(steps_s[one], rates[one], forces[one], values[end, :3])


def _noise(imu: ImuSamples) -> ImuNoise:
    if imu.noise is None:
        raise DataError("the IMU's noise densities are not known; a smoother needs them, there is no default")
    return imu.noise


def _fix(fixes: GpsFixes, n: int) -> GpsFix:
    return GpsFix(float(fixes.times_s[n]), fixes.positions_n_m[n], np.diag(fixes.sigma_m[n] ** 2))


def _nodes(
    frames_s: Array, fixes: GpsFixes | None, most_apart_s: float
) -> tuple[list[_Node], NDArray[np.bool_]]:
    """Nodes of the graph, and which fixes they take.

    A fix between frames is taken at the nearer one, so that what was known then is the state at one moment;
    where both are far it has a node of its own, and none is farther from the next than ``most_apart_s``.
    """
    fix_s = np.zeros(0) if fixes is None else fixes.times_s
    used = (fix_s > frames_s[0]) & (fix_s <= frames_s[-1] + MOST_CARRIED_S)
    frame_of = {float(t): k for k, t in enumerate(frames_s)}
    after = np.clip(np.searchsorted(frames_s, fix_s), 1, len(frames_s) - 1)
    nearest = np.where(fix_s - frames_s[after - 1] < frames_s[after] - fix_s, after - 1, after)
    far = used & (np.abs(frames_s[nearest] - fix_s) > MOST_CARRIED_S)
    times_s = np.union1d(frames_s, fix_s[far])
    for a, b in pairwise(times_s.copy()):
        pieces = int(np.ceil((b - a) / most_apart_s))
        if pieces > 1:
            times_s = np.union1d(times_s, np.linspace(a, b, pieces + 1)[1:-1])
    nodes = [_Node(float(t), frame_of.get(float(t))) for t in times_s]
    # the start is what is known there: a fix of its moment is not taken a second time
    used &= far | (nearest > 0)
    for n in np.flatnonzero(used):
        at = fix_s[n] if far[n] else frames_s[nearest[n]]
        nodes[int(np.searchsorted(times_s, at))].fixes.append(int(n))
    return nodes, used
