"""The judge is judged: by integration, by finite differences, and by drawn errors of known size."""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from flowlik.geometry.motion import exp_se3, relative_motion, skew
from flowlik.likelihood.over_time import OverTime, Persistence
from flowlik.odometry import FlowFactor

sys.path.insert(0, str(Path(__file__).parents[2] / "benchmarks"))
from error_state_filter import (
    BA,
    BG,
    ERRORS,
    P_LAST,
    THETA,
    THETA_LAST,
    ErrorStateFilter,
    Imu,
    P,
    Start,
    V,
    drawn_imu,
    nees,
    true_flight,
)

FRAMES, IMAGES_PER_SECOND = 31, 60.0
IMU = Imu(rate_hz=120.0)
COVARIANCE = np.diag(np.array([2e-3, 2e-3, 2e-3, 0.01, 0.01, 0.01]) ** 2)
COVARIANCE[0, 4] = COVARIANCE[4, 0] = 1.2e-5


LITTLE_KNOWN = Start(np.deg2rad(2.0), 0.5, 1.5)


def flight():
    """A turn that climbs and rolls, a second long."""
    s = np.arange(FRAMES) / IMAGES_PER_SECOND
    path = np.stack([2 * (1 - np.cos(1.5 * s)), 0.3 * np.sin(2 * s), 4 * np.sin(1.5 * s)], axis=1)
    turn = Rotation.from_rotvec(np.stack([0.2 * np.sin(2 * s), 1.2 * s, 0.3 * np.sin(s)], axis=1))
    return RigidTransform.from_components(path, turn), s


@pytest.fixture(scope="module")
def truth():
    return true_flight(*flight(), IMU.rate_hz)


def factor_of(T, form):
    if form == "full":
        return FlowFactor(form, T, COVARIANCE, np.zeros((3, 3)))
    gain = COVARIANCE[3:, :3] @ np.linalg.inv(COVARIANCE[:3, :3])
    left = COVARIANCE[3:, 3:] - gain @ COVARIANCE[:3, 3:]
    return FlowFactor(form, T, left, gain - skew(T.translation))


def test_an_ideal_imu_leads_along_the_flight(truth):
    exact = ErrorStateFilter(truth, IMU, Start(0.0, 0.0, 0.0), 1, np.random.default_rng(0))
    for k in range(len(truth.times_s) - 1):
        exact.propagate(truth.rate[k : k + 2, None], truth.force[k : k + 2, None])
    attitude, velocity, position = exact.errors(truth.R[-1], truth.v[-1], truth.p[-1]).reshape(3, 3)
    assert np.linalg.norm(attitude) < 2e-5
    assert np.linalg.norm(velocity) < 5e-4
    assert np.linalg.norm(position) < 5e-4


def perturbed(robot, error):
    """The state of a filter moved by an error."""
    turn = Rotation.from_rotvec(error[THETA]).as_matrix()
    robot.R = robot.R @ turn
    robot.R_last = robot.R_last @ Rotation.from_rotvec(error[THETA_LAST]).as_matrix()
    robot.v, robot.p, robot.p_last = robot.v + error[V], robot.p + error[P], robot.p_last + error[P_LAST]
    robot.bg, robot.ba = robot.bg + error[BG], robot.ba + error[BA]


def at_the_second_image(truth):
    robot = ErrorStateFilter(truth, IMU, LITTLE_KNOWN, 1, np.random.default_rng(1))
    robot.clone()
    for k in range(2):
        robot.propagate(truth.rate[k : k + 2, None], truth.force[k : k + 2, None])
    return robot


@pytest.mark.parametrize("form", ["full", "given-rotation"])
def test_the_derivative_of_flow_is_that_of_finite_differences(truth, form, monkeypatch):
    poses, _ = flight()
    off = exp_se3(np.array([1e-4, -2e-4, 1e-4, 0.002, 0.001, -0.003]))
    seen = []
    monkeypatch.setattr(ErrorStateFilter, "_update", lambda self, y, H, noise: seen.append((y[0], H[0])))
    measured = factor_of(off * relative_motion(poses[0], poses[1]), form)
    at_the_second_image(truth).flow(measured)
    columns = []
    for j in range(ERRORS):
        both = []
        for step in (1e-6, -1e-6):
            robot = at_the_second_image(truth)
            perturbed(robot, step * np.eye(ERRORS)[j])
            robot.flow(measured)
            both.append(seen.pop()[0])
        columns.append((both[1] - both[0]) / 2e-6)
    np.testing.assert_allclose(seen[0][1], np.transpose(columns), atol=2e-2)


