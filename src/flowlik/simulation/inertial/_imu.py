"""An inertial measurement unit beside the camera: what it would measure along a motion."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from flowlik.errors import DataError
from flowlik.simulation.inertial._kinematics import Kinematics, SmoothMotion
from flowlik.support.arrays import Array

GRAVITY_N_MPS2 = (0.0, 9.80665, 0.0)
"""Gravity [m/s²] in {n}, whose y axis points down: standard gravity."""

_IMU_STREAM = 1
_MG = 9.80665e-3


@dataclass(frozen=True)
class ImuModel:
    """How an IMU sits beside the camera, and how it errs.

    Each axis reads truth + bias + white noise. The bias begins as a draw of the turn-on deviation and walks
    at random. Densities are of continuous time, as in EuRoC's ``sensor.yaml`` and Kalibr; a sample's white
    noise has the deviation density · sqrt(rate).

    Attributes
    ----------
    rate_hz : float
        Samples a second.
    gyroscope_noise_density : float
        [rad/s/√Hz].
    gyroscope_random_walk : float
        [rad/s²/√Hz].
    gyroscope_turn_on_sd : float
        Standard deviation [rad/s] of each axis' first bias.
    accelerometer_noise_density : float
        [m/s²/√Hz].
    accelerometer_random_walk : float
        [m/s³/√Hz].
    accelerometer_turn_on_sd : float
        Standard deviation [m/s²] of each axis' first bias.
    position_c_m : tuple of 3 float
        Where it sits [m] in {c}: the lever arm.
    rotation_c_i_rad : tuple of 3 float
        Rotation vector [rad] of ``R_c_i``, which takes the IMU's axes {i} to the camera's.
    time_offset_s : float
        Its stamp minus the camera's clock [s]: positive where the IMU is stamped late.
    """

    rate_hz: float = 200.0
    gyroscope_noise_density: float = 0.0
    gyroscope_random_walk: float = 0.0
    gyroscope_turn_on_sd: float = 0.0
    accelerometer_noise_density: float = 0.0
    accelerometer_random_walk: float = 0.0
    accelerometer_turn_on_sd: float = 0.0
    position_c_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    rotation_c_i_rad: tuple[float, float, float] = (0.0, 0.0, 0.0)
    time_offset_s: float = 0.0

    def __post_init__(self) -> None:
        numbers = [value for name, value in vars(self).items() if name.endswith(("density", "walk", "sd"))]
        everything = [*numbers, self.rate_hz, *self.position_c_m, *self.rotation_c_i_rad, self.time_offset_s]
        if not np.isfinite(everything).all() or min(numbers) < 0 or self.rate_hz <= 0:
            raise DataError(f"impossible IMU: rate must be above 0, noise finite and not negative: {self}")

    @property
    def T_c_i(self) -> RigidTransform:
        """Takes points in the IMU's axes to the camera's [m]."""
        return RigidTransform.from_components(self.position_c_m, Rotation.from_rotvec(self.rotation_c_i_rad))


IMU_PRESETS: dict[str, ImuModel] = {
    "ideal": ImuModel(),
    "adis16448": ImuModel(
        gyroscope_noise_density=1.6968e-4,
        gyroscope_random_walk=1.9393e-5,
        gyroscope_turn_on_sd=float(np.deg2rad(0.5)),
        accelerometer_noise_density=2.0e-3,
        accelerometer_random_walk=3.0e-3,
        accelerometer_turn_on_sd=20 * _MG,
    ),
    "mpu6050": ImuModel(
        gyroscope_noise_density=float(np.deg2rad(0.005)),
        gyroscope_random_walk=2.2e-5,
        gyroscope_turn_on_sd=float(np.deg2rad(1.0)),
        accelerometer_noise_density=0.4 * _MG,
        accelerometer_random_walk=8.6e-4,
        accelerometer_turn_on_sd=50 * _MG,
    ),
}
"""IMUs by name. *adis16448* (industrial MEMS): densities of EuRoC's ``imu0/sensor.yaml``, turn-on of RotorS.

