"""The start that is found: near the truth whatever the heading, and not known where nothing tells it."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from flowlik.errors import DataError
from flowlik.fusion import TurnOn, coarse_start, fuse, heading_sigma_rad
from flowlik.simulation.inertial import GpsModel
from tests.fusion.flights import ANTENNA_C_M, IMU, drawn_flight, settings

pytest.importorskip("gtsam")
TURN_ON = TurnOn(IMU.gyroscope_turn_on_sd, IMU.accelerometer_turn_on_sd)
GOOD_GPS = GpsModel(rate_hz=10.0, white_horizontal_m=0.05, white_vertical_m=0.05, position_c_m=ANTENNA_C_M)


def found(flight, fixes, heading=0.0):
    how = replace(settings(), alignment_s=1.5)
    turn = Rotation.from_rotvec([0.0, heading, 0.0])
    if fixes is not None:
        fixes = replace(fixes, positions_n_m=turn.apply(fixes.positions_n_m))
    start = coarse_start(flight.times_s, flight.flows, flight.imu, fixes, how, TURN_ON)
    return fuse(start, flight.times_s, flight.flows, flight.imu, fixes, how), turn, how


@pytest.mark.parametrize(("seed", "heading"), [(0, 0.0), (1, 2.0), (2, -3.0)])
def test_the_start_is_found_whatever_the_heading(seed, heading):
    flight = drawn_flight(seed, 2.0, gps=GOOD_GPS)
    told, turn, how = found(flight, flight.fixes, heading)
    state = told.states[-1]
    turned = replace(
        state,
        R_n_b=turn.inv().as_matrix() @ state.R_n_b,
        position_n_m=turn.inv().apply(state.position_n_m),
        velocity_n_mps=turn.inv().apply(state.velocity_n_mps),
    )
    R = np.kron(np.eye(2), turn.as_matrix())
    C = state.covariance[:9, :9].copy()
    C[3:, 3:] = R.T @ C[3:, 3:] @ R
    C[:3, 3:], C[3:, :3] = C[:3, 3:] @ R, R.T @ C[3:, :3]
    error = flight.errors([turned])[0]
    assert error @ np.linalg.solve(C, error) < 28  # 99.9 %
    assert np.degrees(heading_sigma_rad(state, how)) < 2
    assert np.degrees(np.linalg.norm(error[:3])) < 4
    aligned = told.after(flight.times_s[0] + how.alignment_s)
    assert aligned.states[0].time_s == pytest.approx(1.5)
    assert aligned.innovations.times_s.min() > 1.5


def test_without_gps_the_world_begins_at_the_body_and_stands_upright():
    flight = drawn_flight(4, 2.0)
    told, _, how = found(flight, None)
    first, last = told.states[0], told.states[-1]
    assert np.linalg.norm(first.position_n_m) < 1e-6
    R = flight.true[flight.at(last)][0]
    down = np.array([0.0, 1.0, 0.0])
    assert np.degrees(np.linalg.norm(np.cross(last.R_n_b.T @ down, R.T @ down))) < 1.5
    assert heading_sigma_rad(last, how) < 0.02


def test_coarse_gps_does_not_tell_the_heading():
    flight = drawn_flight(0, 2.0)
    told, _, how = found(flight, flight.fixes)
    assert np.degrees(heading_sigma_rad(told.states[-1], how)) > 5


def test_without_motions_there_is_no_start():
    flight = drawn_flight(0, 1.0)
    how = replace(settings(), alignment_s=0.5)
    with pytest.raises(DataError, match=r"0 frames of the first 0\.5 s tell a motion"):
        coarse_start(flight.times_s, [None] * 30, flight.imu, flight.fixes, how, TURN_ON)