def test_the_derivative_of_the_motion_is_that_of_finite_differences(truth):
    """Covariances go as errors do: F is read off that of a certain state with one uncertain error."""
    imu = Imu(120.0, gyroscope=0.0, accelerometer=0.0, gyroscope_walk=0.0, accelerometer_walk=0.0)
    samples = truth.rate[:2, None], truth.force[:2, None]
    F = np.zeros((ERRORS, ERRORS))
    for j in range(ERRORS):
        ends = []
        for step in (1e-5, -1e-5):
            robot = ErrorStateFilter(truth, imu, Start(0.0, 0.0, 0.0), 1, np.random.default_rng(0))
            perturbed(robot, step * np.eye(ERRORS)[j])
            robot.propagate(*samples)
            ends.append(robot)
        plus, minus = ends
        F[THETA, j] = Rotation.from_matrix(minus.R[0].T @ plus.R[0]).as_rotvec() / 2e-5
        F[V, j], F[P, j] = (plus.v[0] - minus.v[0]) / 2e-5, (plus.p[0] - minus.p[0]) / 2e-5
    robot = ErrorStateFilter(truth, imu, Start(0.0, 0.0, 0.0), 1, np.random.default_rng(0))
    C = np.diag(np.arange(1.0, ERRORS + 1))
    robot.C = C[None]
    robot.propagate(*samples)
    np.testing.assert_allclose(robot.C[0][:9, :9], (F @ C @ F.T)[:9, :9], atol=2e-3)


@pytest.mark.parametrize("form", ["full", "given-rotation", "stays"])
def test_drawn_errors_are_as_large_as_it_says(truth, form):
    """NEES of nine freedoms is nine: within four standard deviations of a mean of so many draws."""
    draws, rng, imu = 150, np.random.default_rng(7), IMU
    poses, _ = flight()
    rates, forces = drawn_imu(truth, imu, draws, rng)
    stays = Persistence(0.8, 0.2) if form == "stays" else None
    robot = ErrorStateFilter(truth, imu, LITTLE_KNOWN, draws, rng, stays)
    kept, bias = np.exp(-1 / IMAGES_PER_SECOND / 0.2), np.sqrt(0.8) * rng.standard_normal((draws, 3))
    every = round(imu.rate_hz / IMAGES_PER_SECOND)
    for k in range(1, len(truth.times_s)):
        robot.propagate(rates[k - 1 : k + 1], forces[k - 1 : k + 1])
        if k % every == 0:
            factor = factor_of(relative_motion(poses[k // every - 1], poses[k // every]), form)
            error = rng.standard_normal((draws, len(factor.covariance)))
            if stays is not None:
                error = bias + np.sqrt(0.2) * error
                bias = kept * bias + np.sqrt(0.8 * (1 - kept**2)) * rng.standard_normal((draws, 3))
            robot.flow(factor, error @ np.linalg.cholesky(factor.covariance).T)
            robot.clone()
            robot.age(1 / IMAGES_PER_SECOND)
        if k % 24 == 0:
            robot.gps(truth.p[k] + 1.5 * rng.standard_normal((draws, 3)), 1.5)
    values = nees(robot.errors(truth.R[-1], truth.v[-1], truth.p[-1]), robot.C[:, :9, :9])
    assert abs(values.mean() - 9) < 4 * np.sqrt(18 / draws)
    # and the flow is what told the velocity
    assert np.sqrt(robot.C[:, V, V].trace(axis1=1, axis2=2)).mean() < 0.65


def test_a_shift_of_gps_goes_on_as_the_record_of_fixes_says():
    """Innovations of the filter with shifted fixes against the recursion over its own record."""
    from gps_integrity_flights import COLOURED, drawn_flight, filtered, shifted

    stays = OverTime(Persistence(0.2, 1.0), Persistence(0.2, 1.0))
    motions = drawn_flight(0, 2.0, stays).motions
    shift_m = np.linspace(0, 0.4, 10)[:, None, None] * np.array([[1.0, 0.0, 0.5], [0.0, -1.0, 0.0]])

    def flown(**options):
        white = FlowFactor("full", motions.true[0], COVARIANCE, np.zeros((3, 3)))
        factors = lambda motion: replace(white, T_k_prev=motion.T_k_prev)  # noqa: E731
        return filtered(motions, factors, 2, 0, COLOURED, **options)

    clean, fooled = flown(), flown(shift_m=shift_m)
    assert clean.record.gains.shape == (10, 27, 3)
    change = fooled.innovations - clean.innovations
    assert np.abs(change[-1] - shift_m[-1]).max() > 0.05  # the estimate has followed
    np.testing.assert_allclose(shifted(clean.record, shift_m), change, atol=2e-3)
    np.testing.assert_allclose(filtered_out(flown, shift_m), clean.innovations[:3], atol=1e-12)


def filtered_out(flown, shift_m):
    """First innovations of a filter that takes no fix of the shifted ones after the second."""
    taken = np.arange(10)[:, None] < np.array([2, 2])
    run = flown(taken=taken, shift_m=np.where(taken[..., None], 0.0, shift_m))
    assert not run.taken[2:].any()
    assert not np.array(run.record.gains[2:]).any()
    return np.concatenate([run.innovations[:2], run.innovations[2:3] - shift_m[2]])