*mpu6050* (consumer MEMS): densities and zero-g tolerance of its product specification 3.4, whose gyro
tolerance of 20 deg/s is taken to be calibrated to 1 deg/s at rest; it has no random walk, which is that of
TUM VI's calibration of a BMI160.
"""


@dataclass(frozen=True, eq=False)
class SimulatedImu:
    """What an IMU measured, with what it should have.

    Attributes
    ----------
    times_s : array (N,)
        Stamps [s]: true time plus the model's offset.
    angular_rate_radps : array (N, 3)
        Measured angular velocity [rad/s] in {i}.
    specific_force_mps2 : array (N, 3)
        Measured acceleration minus gravity [m/s²] in {i}.
    gyroscope_bias_radps, accelerometer_bias_mps2 : array (N, 3)
        True biases.
    true_times_s : array (N,)
        Times [s] of the camera's clock.
    poses : RigidTransform of N
        True ``T_n_i`` [m].
    velocity_n_mps : array (N, 3)
        True velocity [m/s] of the IMU in {n}.
    """

    times_s: Array
    angular_rate_radps: Array
    specific_force_mps2: Array
    gyroscope_bias_radps: Array
    accelerometer_bias_mps2: Array
    true_times_s: Array
    poses: RigidTransform
    velocity_n_mps: Array


def ideal_imu(motion: Kinematics, model: ImuModel) -> tuple[Array, Array]:
    """Angular rate (N, 3) [rad/s] and specific force (N, 3) [m/s²] in {i}, free of errors.

    Parameters
    ----------
    motion : Kinematics
        Of the camera.
    model : ImuModel
        Where the IMU sits.
    """
    R_i_c = model.T_c_i.rotation.inv()
    force_n = motion.acceleration_at(model.position_c_m) - GRAVITY_N_MPS2
    force_c = motion.poses.rotation.inv().apply(force_n)
    return np.asarray(R_i_c.apply(motion.angular_rate_c_radps)), np.asarray(R_i_c.apply(force_c))


def imu_errors(count: int, model: ImuModel, seed: int) -> tuple[Array, Array]:
    """Biases and white noise (N, 6) of N samples: three of the gyroscope [rad/s], three of the accelerometer.

    Parameters
    ----------
    count : int
        N.
    model : ImuModel
        The IMU.
    seed : int
        Seed of both.
    """
    first, steps, white = (
        np.random.default_rng([seed, _IMU_STREAM, part]).standard_normal((count, 6)) for part in range(3)
    )
    turn_on = np.repeat([model.gyroscope_turn_on_sd, model.accelerometer_turn_on_sd], 3)
    walk = np.repeat([model.gyroscope_random_walk, model.accelerometer_random_walk], 3)
    density = np.repeat([model.gyroscope_noise_density, model.accelerometer_noise_density], 3)
    steps[0] = 0
    bias = turn_on * first[0] + walk * np.cumsum(steps, axis=0) / np.sqrt(model.rate_hz)
    return bias, density * np.sqrt(model.rate_hz) * white


def simulate_imu(motion: SmoothMotion, model: ImuModel, seed: int) -> SimulatedImu:
    """Measure a motion by an IMU, from the first pose to the last.

    A sample is the value at its moment, not the mean over a period. Equal seeds give equal bits, and a longer
    motion begins with the same draws. Scale errors, axes that are not square, saturation, rounding, vibration
    and the earth's turning are not simulated.

    Parameters
    ----------
    motion : SmoothMotion
        Of the camera.
    model : ImuModel
        The IMU.
    seed : int
        Seed of its errors; those of a GPS of the same seed are independent of them.
    """
    times_s = motion.sample_times(model.rate_hz)
    true = motion.at(times_s)
    rate, force = ideal_imu(true, model)
    bias, white = imu_errors(len(times_s), model, seed)
    error = bias + white
    return SimulatedImu(
        times_s=times_s + model.time_offset_s,
        angular_rate_radps=rate + error[:, :3],
        specific_force_mps2=force + error[:, 3:],
        gyroscope_bias_radps=bias[:, :3],
        accelerometer_bias_mps2=bias[:, 3:],
        true_times_s=times_s,
        poses=true.poses * model.T_c_i,
        velocity_n_mps=true.velocity_at(model.position_c_m),
    )
