"""An error-state Kalman filter of IMU, GPS and flow, for many draws at once: the judge of what flow claims.

The camera carries the IMU (the same axes and place), y points down, and {n} has gravity along +y. The state
of each draw is attitude R_n_c, velocity and position in {n}, and the biases of gyroscope and accelerometer;
beside it stands the pose of the last image, to which flow is relative (stochastic cloning, Roumeliotis and
Burdick 2002), and, if asked for, what stays of flow's errors: a Gauss-Markov bias in stated deviations of a
translation given the rotation, and what stays of GPS's, in metres. The error is the right perturbation
R exp(theta), and differences of all else, truth minus estimate. Of every fix the filter keeps what a monitor
of GPS needs, linearised at the first draw.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import make_interp_spline
from scipy.spatial.transform import RigidTransform, Rotation, RotationSpline

from flowlik.fusion import GpsInnovations
from flowlik.geometry.motion import skew
from flowlik.likelihood.over_time import Persistence
from flowlik.odometry import FlowFactor

GRAVITY_N_MPS2 = np.array([0.0, 9.81, 0.0])
THETA, V, P, BG, BA, THETA_LAST, P_LAST, B_FLOW = (slice(3 * i, 3 * i + 3) for i in range(8))
B_GPS = slice(24, 27)  # only where a bias of GPS is asked for
ERRORS = 24
WHITE_AT_LEAST = 0.01  # of a stated variance, where all of it stays


@dataclass(frozen=True)
class Imu:
    """Noise densities of an IMU, by default of EuRoC's ADIS16448 (`sensor.yaml`), and turn-on biases."""

    rate_hz: float = 240.0
    gyroscope: float = 1.6968e-4  # rad/s/sqrt(Hz)
    accelerometer: float = 2.0e-3  # m/s^2/sqrt(Hz)
    gyroscope_walk: float = 1.9393e-5  # rad/s^2/sqrt(Hz)
    accelerometer_walk: float = 3.0e-3  # m/s^3/sqrt(Hz)
    gyroscope_bias: float = np.deg2rad(0.3)  # rad/s
    accelerometer_bias: float = 0.05  # m/s^2


@dataclass(frozen=True)
class Start:
    """Standard deviations of what is known of the state at the start.

    Much less known, and the filter's linearisation is wrong by more than flow's errors are: with 2 deg and
    0.5 m/s NEES is 20 to 100 where 9 is honest, even if flow's errors are drawn white.
    """

    attitude_rad: float = np.deg2rad(0.2)
    velocity_mps: float = 0.05
    position_m: float = 0.5


@dataclass(frozen=True)
class Coloured:
    """The part of a GPS receiver's error that stays: standard deviation of an axis, and memory."""

    sigma_m: float
    memory_s: float


@dataclass(frozen=True, eq=False)
class Truth:
    """True attitude (N, 3, 3), velocity and position (N, 3) of samples, and the ideal IMU (N, 3)."""

    times_s: np.ndarray
    R: np.ndarray
    v: np.ndarray
    p: np.ndarray
    rate: np.ndarray
    force: np.ndarray


def true_flight(poses: RigidTransform, times_s: np.ndarray, rate_hz: float) -> Truth:
    """A smooth flight through poses ``T_n_c``, and what an ideal IMU on the camera measures."""
    count = round((times_s[-1] - times_s[0]) * rate_hz) + 1
    at = np.linspace(times_s[0], times_s[-1], count)
    position, turn = (
        make_interp_spline(times_s, poses.translation, 5),
        RotationSpline(times_s, poses.rotation),
    )
    R = turn(at).as_matrix()
    force = np.einsum("nji,nj->ni", R, position(at, 2) - GRAVITY_N_MPS2)
    # RotationSpline tells rates in the body
    return Truth(at, R, position(at, 1), position(at), turn(at, 1), force)


