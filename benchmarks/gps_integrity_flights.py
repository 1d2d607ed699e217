"""Flights of half a minute for a monitor of GPS: measured or drawn motions, and what a filter makes of it."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from error_state_filter import Coloured, ErrorStateFilter, Imu, Start, drawn_imu, true_flight
from flowlik.egomotion import EgoMotion, Status
from flowlik.fusion import GpsInnovations
from flowlik.geometry.motion import exp_se3, relative_motion
from flowlik.likelihood.over_time import OverTime, Persistence
from flowlik.odometry import FlowFactor
from flowlik.odometry.flow_factor import given_rotation
from fused_over_time import GPS_PER_SECOND, GPS_SIGMA_M, INTERVAL_S, poses_of
from over_time import FRAMES_PER_SECOND, Motions

GPS_MEMORY_S, IMU_PER_SECOND = 60.0, 120.0

# of one motion of Lucas-Kanade in the forest at 6 m/s: standard deviations [rad, m], and correlations
SIGMA = np.array([4.6e-5, 7.4e-5, 3.3e-5, 4.3e-4, 2.8e-4, 5.8e-4])
CORRELATION = np.array([
    [1.00, -0.07, 0.17, 0.20, 0.81, 0.10],
    [-0.07, 1.00, -0.26, -0.71, -0.04, 0.59],
    [0.17, -0.26, 1.00, 0.50, 0.14, -0.03],
    [0.20, -0.71, 0.50, 1.00, 0.19, -0.24],
    [0.81, -0.04, 0.14, 0.19, 1.00, 0.29],
    [0.10, 0.59, -0.03, -0.24, 0.29, 1.00],
])  # fmt: skip


class Flight(NamedTuple):
    name: str
    motions: Motions

    @property
    def seconds(self) -> float:
        return len(self.motions.true) * INTERVAL_S


def measured_flights(cache: Path, model: str, at_least_s: float) -> Iterator[Flight]:
    """Flights in the layout of `over_time.py` that are long enough."""
    for path in sorted(cache.glob(f"*--{model}.npz")):
        with np.load(path) as data:
            if len(data["T"]) * INTERVAL_S < at_least_s:
                continue
            estimated = [
                EgoMotion(RigidTransform.from_matrix(T), np.zeros((6, 6)), C, Status(s))
                for T, C, s in zip(data["T"], data["covariance"], data["status"])
            ]
            true = [RigidTransform.from_matrix(T) for T in data["true"]]
        yield Flight(path.name.partition("--")[0], Motions(estimated, true))


def drawn_flight(seed: int, seconds: float, stays: OverTime) -> Flight:
    """A smooth flight whose motions err as a model says that they do: nothing here is measured.

    Rotations, and translations given the rotation, each have errors of one motion's covariance, of which a
    share stays with the memory that the model knows, and the rest is white.
    """
    rng = np.random.default_rng([seed, 41])
    count = round(seconds * FRAMES_PER_SECOND)
    poses = _path(count + 1, rng)
    true = [relative_motion(poses[k], poses[k + 1]) for k in range(count)]
    C = CORRELATION * np.outer(SIGMA, SIGMA) * np.exp(0.4 * rng.standard_normal())
    gain, left = given_rotation(C)
    turns = persistent(count, INTERVAL_S, stays.full, rng) @ np.linalg.cholesky(C[:3, :3]).T
    moves = (
        turns @ gain.T + persistent(count, INTERVAL_S, stays.given_rotation, rng) @ np.linalg.cholesky(left).T
    )
    errors = np.hstack([turns, moves])
    estimated = [EgoMotion(exp_se3(e) * T, np.zeros((6, 6)), C, Status.SOLVED) for e, T in zip(errors, true)]
    return Flight(f"drawn-{seed}", Motions(estimated, true))


def with_errors_of(flight: Flight, pieces: Sequence[Motions], seed: int) -> Flight:
    """A drawn flight whose motions err as measured ones did, piece after piece in an order that is drawn.

    Errors of images with their own covariances; what stays for longer than a piece is not in them.
    """
    rng, estimated = np.random.default_rng([seed, 43]), []
    while len(estimated) < len(flight.motions.true):
        piece = pieces[rng.integers(len(pieces))]
        for motion, true in zip(*piece):
            if len(estimated) < len(flight.motions.true):
                off = motion.T_k_prev * true.inv()
                estimated.append(replace(motion, T_k_prev=off * flight.motions.true[len(estimated)]))
    return Flight(flight.name.replace("drawn", "pieces"), Motions(estimated, flight.motions.true))


def _path(count: int, rng: np.random.Generator) -> RigidTransform:
    """Curves of 4 to 9 m/s that climb and bank."""
    s = np.arange(count) * INTERVAL_S

    def waves(size: float) -> np.ndarray:
        hertz, phase = rng.uniform(0.03, 0.25, 4), rng.uniform(0, 2 * np.pi, 4)
        return size * np.sin(2 * np.pi * np.outer(s, hertz) + phase).sum(axis=1) / 2

    heading, climb, speed = waves(1.2), waves(0.08), rng.uniform(4, 9) + waves(0.5)
    velocity = np.stack([np.sin(heading), -np.sin(climb), np.cos(heading)], axis=1) * speed[:, None]
    turn = Rotation.from_euler("YXZ", np.stack([heading, climb + waves(0.03), waves(0.1)], axis=1))
    positions = np.cumsum(velocity, axis=0) * INTERVAL_S
    poses = RigidTransform.from_components(positions, turn)
    level = Rotation.from_euler("Y", heading[0])
    return RigidTransform.from_components(positions[0], level).inv() * poses


def persistent(count: int, interval_s: float, stays: Persistence, rng: np.random.Generator) -> np.ndarray:
    """Errors (N, 3) in stated deviations, of which a share stays."""
    kept = np.exp(-interval_s / stays.memory_s)
    driven = rng.standard_normal((count, 3)) * np.sqrt(1 - kept**2)
    driven[0] /= np.sqrt(1 - kept**2)
    for k in range(1, count):
        driven[k] += kept * driven[k - 1]
    white = rng.standard_normal((count, 3))
    return np.sqrt(stays.share) * driven + np.sqrt(max(1 - stays.share, 0.0)) * white


@dataclass(frozen=True)
class Receiver:
    """Errors of GPS an axis: white, and what stays [m]."""

    white_m: float = GPS_SIGMA_M
    coloured_m: float = 0.0


WHITE = Receiver()
COLOURED = Receiver(GPS_SIGMA_M * np.sqrt(0.5), GPS_SIGMA_M * np.sqrt(0.5))


class Filtered(NamedTuple):
    """What a filter told of all draws of a flight, at each fix.

    ``record`` is the first draw's; ``innovations`` (N, draws, 3), ``errors`` of position (N, draws, 3) [m]
    after the fix; ``taken`` (N, draws): whether it was.
    """

    record: GpsInnovations
    innovations: np.ndarray
    errors: np.ndarray
    taken: np.ndarray


def filtered(
    motions: Motions,
    factors: Callable[[EgoMotion], FlowFactor | None],
    draws: int,
    seed: int,
    receiver: Receiver = WHITE,
    modelled: bool = True,
    shift_m: np.ndarray | None = None,
    taken: np.ndarray | None = None,
    gate: float | None = None,
) -> Filtered:
    """Fly a filter along motions.

    ``shift_m`` (N, draws, 3) is added to the fixes; those that are not ``taken`` (N, draws), or whose NIS
    lies above the ``gate``, are left out. A receiver that is not ``modelled`` is taken as white. Equal seeds
    give the same IMU and the same honest errors of GPS, whatever the rest.
    """
    imu, rng = Imu(IMU_PER_SECOND), np.random.default_rng(seed)
    truth = true_flight(*poses_of(motions), imu.rate_hz)
    rates, forces = drawn_imu(truth, imu, draws, rng)
    coloured = Coloured(receiver.coloured_m, GPS_MEMORY_S) if modelled and receiver.coloured_m else None
    sigma_m = receiver.white_m if modelled else float(np.hypot(receiver.white_m, receiver.coloured_m))
    robot = ErrorStateFilter(truth, imu, Start(), draws, rng, coloured=coloured)
    image_each, gps_each = (round(imu.rate_hz / r) for r in (FRAMES_PER_SECOND, GPS_PER_SECOND))
    kept = np.exp(-1 / GPS_PER_SECOND / GPS_MEMORY_S)
    slow = rng.standard_normal((draws, 3))
    errors, times_s, used = [], [], []
    for k in range(1, len(truth.times_s)):
        robot.propagate(rates[k - 1 : k + 1], forces[k - 1 : k + 1])
        if k % image_each == 0:
            if (factor := factors(motions.estimated[k // image_each - 1])) is not None:
                robot.flow(factor)
            robot.clone()
            robot.age(INTERVAL_S)
        if k % gps_each == 0:
            slow = kept * slow + np.sqrt(1 - kept**2) * rng.standard_normal((draws, 3))
            white = rng.standard_normal((draws, 3))
            fix = truth.p[k] + receiver.coloured_m * slow + receiver.white_m * white
            i = len(times_s)
            if shift_m is not None:
                fix = fix + shift_m[i]
            use = np.ones(draws, bool) if taken is None else taken[i]
            if gate is not None:
                use = use & (robot.nis(fix, sigma_m) < gate)
            robot.gps(fix, sigma_m, use)
            times_s.append(truth.times_s[k])
            errors.append(robot.errors(truth.R[k], truth.v[k], truth.p[k])[:, 6:])
            used.append(use)
    record, innovations = robot.innovations(np.array(times_s))
    return Filtered(record, innovations, np.array(errors), np.array(used))


def shifted(fixes: GpsInnovations, shift_m: np.ndarray) -> np.ndarray:
    """How innovations (N, D, 3) change if fixes are shifted (N, D, 3): the filter is linear in them."""
    moved = np.zeros((fixes.gains.shape[1], shift_m.shape[1]))
    changes = []
    for H, K, F, shift in zip(fixes.observations, fixes.gains, fixes.transitions, shift_m):
        moved = F @ moved
        changes.append(shift - (H @ moved).T)
        moved = moved + K @ changes[-1].T
    return np.array(changes)
