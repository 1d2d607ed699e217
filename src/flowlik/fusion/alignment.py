"""A first guess of the state at the first frame, from the first seconds of a flight (docs/fusion.md)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from flowlik.datasets.gps import GpsFixes
from flowlik.datasets.inertial import ImuSamples
from flowlik.errors import DataError
from flowlik.fusion.fuse import imu_segments
from flowlik.fusion.state import FusedState, FusionSettings
from flowlik.odometry import FlowFactor
from flowlik.support.arrays import Array

FEWEST_FLOWS = 10
WIDE_TILT_RAD = 0.1
WIDE_HEADING_RAD = 0.5
WIDE_VELOCITY_MPS = 3.0
GAUGE = 1e-4
"""Standard deviation [m, rad] of what {n} is defined by where there is no GPS."""


@dataclass(frozen=True)
class TurnOn:
    """Standard deviations of an IMU's biases before anything is measured.

    Attributes
    ----------
    gyroscope_radps : float
        [rad/s].
    accelerometer_mps2 : float
        [m/s²].
    """

    gyroscope_radps: float
    accelerometer_mps2: float


class _Inertial(NamedTuple):
    """Attitude (N, 3, 3), and velocity and position (N, 3) without gravity, in the first body's axes."""

    times_s: Array
    R: Array
    v: Array
    p: Array


def coarse_start(
    frame_times_s: Array,
    flows: Sequence[FlowFactor | None],
    imu: ImuSamples,
    fixes: GpsFixes | None,
    settings: FusionSettings,
    turn_on: TurnOn,
) -> FusedState:
    """First guess for a smoother that holds all of `FusionSettings.alignment_s` in its lag.

    Flow and gyroscope tell the path in the body's axes; what the accelerometer measures beside it tells
    gravity and velocity, by least squares; the heading is the turn that lays this path on the fixes. The
    covariance is wide, so that what the smoother then says comes of the measurements and not of this guess.

    Parameters
    ----------
    frame_times_s, flows, imu, fixes, settings
        As for `flowlik.fusion.fuse`.
    turn_on : TurnOn
        What is known of the biases.

    Raises
    ------
    DataError
        If fewer than ten frames tell a motion, or there is no fix though GPS is given.
    """
    within = int(np.searchsorted(frame_times_s, frame_times_s[0] + settings.alignment_s, side="right"))
    times_s, flows = frame_times_s[:within], list(flows[: max(within - 1, 0)])
    if (solved := sum(flow is not None for flow in flows)) < FEWEST_FLOWS:
        raise DataError(
            f"{solved} frames of the first {settings.alignment_s:g} s tell a motion, but an alignment needs "
            f"{FEWEST_FLOWS}: begin elsewhere, or give the initial state"
        )
    bias = _gyroscope_bias(times_s, flows, imu, settings)
    alone = _integrated(imu, times_s, bias)
    v0, g0 = _velocity_and_gravity(alone, flows, settings)
    path = alone.p + np.outer(alone.times_s, v0) + np.outer(alone.times_s**2 / 2, g0)
    antenna = path + alone.R @ settings.antenna_b_m
    level = _level(g0, settings.gravity_n_mps2)
    heading, position, sigma = _heading(level.apply(antenna), times_s, fixes, settings)
    R_n_b = heading * level
    down = settings.gravity_n_mps2 / np.linalg.norm(settings.gravity_n_mps2)
    tilt = WIDE_TILT_RAD**2 * (np.eye(3) - np.outer(down, down))
    turn = GAUGE if fixes is None else WIDE_HEADING_RAD
    covariance = np.zeros((15, 15))
    R = R_n_b.as_matrix()
    covariance[:3, :3] = R.T @ (tilt + turn**2 * np.outer(down, down)) @ R
    covariance[range(3, 6), range(3, 6)] = WIDE_VELOCITY_MPS**2
    covariance[range(6, 9), range(6, 9)] = sigma**2
    covariance[range(9, 12), range(9, 12)] = turn_on.gyroscope_radps**2
    covariance[range(12, 15), range(12, 15)] = turn_on.accelerometer_mps2**2
    zero = np.zeros(3)
    return FusedState(float(times_s[0]), R, position, R @ v0, zero, zero, covariance)


def heading_sigma_rad(state: FusedState, settings: FusionSettings) -> float:
    """Standard deviation [rad] of the turn about the vertical."""
    down = state.R_n_b.T @ settings.gravity_n_mps2
    down = down / np.linalg.norm(down)
    return float(np.sqrt(down @ state.covariance[:3, :3] @ down))


