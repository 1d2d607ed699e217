"""A motion in continuous time through the poses of frames: what its derivatives are at any moment."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.interpolate import BSpline, make_interp_spline
from scipy.spatial.transform import RigidTransform, Rotation

from flowlik.errors import DataError
from flowlik.geometry.times import check_times
from flowlik.support.arrays import Array

DEGREE = 5
FEWEST_POSES = DEGREE + 1
LARGEST_TURN_RAD = np.pi / 2


@dataclass(frozen=True, eq=False)
class Kinematics:
    """Poses and their derivatives at N moments.

    Attributes
    ----------
    times_s : array (N,)
        Moments [s].
    poses : RigidTransform of N
        ``T_n_c`` [m].
    velocity_n_mps : array (N, 3)
        Velocity [m/s] of the camera in {n}.
    acceleration_n_mps2 : array (N, 3)
        Acceleration [m/s²] of the camera in {n}, without gravity.
    angular_rate_c_radps : array (N, 3)
        Angular velocity [rad/s] of {c} against {n}, in {c}.
    angular_acceleration_c_radps2 : array (N, 3)
        Its derivative [rad/s²], in {c}.
    """

    times_s: Array
    poses: RigidTransform
    velocity_n_mps: Array
    acceleration_n_mps2: Array
    angular_rate_c_radps: Array
    angular_acceleration_c_radps2: Array

    def positions_n_m(self, position_c_m: Array | tuple[float, ...] = (0.0, 0.0, 0.0)) -> Array:
        """Positions (N, 3) [m] in {n} of a point that is fixed in {c}."""
        return np.asarray(self.poses.apply(np.asarray(position_c_m, dtype=np.float64)))

    def velocity_at(self, position_c_m: Array | tuple[float, ...]) -> Array:
        """Velocity (N, 3) [m/s] in {n} of a point that is fixed in {c}."""
        turning = np.cross(self.angular_rate_c_radps, position_c_m)
        return np.asarray(self.velocity_n_mps + self.poses.rotation.apply(turning))

    def acceleration_at(self, position_c_m: Array | tuple[float, ...]) -> Array:
        """Acceleration (N, 3) [m/s²] in {n} of a point that is fixed in {c}, without gravity."""
        rate = self.angular_rate_c_radps
        tangential = np.cross(self.angular_acceleration_c_radps2, position_c_m)
        centripetal = np.cross(rate, np.cross(rate, position_c_m))
        return np.asarray(self.acceleration_n_mps2 + self.poses.rotation.apply(tangential + centripetal))


@dataclass(frozen=True, eq=False)
class SmoothMotion:
    """A motion through given poses, four times continuously differentiable.

    Positions, and quaternions of one sign, are splines of degree 5 that pass through every pose; quaternions
    are normalised between. The motion is thus the frames' own, whatever they are: a flight that is a formula,
    or a file of poses. What noise a file's poses have is acceleration here.

    Parameters
    ----------
    poses : RigidTransform of N
        ``T_n_c`` [m], at least six.
    times_s : array (N,)
        Their times [s], increasing.

    Raises
    ------
    DataError
        If there are fewer than six poses, times do not increase, or two that follow turn by more than 90 deg.
    """

    poses: RigidTransform
    times_s: Array

    def __post_init__(self) -> None:
        count = 1 if self.poses.single else len(self.poses)
        if count < FEWEST_POSES:
            raise DataError(f"an IMU or GPS needs at least {FEWEST_POSES} frames, here are {count}")
        if len(self.times_s) != count:
            raise DataError(f"{len(self.times_s)} times for {count} poses")
        check_times(np.asarray(self.times_s, dtype=np.float64), "motion")
        turns = (self.poses.rotation[:-1].inv() * self.poses.rotation[1:]).magnitude()
        if turns.max() > LARGEST_TURN_RAD:
            k, turn = int(turns.argmax()), np.rad2deg(turns.max())
            raise DataError(f"frames {k} and {k + 1} turn by {turn:.0f} deg, too much for a smooth motion")

    @property
    def start_s(self) -> float:
        """Time [s] of the first pose."""
        return float(self.times_s[0])

    @property
    def end_s(self) -> float:
        """Time [s] of the last pose."""
        return float(self.times_s[-1])

    @cached_property
    def _splines(self) -> tuple[BSpline, BSpline]:
        # from the start on: times of an epoch would cost the spline's digits
        since_s = np.asarray(self.times_s) - self.start_s
        quaternions = self.poses.rotation.as_quat()
        flips = np.sign((quaternions[:-1] * quaternions[1:]).sum(axis=1))
        quaternions[1:] *= np.cumprod(flips)[:, None]
        positions_m = np.asarray(self.poses.translation)
        return make_interp_spline(since_s, positions_m, DEGREE), make_interp_spline(
            since_s, quaternions, DEGREE
        )

    def sample_times(self, rate_hz: float) -> Array:
        """Times (N,) [s] from the first pose to the last at a rate [1/s]."""
        count = int(np.floor((self.end_s - self.start_s) * rate_hz * (1 + 1e-12) + 1e-9)) + 1
        return self.start_s + np.arange(count) / rate_hz

    def at(self, times_s: Array) -> Kinematics:
        """Poses and their derivatives at times (N,) [s].

        Raises
        ------
        DataError
            If a time lies before the first pose or after the last.
        """
        times_s = np.asarray(times_s, dtype=np.float64)
        slack_s = 1e-9 * max(1.0, self.end_s - self.start_s)
        outside = (times_s < self.start_s - slack_s) | (times_s > self.end_s + slack_s)
        if outside.any():
            bad_s = float(times_s[outside][0])
            raise DataError(f"time {bad_s:g} s lies outside the motion, {self.start_s:g} to {self.end_s:g} s")
        since_s = np.clip(times_s - self.start_s, 0.0, self.end_s - self.start_s)
        position, quaternion = self._splines
        q, dq, ddq = quaternion(since_s), quaternion(since_s, 1), quaternion(since_s, 2)
        squared = (q * q).sum(axis=1, keepdims=True)
        rate = 2 * _vector_part(q, dq) / squared
        growth = 2 * (q * dq).sum(axis=1, keepdims=True) / squared
        poses = RigidTransform.from_components(position(since_s), Rotation.from_quat(q))
        return Kinematics(
            times_s=times_s,
            poses=poses,
            velocity_n_mps=position(since_s, 1),
            acceleration_n_mps2=position(since_s, 2),
            angular_rate_c_radps=rate,
            angular_acceleration_c_radps2=2 * _vector_part(q, ddq) / squared - growth * rate,
        )


def _vector_part(q: Array, p: Array) -> Array:
    """Vector part (N, 3) of conj(q) p, quaternions x y z w (N, 4)."""
    return np.asarray(q[:, 3:] * p[:, :3] - p[:, 3:] * q[:, :3] - np.cross(q[:, :3], p[:, :3]))
