"""What `flowlik fuse` is given beside images: IMU, GPS, where they sit, and the start."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform, Rotation

from flowlik.commands.fuse_options import FuseOptions
from flowlik.datasets import GpsFixes, ImuSamples, read_gps, read_imu
from flowlik.datasets.inertial import GRAVITY_MPS2
from flowlik.datasets.initial_state import read_initial_state, read_sensor_pose, read_turn_on
from flowlik.errors import DataError
from flowlik.fusion import ColouredGps, FusedState, FusionSettings, TurnOn, covers
from flowlik.geometry.trajectory import Trajectory
from flowlik.support.arrays import Array

AXES = {
    f"{sign}{name}": factor * np.eye(3)[k]
    for k, name in enumerate("xyz")
    for sign, factor in (("", 1.0), ("+", 1.0), ("-", -1.0))
}
TRUE_START = np.repeat([np.deg2rad(0.2), 0.05, 0.5], 3)
"""Standard deviations of attitude [rad], velocity [m/s] and position [m] about the true start."""


@dataclass(frozen=True, eq=False)
class Sensors:
    """IMU and GPS of a flight, and how they sit.

    Attributes
    ----------
    imu : ImuSamples
        With noise; {b} is its frame.
    fixes : GpsFixes or None
        In {n}.
    settings : FusionSettings
        Gravity, lever arms, lag.
    turn_on : TurnOn
        Of the biases.
    """

    imu: ImuSamples
    fixes: GpsFixes | None
    settings: FusionSettings
    turn_on: TurnOn


def read_sensors(data: Path, options: FuseOptions) -> Sensors:
    """Read what the options name.

    Raises
    ------
    DataError
        If a file cannot be read, or what no filter may guess is missing: the IMU, its noise, where camera and
        antenna sit.
    """
    if options.imu is None:
        raise DataError("--imu is missing: a folder or file with an IMU, such as the sequence's own")
    imu = read_imu(options.imu, options.imu_sensor, options.imu_topic)
    imu = replace(imu, times_s=imu.times_s - options.imu_offset_s)
    sensor = options.imu_sensor or _beside(options.imu, "imu0")
    if imu.noise is None or sensor is None:
        raise DataError(
            f"{options.imu}: tells no noise densities; --imu-sensor names a YAML file with them "
            "(gyroscope_noise_density …, as EuRoC's sensor.yaml): there is no default"
        )
    if options.gps_coloured is not None and options.gps is None:
        raise DataError("--gps-coloured is of a GPS: give --gps too")
    fixes = None if options.gps is None else read_gps(options.gps, options.gps_topic)
    T_B_i = RigidTransform.identity() if imu.T_b_i is None else imu.T_b_i
    settings = FusionSettings(
        gravity_n_mps2=-GRAVITY_MPS2 * _up(options.up, fixes),
        T_b_c=T_B_i.inv() * _camera_pose(data, options.camera_pose),
        antenna_b_m=np.zeros(3) if options.gps is None else T_B_i.inv().apply(_antenna(options)),
        coloured=None if options.gps_coloured is None else ColouredGps(*options.gps_coloured),
        lag_s=options.lag_s,
        alignment_s=options.align_s if options.initial is None else 0.0,
    )
    return Sensors(imu, fixes, settings, TurnOn(*read_turn_on(sensor)))


def covered_frames(times_s: Array, imu: ImuSamples) -> NDArray[np.bool_]:
    """Which frames (N,) the IMU covers.

    Raises
    ------
    DataError
        If these are fewer than two.
    """
    covered = covers(imu, times_s)
    if covered.sum() < 2:
        raise DataError(
            f"IMU and images do not overlap: IMU from {imu.times_s[0]:.9g} to {imu.times_s[-1]:.9g} s, "
            f"images from {times_s[0]:.9g} to {times_s[-1]:.9g} s"
        )
    return covered


def given_start(
    options: FuseOptions, sensors: Sensors, time_s: float, truth: Trajectory | None
) -> FusedState | None:
    """The state at the first frame that the options give; None where it is to be found.

    Raises
    ------
    DataError
        If the file is damaged, or the truth is asked for and there is none in the frame of GPS.
    """
    if options.initial is None:
        return None
    turn_on = np.repeat([sensors.turn_on.gyroscope_radps, sensors.turn_on.accelerometer_mps2], 3)
    if options.initial != "truth":
        found = read_initial_state(options.initial)
        sigma = np.concatenate([found.deviations, turn_on])
        T, velocity = found.T_n_b, found.velocity_n_mps
        return _state(time_s, T.rotation.as_matrix(), T.translation, velocity, sigma)
    if truth is None:
        raise DataError("--initial truth: this data set has no poses")
    if sensors.fixes is not None and sensors.fixes.origin is not None:
        raise DataError("--initial truth: GPS told latitude and longitude, and poses are in another frame")
    T_c_b = sensors.settings.T_b_c.inv()
    poses, rng = truth.poses[:3] * T_c_b, np.random.default_rng([options.seed, 3])
    error = TRUE_START * rng.standard_normal(9)
    seconds = np.diff(truth.timestamps[:3])
    steps = np.diff(poses.translation, axis=0) / seconds[:, None]
    # a parabola through the first three positions
    velocity = steps[0] - (steps[-1] - steps[0]) * seconds[0] / seconds.sum()
    R = poses[0].rotation.as_matrix() @ Rotation.from_rotvec(-error[:3]).as_matrix()
    return _state(
        time_s,
        R,
        poses[0].translation - error[6:],
        velocity - error[3:6],
        np.concatenate([TRUE_START, turn_on]),
    )


def _state(time_s: float, R: Array, position: Array, velocity: Array, sigma: Array) -> FusedState:
    zero = np.zeros(3)
    return FusedState(time_s, R, position, velocity, zero, zero, np.diag(sigma**2))


def _beside(place: Path, name: str) -> Path | None:
    """``sensor.yaml`` of a sensor in EuRoC's layout."""
    folders = (place / "mav0" / name, place / name, place, place.parent)
    return next((f / "sensor.yaml" for f in folders if (f / "sensor.yaml").is_file()), None)