def _gyroscope_bias(
    times_s: Array, flows: list[FlowFactor | None], imu: ImuSamples, settings: FusionSettings
) -> Array:
    """Mean difference (3,) [rad/s] of what gyroscope and flow say of turns."""
    R_b_c = settings.T_b_c.rotation
    differences = []
    for segment, flow in zip(imu_segments(imu, times_s), flows):
        if flow is not None:
            seconds = segment.steps_s.sum()
            turn = (R_b_c * flow.T_k_prev.rotation.inv() * R_b_c.inv()).as_rotvec()
            differences.append(segment.steps_s @ segment.rates_radps / seconds - turn / seconds)
    return np.asarray(np.median(differences, axis=0))


def _integrated(imu: ImuSamples, times_s: Array, bias: Array) -> _Inertial:
    R, v, p = np.eye(3), np.zeros(3), np.zeros(3)
    rows = [(R, v, p)]
    for segment in imu_segments(imu, times_s):
        turns = Rotation.from_rotvec((segment.rates_radps - bias) * segment.steps_s[:, None]).as_matrix()
        for step_s, turn, force in zip(segment.steps_s, turns, segment.forces_mps2):
            a = R @ force
            R, v, p = R @ turn, v + a * step_s, p + v * step_s + a * step_s**2 / 2
        rows.append((R, v, p))
    return _Inertial(times_s - times_s[0], *(np.array(column) for column in zip(*rows)))


def _velocity_and_gravity(
    alone: _Inertial, flows: list[FlowFactor | None], settings: FusionSettings
) -> tuple[Array, Array]:
    """Velocity [m/s] at the first frame and gravity [m/s²], in its axes."""
    A, y = [], []
    T_b_c, one = settings.T_b_c, np.eye(3)
    for k, flow in enumerate(flows):
        if flow is None:
            continue
        R = alone.R[k].T @ alone.R[k + 1]
        R_k_prev = T_b_c.rotation.inv() * Rotation.from_matrix(R.T) * T_b_c.rotation
        t = flow.translation(R_k_prev) if flow.form == "given-rotation" else flow.T_k_prev.translation
        # of the body: its origin moves with the camera's, and the lever arm turns
        moved = T_b_c.rotation.apply(-R_k_prev.inv().apply(t)) + (one - R) @ T_b_c.translation
        dt, s = alone.times_s[k + 1] - alone.times_s[k], alone.times_s[k]
        A.append(np.hstack([dt * one, (s * dt + dt**2 / 2) * one]))
        y.append(alone.R[k] @ moved - (alone.p[k + 1] - alone.p[k]))
    found = np.linalg.lstsq(np.concatenate(A), np.concatenate(y), rcond=None)[0]
    return found[:3], found[3:]


def _level(g0: Array, gravity_n: Array) -> Rotation:
    """The least turn that lays gravity in the body on gravity in {n}."""
    a, b = g0 / np.linalg.norm(g0), gravity_n / np.linalg.norm(gravity_n)
    axis, cosine = np.cross(a, b), float(a @ b)
    sine = float(np.linalg.norm(axis))
    if sine < 1e-12:
        # upside down: any level axis will do
        other = np.cross(a, np.eye(3)[np.abs(a).argmin()])
        return Rotation.from_rotvec(np.zeros(3) if cosine > 0 else np.pi * other / np.linalg.norm(other))
    return Rotation.from_rotvec(axis / sine * np.arctan2(sine, cosine))


def _heading(
    antenna: Array, times_s: Array, fixes: GpsFixes | None, settings: FusionSettings
) -> tuple[Rotation, Array, float]:
    """Turn about the vertical, position [m] of the first body in {n}, and how wide [m] that is."""
    if fixes is None:
        return Rotation.identity(), np.zeros(3), GAUGE
    near = (fixes.times_s >= times_s[0]) & (fixes.times_s <= times_s[-1])
    if not near.any():
        raise DataError(f"no GPS fix in the first {settings.alignment_s:g} s: give the initial state")
    told = fixes.positions_n_m[near]
    seen = np.column_stack([np.interp(fixes.times_s[near], times_s, column) for column in antenna.T])
    down = settings.gravity_n_mps2 / np.linalg.norm(settings.gravity_n_mps2)
    q, z = seen - seen.mean(axis=0), told - told.mean(axis=0)
    across, along = np.cross(q, z) @ down, (q * z).sum(axis=1) - (q @ down) * (z @ down)
    angle = np.arctan2(across.sum(), along.sum())
    turn = Rotation.from_rotvec(angle * down)
    position = told.mean(axis=0) - turn.apply(seen.mean(axis=0))
    return turn, position, 10 * float(fixes.sigma_m[near].max()) + float(np.linalg.norm(q, axis=1).max())
