"""The smoother: drawn errors are as large as it says, and shifts of fixes go on as its innovations say."""

from dataclasses import replace

import numpy as np
import pytest

from flowlik.datasets import GpsFixes
from flowlik.egomotion import EgoMotion, Status
from flowlik.egomotion.result import unsolved
from flowlik.errors import DataError
from flowlik.fusion import ColouredGps, FixedLagSmoother, direction_factor, fuse
from flowlik.fusion.fuse import imu_segments
from flowlik.geometry.motion import scaled
from flowlik.simulation.inertial import GPS_PRESETS, GpsModel
from tests.fusion.flights import ANTENNA_C_M, HALF, IDEAL, NOISE, antenna_at, drawn_flight, fused, settings

gtsam = pytest.importorskip("gtsam")


def squared(values, covariances):
    return np.einsum("ni,ni->n", values, np.linalg.solve(covariances, values[..., None])[..., 0])


def test_an_ideal_imu_leads_along_the_flight():
    """Quick turns: the force must be that of the axes which preintegration holds over a step."""
    flight = drawn_flight(0, 1.2, imu=IDEAL)
    R, v, p = flight.true[0]
    start = replace(flight.start, R_n_b=R, velocity_n_mps=v, position_n_m=p, covariance=1e-10 * np.eye(15))
    alone = replace(flight, start=start, flows=[None] * len(flight.flows))
    nowhere = replace(flight.fixes, times_s=flight.fixes.times_s + 100)
    error = flight.errors([fused(alone, fixes=nowhere).states[-1]])[0]
    assert np.linalg.norm(error[:3]) < 3e-4
    assert np.linalg.norm(error[3:6]) < 3e-3
    assert np.linalg.norm(error[6:]) < 3e-3


def test_drawn_errors_are_as_large_as_it_says():
    found = []
    for seed in range(6):
        flight = drawn_flight(seed, 1.2)
        states = fused(flight).states[12::12]
        found.append(squared(flight.errors(states), np.array([s.covariance[:9, :9] for s in states])))
    assert abs(np.mean(found) - 9) < 3 * np.sqrt(18 / 6)
    # flow is what told the velocity
    without = fused(replace(flight, flows=[None] * len(flight.flows))).states[36]
    told, untold = (np.trace(s.covariance[3:6, 3:6]) for s in (states[-1], without))
    assert told < 0.5 * untold


@pytest.mark.parametrize("coloured", [None, HALF])
def test_innovations_are_as_large_as_they_say_and_independent(coloured):
    gps = replace(GPS_PRESETS["white" if coloured is None else "coloured"], position_c_m=ANTENNA_C_M)
    white = []
    for seed in range(4):
        told = fused(drawn_flight(seed, 2.0, gps=gps), coloured).innovations
        roots = np.linalg.cholesky(told.innovation_covariances_m2)
        white.append(np.linalg.solve(roots, told.innovations_m[..., None])[..., 0])
    values = np.array(white)
    count = values.size / 3
    assert abs((values**2).sum() / count - 3) < 3.5 * np.sqrt(6 / count)
    together = (values[:, 1:] * values[:, :-1]).sum() / count
    assert abs(together) < 3.5 * np.sqrt(3 / count)


@pytest.mark.parametrize("coloured", [None, ColouredGps(0.5, 1.0)])
def test_a_shifted_fix_moves_later_innovations_as_they_say(coloured):
    flight = drawn_flight(3, 2.0)
    at = np.array([0, 1, 2, 7, 8, 9])  # an outage as long as the lag between
    fixes = GpsFixes(
        flight.fixes.times_s[at + 1], flight.fixes.positions_n_m[at + 1], flight.fixes.sigma_m[at]
    )
    shift = np.zeros((len(at), 3))
    shift[1:] = [0.2, -0.1, 0.15]
    before = fused(flight, coloured, fixes).innovations
    moved = replace(fixes, positions_n_m=fixes.positions_n_m + shift)
    after = fused(flight, coloured, moved).innovations
    d = np.zeros(before.gains.shape[1])
    for k in range(len(at)):
        d = before.transitions[k] @ d
        s = shift[k] - before.observations[k] @ d
        np.testing.assert_allclose(after.innovations_m[k] - before.innovations_m[k], s, atol=2e-3)
        d = d + before.gains[k] @ s
    assert np.abs(s - shift[-1]).max() > 0.05


def test_a_fix_between_frames_is_carried_by_the_velocity():
    """The antenna moves 2 cm until the frame: a fix of 1 mm a little earlier tells the same position."""
    exact = GpsModel(white_horizontal_m=1e-3, white_vertical_m=1e-3, position_c_m=ANTENNA_C_M)
    flight = drawn_flight(5, 1.0, gps=exact)
    early_s = flight.fixes.times_s[1:] - 0.005
    early = GpsFixes(early_s, antenna_at(early_s), flight.fixes.sigma_m[1:])
    state = fused(flight, fixes=early).states[-1]
    assert np.linalg.norm(flight.errors([state])[0, 6:]) < 0.006
    assert np.linalg.norm(early.positions_n_m[-1] - flight.fixes.positions_n_m[-1]) > 0.015


