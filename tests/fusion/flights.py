"""A short flight with IMU and GPS off the camera, and flow with white errors of known size."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from flowlik.datasets import GpsFixes, ImuNoise, ImuSamples
from flowlik.fusion import ColouredGps, DirectionFactor, FusedState, FusionSettings, fuse
from flowlik.geometry.motion import exp_se3, relative_motion, scaled, skew
from flowlik.odometry import FlowFactor
from flowlik.simulation.inertial import (
    GRAVITY_N_MPS2,
    GpsModel,
    ImuModel,
    SmoothMotion,
    simulate_gps,
    simulate_imu,
)

FRAMES_PER_SECOND = 30.0
IMU = ImuModel(
    rate_hz=120.0,
    gyroscope_noise_density=2e-4,
    gyroscope_random_walk=2e-5,
    gyroscope_turn_on_sd=0.005,
    accelerometer_noise_density=2e-3,
    accelerometer_random_walk=3e-3,
    accelerometer_turn_on_sd=0.05,
    position_c_m=(0.1, -0.05, 0.2),
    rotation_c_i_rad=(0.3, -1.0, 0.4),
)
IDEAL = ImuModel(rate_hz=120.0, position_c_m=IMU.position_c_m, rotation_c_i_rad=IMU.rotation_c_i_rad)
ANTENNA_C_M = (-0.4, -0.6, 0.3)
GPS = GpsModel(position_c_m=ANTENNA_C_M)
NOISE = ImuNoise(*(getattr(IMU, name) for name in ImuNoise.__annotations__))
FLOW = np.diag(np.array([2e-3, 2e-3, 2e-3, 0.01, 0.01, 0.01]) ** 2)
FLOW[0, 4] = FLOW[4, 0] = 1.2e-5
START = np.repeat([0.004, 0.05, 0.5, IMU.gyroscope_turn_on_sd, IMU.accelerometer_turn_on_sd], 3)


@dataclass
class Flight:
    """True states at frames, and what is drawn around them."""

    imu: ImuSamples
    fixes: GpsFixes
    start: FusedState
    flows: list
    times_s: np.ndarray
    true: list

    def errors(self, states):
        """Errors (N, 9) of states at their times."""
        return np.array([error_of(state, *self.true[self.at(state)]) for state in states])

    def at(self, state):
        return int(np.argmin(abs(self.times_s - state.time_s)))


def error_of(state, R, v, p):
    theta = Rotation.from_matrix(state.R_n_b.T @ R).as_rotvec()
    return np.concatenate([theta, v - state.velocity_n_mps, p - state.position_n_m])


def settings(coloured=None, lag_s=1.0):
    T_b_c = IMU.T_c_i.inv()
    return FusionSettings(
        np.array(GRAVITY_N_MPS2), T_b_c, T_b_c.apply(np.array(ANTENNA_C_M)), coloured, lag_s
    )


def motion_of(seconds):
    """A turn that climbs and rolls."""
    s = np.arange(round(seconds * FRAMES_PER_SECOND) + 1) / FRAMES_PER_SECOND
    path = np.stack([2 * (1 - np.cos(1.5 * s)), 0.3 * np.sin(2 * s), 4 * np.sin(1.5 * s)], axis=1)
    turn = Rotation.from_rotvec(np.stack([0.2 * np.sin(2 * s), 1.2 * s, 0.3 * np.sin(s)], axis=1))
    return SmoothMotion(RigidTransform.from_components(path, turn), s)


def antenna_at(times_s):
    """True positions of the antenna."""
    return motion_of(2.0).at(times_s).positions_n_m(ANTENNA_C_M)


def drawn_flight(seed, seconds, form="given-rotation", gps=GPS, imu=IMU):
    """One draw of everything."""
    rng = np.random.default_rng(seed)
    motion = motion_of(seconds)
    measured = simulate_imu(motion, imu, seed)
    told = simulate_gps(motion, gps, seed)
    each = round(IMU.rate_hz / FRAMES_PER_SECOND)
    at = slice(None, None, each)
    times_s = measured.true_times_s[at]
    R, p, v = (
        measured.poses.rotation.as_matrix()[at],
        measured.poses.translation[at],
        measured.velocity_n_mps[at],
    )
    error = START * rng.standard_normal(15)
    start = FusedState(
        0.0, R[0] @ Rotation.from_rotvec(-error[:3]).as_matrix(), p[0] - error[6:9], v[0] - error[3:6],
        np.zeros(3), np.zeros(3), np.diag(START**2),
    )  # fmt: skip
    flows = []
    for k in range(1, len(times_s)):
        noise = np.linalg.cholesky(FLOW) @ rng.standard_normal(6)
        true = relative_motion(motion.poses[k - 1], motion.poses[k])
        if form == "direction":
            flows.append(drawn_direction(true, noise))
            continue
        T = exp_se3(noise) * true
        gain = FLOW[3:, :3] @ np.linalg.inv(FLOW[:3, :3])
        given = FlowFactor(form, T, FLOW[3:, 3:] - gain @ FLOW[:3, 3:], gain - skew(T.translation))
        flows.append(given if form == "given-rotation" else FlowFactor(form, T, FLOW, np.zeros((3, 3))))
    samples = ImuSamples(
        measured.times_s, measured.angular_rate_radps, measured.specific_force_mps2, NOISE, IMU.T_c_i
    )
    fixes = GpsFixes(told.times_s, told.positions_n_m, np.tile(told.sigma_m, (len(told.times_s), 1)))
    return Flight(samples, fixes, start, flows, times_s, list(zip(R, v, p)))


def drawn_direction(true, noise):
    """A direction with errors of FLOW, as of a step of 1 m, of which what lies along it is left out."""
    unit = scaled(true, 1.0)
    across = np.eye(6)
    across[3:, 3:] -= np.outer(unit.translation, unit.translation)
    measured = exp_se3(across @ noise) * unit
    return DirectionFactor("given-rotation", scaled(measured, 1.0), across @ FLOW @ across.T)


def fused(flight, coloured=None, fixes=None, lag_s=1.0):
    fixes = flight.fixes if fixes is None else fixes
    return fuse(flight.start, flight.times_s, flight.flows, flight.imu, fixes, settings(coloured, lag_s))


HALF = ColouredGps(0.5, 60.0)
