"""GTSAM's built-in factors of IMU and GPS, and the order of its tangents."""

from __future__ import annotations

from typing import Any

import numpy as np

from flowlik.datasets.inertial import ImuNoise
from flowlik.errors import DataError
from flowlik.fusion.state import FusedState, FusionSettings, GpsFix, ImuSegment
from flowlik.geometry.motion import skew
from flowlik.support.arrays import Array

# of the integration itself: keeps the covariance of a step positive definite
INTEGRATION_VARIANCE = 1e-12


def imu_parameters(gtsam: Any, noise: ImuNoise, gravity_n_mps2: Array) -> Any:
    """Noise of preintegration.

    Raises
    ------
    DataError
        If a density is not positive: a sensor without noise cannot be weighed.
    """
    for name, value in vars(noise).items():
        if not 0 < value < np.inf:
            raise DataError(f"{name} is {value:g}, must be above 0: an IMU without noise cannot be weighed")
    parameters = gtsam.PreintegrationCombinedParams(np.asarray(gravity_n_mps2, dtype=np.float64))
    one = np.eye(3)
    parameters.setGyroscopeCovariance(one * noise.gyroscope_noise_density**2)
    parameters.setAccelerometerCovariance(one * noise.accelerometer_noise_density**2)
    parameters.setBiasOmegaCovariance(one * noise.gyroscope_random_walk**2)
    parameters.setBiasAccCovariance(one * noise.accelerometer_random_walk**2)
    parameters.setIntegrationCovariance(one * INTEGRATION_VARIANCE)
    return parameters


def preintegrated(gtsam: Any, parameters: Any, bias: Any, segment: ImuSegment) -> Any:
    """Preintegrated IMU of a segment about a bias."""
    whole = gtsam.PreintegratedCombinedMeasurements(parameters, bias)
    for step_s, rate, force in zip(segment.steps_s.tolist(), segment.rates_radps, segment.forces_mps2):
        whole.integrateMeasurement(force, rate, step_s)
    return whole


def pose3(gtsam: Any, state: FusedState) -> Any:
    """GTSAM's pose ``T_n_b`` of a state."""
    return gtsam.Pose3(gtsam.Rot3(state.R_n_b), state.position_n_m)


def start_factors(gtsam: Any, start: FusedState, keys: tuple[int, ...]) -> tuple[Any, Any]:
    """Prior of the first node as a graph, and its values: all correlations of the start are kept.

    Raises
    ------
    DataError
        If the start's covariance is not positive definite.
    """
    pose, velocity, bias = keys
    values = gtsam.Values()
    values.insert(pose, pose3(gtsam, start))
    values.insert(velocity, np.asarray(start.velocity_n_mps, dtype=np.float64))
    values.insert(bias, gtsam.imuBias.ConstantBias(start.accelerometer_bias_mps2, start.gyroscope_bias_radps))
    M = to_error_state(start.R_n_b)
    try:
        root = np.linalg.inv(np.linalg.cholesky(start.covariance)) @ M
    except np.linalg.LinAlgError as error:
        raise DataError("the covariance of the start is not positive definite") from error
    unit = gtsam.noiseModel.Unit.Create(15)
    blocks = (pose, root[:, :6], velocity, root[:, 6:9], bias, root[:, 9:15])
    prior = gtsam.JacobianFactor(*blocks, np.zeros(15), unit)
    graph = gtsam.NonlinearFactorGraph()
    graph.add(gtsam.LinearContainerFactor(prior, values))
    return graph, values


def to_error_state(R_n_b: Array, coloured: bool = False) -> Array:
    """Matrix (15, 15) or (18, 18) from GTSAM's tangents of pose, velocity, bias to the error state.

    GTSAM's are: rotation and translation in the body, velocity, bias of accelerometer and of gyroscope.
    """
    size = 18 if coloured else 15
    M = np.zeros((size, size))
    one = np.eye(3)
    M[0:3, 0:3] = one
    M[3:6, 6:9] = one
    M[6:9, 3:6] = R_n_b
    M[9:12, 12:15] = one
    M[12:15, 9:12] = one
    if coloured:
        M[15:18, 15:18] = one
    return M


def gps_observation(R_n_b: Array, settings: FusionSettings, coloured_m: Array | None) -> Array:
    """Derivative (3, n) of the antenna's measured position by the error state."""
    H = np.zeros((3, 15 if coloured_m is None else 18))
    H[:, 0:3] = -R_n_b @ skew(settings.antenna_b_m)
    H[:, 6:9] = np.eye(3)
    if coloured_m is not None:
        H[:, 15:18] = coloured_m
    return H


def gps_factor(gtsam: Any, pose_key: int, fix: GpsFix, settings: FusionSettings, white_m2: Array) -> Any:
    """Position of the antenna with white errors of covariance (3, 3) [m²]."""
    noise = gtsam.noiseModel.Gaussian.Covariance(white_m2)
    return gtsam.GPSFactorArm(pose_key, fix.position_n_m, settings.antenna_b_m, noise)


def biased_gps_factor(
    gtsam: Any, keys: tuple[int, int], at: Any, innovation_m: Array, H: Array, R_n_b: Array, white_m2: Array
) -> Any:
    """Position of the antenna with a bias, linear about the estimates ``at`` of pose and bias."""
    noise = gtsam.noiseModel.Gaussian.Covariance(white_m2)
    of_pose = np.hstack([H[:, 0:3], H[:, 6:9] @ R_n_b])
    linear = gtsam.JacobianFactor(keys[0], of_pose, keys[1], H[:, 15:18], innovation_m, noise)
    return gtsam.LinearContainerFactor(linear, at)


def gps_bias_factor(gtsam: Any, keys: tuple[int, ...], kept: float) -> Any:
    """Unit Gauss-Markov bias: its stationary prior, of one key, or what the second keeps of the first."""
    zero = gtsam.Values()
    for key in keys:
        zero.insert(key, np.zeros(3))
    one = np.eye(3)
    if len(keys) == 1:
        noise = gtsam.noiseModel.Unit.Create(3)
        linear = gtsam.JacobianFactor(keys[0], one, np.zeros(3), noise)
    else:
        noise = gtsam.noiseModel.Isotropic.Sigma(3, float(np.sqrt(1 - kept**2)))
        linear = gtsam.JacobianFactor(keys[0], -kept * one, keys[1], one, np.zeros(3), noise)
    return gtsam.LinearContainerFactor(linear, zero)