def test_where_images_are_rare_fixes_are_taken_at_their_own_times():
    flight = drawn_flight(5, 1.5)
    times_s = flight.times_s[::15]
    flows = [None] * (len(times_s) - 1)
    told = fuse(flight.start, times_s, flows, flight.imu, flight.fixes, settings(lag_s=2.0))
    np.testing.assert_allclose(told.innovations.times_s, flight.fixes.times_s[1:])
    assert len(told.states) == len(times_s)
    assert not told.used_fixes[0]


def test_bad_input_is_one_clear_error():
    flight = drawn_flight(0, 0.5)
    parts = (flight.times_s, flight.flows, flight.imu, flight.fixes)
    with pytest.raises(DataError, match="noise densities are not known"):
        fuse(flight.start, *parts[:2], replace(flight.imu, noise=None), parts[3], settings())
    with pytest.raises(DataError, match="gyroscope_noise_density is 0, must be above 0"):
        FixedLagSmoother(flight.start, replace(NOISE, gyroscope_noise_density=0.0), settings())
    with pytest.raises(DataError, match="covariance of the start is not positive definite"):
        FixedLagSmoother(replace(flight.start, covariance=np.zeros((15, 15))), NOISE, settings())
    smoother = FixedLagSmoother(flight.start, NOISE, settings())
    (segment,) = imu_segments(flight.imu, flight.times_s[:2])
    with pytest.raises(DataError, match=r"a step of 0\.6 s is more than half the smoother's lag of 1 s"):
        smoother.step(replace(segment, steps_s=segment.steps_s * 18))
    with pytest.raises(DataError, match="a step of the IMU takes no time"):
        smoother.step(replace(segment, steps_s=segment.steps_s * 0))

    class Stuck:
        def update(self, *args):
            raise RuntimeError("\nIndeterminant linear system\nnear x1")

    smoother._smoother = Stuck()
    with pytest.raises(DataError, match="the smoother's graph has no solution at 0 s: Indeterminant"):
        smoother.step(segment)
    late = replace(flight.imu, times_s=flight.imu.times_s + 0.1)
    with pytest.raises(DataError, match=r"IMU from 0.1 to 0.6 s does not cover the frames from 0 to 0.5 s"):
        fuse(flight.start, *parts[:2], late, parts[3], settings())
    with pytest.raises(DataError, match="the start is of 0 s, the first frame of"):
        fuse(flight.start, parts[0][1:], parts[1][1:], *parts[2:], settings())
    with pytest.raises(DataError, match="expected one less"):
        fuse(flight.start, parts[0], parts[1][1:], *parts[2:], settings())


def test_directions_of_one_camera_tell_what_they_say():
    """Scale comes of the IMU and the start; drawn errors of directions are as large as said."""
    found = []
    for seed in range(4):
        flight = drawn_flight(seed, 1.2, form="direction")
        told = fused(flight)
        assert told.flow_factors == len(flight.flows)
        states = told.states[12::12]
        found.append(squared(flight.errors(states), np.array([s.covariance[:9, :9] for s in states])))
    assert abs(np.mean(found) - 9) < 3 * np.sqrt(18 / 4)
    without = fused(replace(flight, flows=[None] * len(flight.flows))).states[36]
    told, untold = (np.trace(s.covariance[3:6, 3:6]) for s in (states[-1], without))
    assert told < 0.7 * untold


def test_a_direction_at_a_length_says_nothing_of_the_length():
    flow = drawn_flight(0, 0.2, form="direction").flows[0]
    factor = flow.at_length(0.2)
    assert np.linalg.norm(factor.T_k_prev.translation) == pytest.approx(0.2)
    t = factor.T_k_prev.translation
    assert t @ factor.covariance @ t / (t @ t) > 10**2 * 0.2**2
    across = np.linalg.svd(t[None])[2][1]
    twice = flow.at_length(0.4).covariance
    assert across @ twice @ across == pytest.approx(4 * across @ factor.covariance @ across)
    # a step that is hardly known gives no factor
    flight = drawn_flight(0, 0.2, form="direction")
    loose = replace(flight.start, covariance=np.diag(np.where(np.arange(15) // 3 == 1, 9.0, 1e-4)))
    assert fused(replace(flight, start=loose)).flow_factors == 0


def test_directions_are_of_motions_without_a_length():
    T = drawn_flight(0, 0.2).flows[0].T_k_prev
    known = EgoMotion(T, np.zeros((6, 6)), np.eye(6), Status.SOLVED)
    with pytest.raises(DataError, match="a motion in metres is a flow factor"):
        direction_factor(known, 2.0)
    with pytest.raises(DataError, match="must be above 0, not 0"):
        direction_factor(known, 0.0)
    assert direction_factor(unsolved(Status.TOO_FEW, "few"), 2.0) is None
    unit = replace(known, T_k_prev=scaled(T, 1.0), scale_known=False)
    np.testing.assert_array_equal(direction_factor(unit, 2.0).covariance, 2 * np.eye(6))