def drawn_imu(truth: Truth, imu: Imu, draws: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Angular rates and specific forces (N, draws, 3) with noise, turn-on biases and their walks."""
    measured = []
    for ideal, density, walk, bias in (
        (truth.rate, imu.gyroscope, imu.gyroscope_walk, imu.gyroscope_bias),
        (truth.force, imu.accelerometer, imu.accelerometer_walk, imu.accelerometer_bias),
    ):
        shape = (len(ideal), draws, 3)
        steps = rng.standard_normal(shape) * walk / np.sqrt(imu.rate_hz)
        steps[0] = bias * rng.standard_normal(shape[1:])
        white = density * np.sqrt(imu.rate_hz) * rng.standard_normal(shape)
        measured.append(ideal[:, None] + np.cumsum(steps, axis=0) + white)
    return measured[0], measured[1]


class ErrorStateFilter:
    """States of many draws, and one covariance (24, 24) a draw.

    Parameters
    ----------
    truth : Truth
        Whose first sample the start is drawn around.
    imu, start
        What the filter believes; the same that draws.
    draws : int
        How many.
    rng : Generator
        Of the start's errors.
    stays : Persistence, optional
        How flow's errors stay, for a bias that is estimated; flow's factors are then of one motion each.
    coloured : Coloured, optional
        What stays of GPS's errors, for a bias that is estimated.
    """

    def __init__(
        self,
        truth: Truth,
        imu: Imu,
        start: Start,
        draws: int,
        rng: np.random.Generator,
        stays: Persistence | None = None,
        coloured: Coloured | None = None,
    ) -> None:
        self.imu, self.draws, self.stays, self.coloured = imu, draws, stays, coloured
        self.count = ERRORS if coloured is None else ERRORS + 3
        sigma = np.repeat([start.attitude_rad, start.velocity_mps, start.position_m], 3)
        error = sigma * rng.standard_normal((draws, 9))
        # truth is the estimate with its error: the estimate is drawn as truth without it
        self.R = truth.R[0] @ _exp(-error[:, THETA])
        self.v, self.p = truth.v[0] - error[:, V], truth.p[0] - error[:, P]
        self.bg, self.ba = np.zeros((draws, 3)), np.zeros((draws, 3))
        biases = np.repeat([imu.gyroscope_bias, imu.accelerometer_bias], 3)
        self.C = np.zeros((draws, self.count, self.count))
        self.C[:, range(15), range(15)] = np.concatenate([sigma, biases]) ** 2
        self.b_flow = np.zeros((draws, 3))
        self.C[:, B_FLOW, B_FLOW] = (0.0 if stays is None else stays.share) * np.eye(3)
        self.b_gps = np.zeros((draws, 3))
        if coloured is not None:
            self.C[:, B_GPS, B_GPS] = coloured.sigma_m**2 * np.eye(3)
        self.passed = np.eye(self.count)
        self.fixes: list[tuple[np.ndarray, ...]] = []
        self.clone()

    def clone(self) -> None:
        """Let the pose of the last image be the present one."""
        self.R_last, self.p_last = self.R.copy(), self.p.copy()
        copy = np.eye(self.count)
        copy[THETA_LAST], copy[P_LAST] = np.eye(self.count)[THETA], np.eye(self.count)[P]
        self.C = copy @ self.C @ copy.T
        self.passed = copy @ self.passed

    def propagate(self, rates: np.ndarray, forces: np.ndarray) -> None:
        """Go from one IMU sample to the next: both samples' rates and forces (2, draws, 3), trapezoidal."""
        dt = 1 / self.imu.rate_hz
        w, a = rates.mean(axis=0) - self.bg, forces.mean(axis=0) - self.ba
        turn = _exp(dt * w)
        R_next = self.R @ turn
        a_n = (
            _turned(self.R, forces[0] - self.ba) + _turned(R_next, forces[1] - self.ba)
        ) / 2 + GRAVITY_N_MPS2
        middle = self.R @ _exp(dt / 2 * w)
        F = np.tile(np.eye(self.count), (self.draws, 1, 1))
        F[:, THETA, THETA] = np.swapaxes(turn, 1, 2)
        F[:, THETA, BG] = -dt * np.eye(3)
        F[:, V, THETA], F[:, V, BA] = -dt * middle @ skew(a), -dt * middle
        F[:, P, V] = dt * np.eye(3)
        F[:, P, THETA], F[:, P, BA] = dt / 2 * F[:, V, THETA], dt / 2 * F[:, V, BA]
        imu = self.imu
        walks = imu.gyroscope_walk, imu.accelerometer_walk
        driven = imu.gyroscope, imu.accelerometer, 0.0, *walks, 0.0, 0.0, 0.0
        diagonal = np.zeros(self.count)
        diagonal[:ERRORS] = np.repeat(driven, 3) ** 2 * dt
        self.C = F @ self.C @ np.swapaxes(F, 1, 2) + np.diag(diagonal)
        self.passed = F[0] @ self.passed
        self.p = self.p + dt * self.v + dt**2 / 2 * a_n
        self.v, self.R = self.v + dt * a_n, R_next

    def gps(self, fixes: np.ndarray, sigma_m: float, taken: np.ndarray | None = None) -> np.ndarray:
        """Innovations (draws, 3) of positions [m] in {n}, which are used in all draws or those ``taken``."""
        H = np.zeros((self.draws, 3, self.count))
        H[:, :, P] = np.eye(3)
        if self.coloured is not None:
            H[:, :, B_GPS] = np.eye(3)
        innovation, passed = fixes - self.p - self.b_gps, self.passed
        S = self._innovation_covariances(sigma_m)
        K = self._update(innovation, H, sigma_m**2 * np.eye(3), taken)
        self.fixes.append((innovation, S[0], H[0], K[0], passed))
        self.passed = np.eye(self.count)
        return innovation

    def nis(self, fixes: np.ndarray, sigma_m: float) -> np.ndarray:
        """Squared innovations (draws,) of positions (draws, 3) [m] over their covariances."""
        return nees(fixes - self.p - self.b_gps, self._innovation_covariances(sigma_m))

    def _innovation_covariances(self, sigma_m: float) -> np.ndarray:
        C = self.C[:, P, P] + sigma_m**2 * np.eye(3)
        if self.coloured is not None:
            C = C + self.C[:, P, B_GPS] + self.C[:, B_GPS, P] + self.C[:, B_GPS, B_GPS]
        return C

    def innovations(self, times_s: np.ndarray) -> tuple[GpsInnovations, np.ndarray]:
        """What a monitor needs of the fixes of these times, and all draws' innovations (N, draws, 3)."""
        of_draws, S, H, K, passed = (np.array(part) for part in zip(*self.fixes))
        return GpsInnovations(times_s, of_draws[:, 0], S, H, K, passed), of_draws

    def flow(self, factor: FlowFactor, noise: np.ndarray | None = None) -> None:
        """Take a measured motion since the last image; ``noise`` (draws, 3 or 6) is added to it."""
        back = np.swapaxes(self.R, 1, 2)
        t, R_k_prev = _turned(back, self.p_last - self.p), back @ self.R_last
        w = (Rotation.from_matrix(R_k_prev) * factor.T_k_prev.rotation.inv()).as_rotvec()
        theta, theta_last = np.zeros((2, self.draws, 3, self.count))
        theta[:, :, THETA] = theta_last[:, :, THETA_LAST] = np.eye(3)
        of_w = R_k_prev @ theta_last - theta
        moved = np.zeros((self.draws, 3, self.count))
        moved[:, :, P_LAST], moved[:, :, P] = back, -back
        of_t = skew(t) @ theta + moved
        if factor.form == "full":
            T = RigidTransform.from_components(t, Rotation.from_matrix(R_k_prev))
            predicted = (T * factor.T_k_prev.inv()).as_exp_coords()
            H = np.concatenate([of_w, of_t + skew(t) @ of_w], axis=1)
        else:
            predicted = t - factor.T_k_prev.translation - w @ factor.by_rotation.T
            H = of_t - factor.by_rotation @ of_w
        covariance = factor.covariance
        if self.stays is not None:
            if factor.form == "full":
                raise ValueError("the bias of flow is one of translations given the rotation")
            root = np.linalg.cholesky(covariance)
            predicted, H[:, :, B_FLOW] = predicted - self.b_flow @ root.T, -root
            covariance = max(self.stays.variance - self.stays.share, WHITE_AT_LEAST) * covariance
        self._update((0 if noise is None else noise) - predicted, H, covariance)

    def age(self, interval_s: float) -> None:
        """Let time [s] pass for the biases of flow and GPS."""
        if self.stays is not None:
            self.b_flow = self._aged(self.b_flow, B_FLOW, self.stays.share, interval_s / self.stays.memory_s)
        if self.coloured is not None:
            variance, memory_s = self.coloured.sigma_m**2, self.coloured.memory_s
            self.b_gps = self._aged(self.b_gps, B_GPS, variance, interval_s / memory_s)

    def _aged(self, bias: np.ndarray, place: slice, variance: float, memories: float) -> np.ndarray:
        kept = np.exp(-memories)
        self.C[:, place] *= kept
        self.C[:, :, place] *= kept
        self.C[:, place, place] += variance * (1 - kept**2) * np.eye(3)
        self.passed[place] *= kept
        return kept * bias

    def errors(self, R: np.ndarray, v: np.ndarray, p: np.ndarray) -> np.ndarray:
        """Errors (draws, 9) of attitude [rad], velocity [m/s] and position [m]."""
        theta = Rotation.from_matrix(np.swapaxes(self.R, 1, 2) @ R).as_rotvec()
        return np.concatenate([theta, v - self.v, p - self.p], axis=1)

    def _update(
        self, innovation: np.ndarray, H: np.ndarray, noise: np.ndarray, taken: np.ndarray | None = None
    ) -> np.ndarray:
        """Take a measurement in the draws that take it; the gains (draws, n, m)."""
        CH = self.C @ np.swapaxes(H, 1, 2)
        K = np.swapaxes(np.linalg.solve(H @ CH + noise, np.swapaxes(CH, 1, 2)), 1, 2)
        if taken is not None:
            K = K * taken[:, None, None]
        x = _turned(K, innovation)
        left = np.eye(self.count) - K @ H
        # Joseph's form stays positive definite
        self.C = left @ self.C @ np.swapaxes(left, 1, 2) + K @ noise @ np.swapaxes(K, 1, 2)
        self.passed = left[0] @ self.passed
        self.R, self.R_last = self.R @ _exp(x[:, THETA]), self.R_last @ _exp(x[:, THETA_LAST])
        self.v, self.p = self.v + x[:, V], self.p + x[:, P]
        self.b_flow = self.b_flow + x[:, B_FLOW]
        if self.coloured is not None:
            self.b_gps = self.b_gps + x[:, B_GPS]
        self.bg, self.ba, self.p_last = self.bg + x[:, BG], self.ba + x[:, BA], self.p_last + x[:, P_LAST]
        return K


def nees(errors: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """Squared errors (...,) of (..., n) over their covariances (..., n, n); n on average if honest."""
    return (errors * np.linalg.solve(covariance, errors[..., None])[..., 0]).sum(axis=-1)


def _exp(theta: np.ndarray) -> np.ndarray:
    return Rotation.from_rotvec(theta).as_matrix()


def _turned(R: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    return (R @ vectors[..., None])[..., 0]