def _up(asked: str | None, fixes: GpsFixes | None) -> Array:
    if asked is None:
        asked = "-y" if fixes is None or fixes.origin is None else "z"
    if asked not in AXES:
        raise DataError(f"--up {asked!r} is no axis: x, y or z, or -x, -y, -z")
    return AXES[asked]


def _camera_pose(data: Path, asked: str | None) -> RigidTransform:
    """``T_B_c``: where the camera sits on the body."""
    if asked == "body":
        return RigidTransform.identity()
    if asked is not None:
        return read_sensor_pose(asked)
    for place in (data / "mav0" / "cam0", data / "cam0"):
        if (place / "sensor.yaml").is_file():
            return read_sensor_pose(place / "sensor.yaml")
    raise DataError(
        f"{data}: it is not known where the camera sits: --camera-pose names a YAML file with its T_BS, or "
        "is `body` where the IMU's T_BS is relative to the camera, as of simulated flights; there is no "
        "default"
    )


def _antenna(options: FuseOptions) -> Array:
    if options.antenna_m is not None:
        return np.array(options.antenna_m)
    place = None if options.gps is None else _beside(options.gps, "gps0")
    if place is None:
        raise DataError(
            f"{options.gps}: it is not known where the antenna sits: --antenna X,Y,Z [m] in the axes that "
            "the IMU's T_BS is relative to; there is no default"
        )
    return np.asarray(read_sensor_pose(place).translation)


def without_gps(sensors: Sensors) -> Sensors:
    """The same, as if there were no GPS."""
    return replace(sensors, fixes=None, settings=replace(sensors.settings, coloured=None))
