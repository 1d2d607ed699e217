"""Flights through a world: camera-to-world poses, a function of the distance flown.

A pose depends on the distance only, so a faster flight passes through the same poses in fewer frames.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from flowlik.errors import DataError
from flowlik.geometry.times import check_times
from flowlik.simulation.worlds.paths import LOOP_LENGTH_M, figure_eight, figure_eight_curvature, straight_line
from flowlik.support.arrays import Array

BANK_M = 1.5
"""Bank of the figure eight [rad] over its curvature [1/m]: about 9 degrees in the sharpest turn."""

HOVER_Z_M = 50.0


@dataclass(frozen=True, eq=False)
class Flight:
    """Poses of a camera with their times, and what is known of them.

    Parameters
    ----------
    poses : RigidTransform (N,)
        T_n_c of each frame: camera (x right, y down, z forward) to world [m].
    times_s : array (N,)
        Time of each frame [s].
    frames_per_second : float
        Mean frame rate [1/s].
    name, speed_mps : str, float or None
        Where the poses come from, for provenance only.
    clock_start_s : float, optional
        Time [s] at which the world's clock is 0; by default that of the first frame.

    Raises
    ------
    DataError
        If there are no poses, a pose is not a rigid motion, the frame rate is not positive, or times do not
        increase.
    """

    poses: RigidTransform
    times_s: Array
    frames_per_second: float
    name: str = "given poses"
    speed_mps: float | None = None
    clock_start_s: float | None = None

    def __post_init__(self) -> None:
        if self.poses.single or len(self.poses) == 0:
            raise DataError(f"{self.name}: a flight needs an array of at least one pose")
        _check_rate(self.frames_per_second, self.name)
        if len(self.times_s) != len(self.poses):
            raise DataError(f"{self.name}: {len(self.times_s)} timestamps for {len(self.poses)} poses")
        check_times(self.times_s, self.name)
        _check_rigid(self.poses, self.name)

    @classmethod
    def of(
        cls,
        poses: RigidTransform,
        frames_per_second: float = 60.0,
        name: str = "given poses",
        speed_mps: float | None = None,
    ) -> Flight:
        """Fly through poses at an even rate: frame k at k / frames_per_second."""
        _check_rate(frames_per_second, name)
        count = 0 if poses.single else len(poses)
        return cls(poses, np.arange(count) / frames_per_second, frames_per_second, name, speed_mps)

    def part(self, first: int, count: int | None = None) -> Flight:
        """Frames from one on, so many or all that follow, at the times of the whole flight."""
        kept = slice(first, None if count is None else first + count)
        start_s = float(self.times_s[0]) if self.clock_start_s is None else self.clock_start_s
        return replace(self, poses=self.poses[kept], times_s=self.times_s[kept], clock_start_s=start_s)


def straight(
    frames: int, speed_mps: float = 6.0, frames_per_second: float = 60.0, seed: int = 0
) -> RigidTransform:
    """Fly straight along z at constant speed and attitude (the paper's *straight*); the seed changes nothing.

    Parameters
    ----------
    frames : int
        Number of poses.
    speed_mps : float
        Speed [m/s].
    frames_per_second : float
        Frame rate [1/s].
    seed : int
        Unused; every trajectory takes the same parameters.

    Returns
    -------
    RigidTransform
        T_n_c of each frame: camera (x right, y down, z forward) to world [m].
    """
    positions_m, headings = straight_line(_distance_m(frames, speed_mps, frames_per_second))
    return _poses(positions_m, np.stack([headings, headings, headings], axis=-1))


def curve(
    frames: int, speed_mps: float = 6.0, frames_per_second: float = 60.0, seed: int = 0
) -> RigidTransform:
    """Fly along z with gentle bobbing: 0.8 m sideways, 0.5 m vertically, 7 deg yaw, 4 deg pitch, 6 deg roll.

    Parameters and return value are those of `straight`; the seed draws the phases.
    """
    rng = np.random.default_rng(seed)
    distance_m = _distance_m(frames, speed_mps, frames_per_second)
    positions_m, _ = straight_line(distance_m)
    offsets_m = _wander(distance_m, (0.8, 0.5), (8.0, 25.0), rng)
    attitude = _wander(distance_m, np.deg2rad([7, 4, 6]), (8.0, 25.0), rng)
    positions_m[:, :2] += offsets_m
    return _poses(positions_m, attitude)


def training(
    frames: int, speed_mps: float = 6.0, frames_per_second: float = 60.0, seed: int = 0
) -> RigidTransform:
    """Fly a figure eight in all six degrees of freedom, with speed changing by up to 60 % about its mean.

    Parameters and return value are those of `straight`; the seed draws where the flight starts and all
    phases. `speed_mps` is the mean speed along the eight, which is closed: any number
    of frames may be flown.
    """
    rng = np.random.default_rng(seed)
    surge_length_m, surge_phase, start_m = 18.0, rng.uniform(0, 2 * np.pi), rng.uniform(0, 200)
    mean_m = _distance_m(frames, speed_mps, frames_per_second)
    surge = np.sin(2 * np.pi * mean_m / surge_length_m + surge_phase)
    distance_m = start_m + mean_m + 0.6 * surge_length_m / (2 * np.pi) * surge
    positions_m, headings = figure_eight(distance_m)
    attitude = _wander(distance_m, np.deg2rad([30, 18, 25]), (5.0, 25.0), rng)
    positions_m += _wander(distance_m, (0.8, 0.7, 0.3), (5.0, 25.0), rng)
    attitude[:, 0] += headings
    return _poses(positions_m, attitude)


def forest_fig8(
    frames: int, speed_mps: float = 6.0, frames_per_second: float = 60.0, seed: int = 0
) -> RigidTransform:
    """Fly a closed, level figure eight of 198 m at constant speed, looking ahead and banking into turns.

    Parameters and return value are those of `straight`; the seed changes nothing. Laps follow one another;
    a flight of `lap_frames` frames ends in the pose in which it began.
    """
    distance_m = _distance_m(frames, speed_mps, frames_per_second)
    positions_m, headings = figure_eight(distance_m)
    bank = BANK_M * figure_eight_curvature(distance_m)
    return _poses(positions_m, np.stack([headings, np.zeros_like(bank), bank], axis=-1))


def lap_frames(speed_mps: float = 6.0, frames_per_second: float = 60.0, laps: int = 1) -> int:
    """Frames of `forest_fig8` whose last pose is the first one again, or within half a step of it.

    It is the same pose where a lap of 198 m is a whole number of steps, as at 6 m/s and 60 frames/s.
    """
    if not (speed_mps > 0 and frames_per_second > 0 and laps > 0):
        raise DataError(
            f"impossible lap at {speed_mps} m/s and {frames_per_second} frames/s: must be positive"
        )
    return 1 + round(laps * LOOP_LENGTH_M * frames_per_second / speed_mps)


def hover(
    frames: int, speed_mps: float = 6.0, frames_per_second: float = 60.0, seed: int = 0
) -> RigidTransform:
    """Stand still in the middle of the scene, looking along z.

    Parameters and return value are those of `straight`; speed and seed change nothing.
    """
    still = np.zeros_like(_distance_m(frames, speed_mps, frames_per_second))
    positions_m, headings = straight_line(still + HOVER_Z_M)
    return _poses(positions_m, np.stack([headings, headings, headings], axis=-1))


TRAJECTORIES: dict[str, Callable[[int, float, float, int], RigidTransform]] = {
    "straight": straight,
    "curve": curve,
    "training": training,
    "forest-fig8": forest_fig8,
    "hover": hover,
}


def _distance_m(frames: int, speed_mps: float, frames_per_second: float) -> Array:
    if frames < 1 or frames_per_second <= 0 or not np.isfinite([speed_mps, frames_per_second]).all():
        raise DataError(
            f"impossible flight of {frames} frames at {speed_mps} m/s and {frames_per_second} frames/s: "
            "frames and frame rate must be positive"
        )
    return np.arange(frames, dtype=np.float64) * (speed_mps / frames_per_second)


def _wander(
    distance_m: Array,
    amplitudes: Array | tuple[float, ...],
    wavelengths_m: tuple[float, float],
    rng: np.random.Generator,
) -> Array:
    """Smooth functions (N, len(amplitudes)) of the distance, bounded by amplitudes: four sines each."""
    shape = (len(amplitudes), 4)
    lengths_m = np.exp(rng.uniform(np.log(wavelengths_m[0]), np.log(wavelengths_m[1]), shape))
    phases = rng.uniform(0, 2 * np.pi, shape)
    weights = lengths_m / lengths_m.sum(axis=1, keepdims=True)
    waves = np.sin(2 * np.pi * distance_m[:, None, None] / lengths_m + phases)
    return np.asarray((weights * waves).sum(axis=-1) * np.asarray(amplitudes))


def _poses(positions_m: Array, yaw_pitch_roll: Array) -> RigidTransform:
    """T_n_c from positions (N, 3) and intrinsic angles about y, x, z (N, 3) [rad]."""
    return RigidTransform.from_components(positions_m, Rotation.from_euler("YXZ", yaw_pitch_roll))


def _check_rate(frames_per_second: float, name: str) -> None:
    if not 0 < frames_per_second < np.inf:
        raise DataError(f"{name}: frame rate {frames_per_second} must be positive")


def _check_rigid(poses: RigidTransform, name: str) -> None:
    matrices = np.asarray(poses.as_matrix())
    R = matrices[:, :3, :3]
    # NaN compares as not small
    rigid = np.abs(R @ R.transpose(0, 2, 1) - np.eye(3)).max(axis=(1, 2)) < 1e-6
    bad = np.flatnonzero(~(rigid & np.isfinite(matrices).all(axis=(1, 2))))
    if bad.size:
        raise DataError(f"{name}: pose of frame {bad[0]} is not finite and orthonormal")
