"""What IMU and GPS err by, held against the laws it is drawn from."""

import numpy as np
import pytest

from flowlik.errors import DataError
from flowlik.simulation import (
    GPS_PRESETS,
    IMU_PRESETS,
    CarryOff,
    GpsModel,
    ImuModel,
    Jump,
    Replay,
    SmoothMotion,
    gps_model,
    imu_model,
    simulate_gps,
    simulate_imu,
    spoofing,
)
from flowlik.simulation.flight._trajectories import TRAJECTORIES
from flowlik.simulation.inertial._gps import gauss_markov
from flowlik.simulation.inertial._imu import imu_errors

ADIS = IMU_PRESETS["adis16448"]


def motion_of(seconds, name="hover"):
    count = int(seconds * 10) + 1
    return SmoothMotion(TRAJECTORIES[name](count, 6.0, 10.0, 1), np.arange(count) / 10)


def allan_variance(values, window):
    """Half the mean square of differences between means of adjacent windows, of each column."""
    means = values[: len(values) // window * window].reshape(-1, window, values.shape[1]).mean(axis=1)
    return 0.5 * (np.diff(means, axis=0) ** 2).mean(axis=0)


def test_allan_variance_is_that_of_white_noise_and_a_random_walk():
    """N² / T of a white density N and K² T / 3 of a walk K over windows of T."""
    model = ImuModel(
        gyroscope_noise_density=1e-3, gyroscope_random_walk=2e-3,
        accelerometer_noise_density=2e-2, accelerometer_random_walk=1e-2,
    )  # fmt: skip
    errors = sum(imu_errors(200 * 2000, model, 5))
    white, walk = np.repeat([1e-3, 2e-2], 3), np.repeat([2e-3, 1e-2], 3)
    for window_s in (0.05, 1.0, 8.0):
        found = allan_variance(errors, round(200 * window_s)).reshape(2, 3).mean(axis=1)
        expected = (white**2 / window_s + walk**2 * window_s / 3).reshape(2, 3).mean(axis=1)
        count = 3 * 2000 / window_s
        np.testing.assert_allclose(found, expected, rtol=5 * np.sqrt(3 / count))


def test_the_first_bias_has_the_turn_on_deviation():
    biases = [imu_errors(1, ADIS, seed)[0][0] for seed in range(200)]
    scaled = np.array(biases) / np.repeat([ADIS.gyroscope_turn_on_sd, ADIS.accelerometer_turn_on_sd], 3)
    assert abs(scaled.mean()) < 4 / np.sqrt(1200)
    assert abs(scaled.std() - 1) < 4 / np.sqrt(2400)


def test_equal_seeds_give_equal_bits_and_a_longer_flight_begins_with_them():
    short, again, long = (simulate_imu(motion_of(s), ADIS, 7) for s in (2, 2, 3))
    np.testing.assert_array_equal(short.angular_rate_radps, again.angular_rate_radps)
    np.testing.assert_array_equal(short.gyroscope_bias_radps, long.gyroscope_bias_radps[:401])
    turned = short.specific_force_mps2 - [0, -9.80665, 0]
    np.testing.assert_allclose(turned, sum(imu_errors(401, ADIS, 7))[:, 3:], atol=1e-8)
    other = simulate_imu(motion_of(2), ADIS, 8)
    assert not np.isclose(short.angular_rate_radps, other.angular_rate_radps).any()


def test_gauss_markov_correlation_falls_by_e_within_its_memory():
    process = gauss_markov(np.random.default_rng(2).standard_normal((2000, 500)), 0.5, 10.0)
    for lag in (0, 1, 20, 40):
        found = (process[: 2000 - lag] * process[lag:]).mean()
        assert found == pytest.approx(np.exp(-lag / 20), abs=0.03)
    assert process[0].var() == pytest.approx(1.0, abs=0.25)  # stationary from the start


def test_gps_errors_have_the_deviations_that_the_receiver_claims():
    model = GpsModel(10.0, 1.0, 2.0, 3.0, 4.0, correlation_time_s=0.5)
    gps = simulate_gps(motion_of(1000), model, 4)
    np.testing.assert_allclose(gps.sigma_m, np.sqrt([10, 20, 10]))
    errors = gps.positions_n_m - gps.true_positions_n_m
    np.testing.assert_allclose(errors.std(axis=0), gps.sigma_m, rtol=0.08)
    np.testing.assert_allclose((errors - gps.coloured_m).std(axis=0), [1, 2, 1], rtol=0.04)


def test_an_outage_leaves_the_other_fixes_as_they_are():
    motion = motion_of(10, "curve")
    whole = simulate_gps(motion, GPS_PRESETS["coloured"], 3)
    gapped = simulate_gps(motion, gps_model("coloured:outages_s=2/4/9/11"), 3)
    kept = (whole.times_s < 2) | ((whole.times_s > 4) & (whole.times_s < 9))
    np.testing.assert_array_equal(gapped.times_s, whole.times_s[kept])
    np.testing.assert_array_equal(gapped.positions_n_m, whole.positions_n_m[kept])


@pytest.mark.parametrize(
    ("attack", "shift_at_8_s"),
    [
        (Jump(5.0, 30.0, 0.0), [0, 0, 30]),
        (CarryOff(5.0, 0.5), [1.5, 0, 0]),
        (Replay(5.0, 4.0), [0, 0, -24]),
    ],
    ids=["jump", "ramp", "replay"],
)
def test_an_attack_shifts_from_its_onset_on_and_nothing_before(attack, shift_at_8_s):
    motion = motion_of(10, "straight")
    honest, spoofed = (simulate_gps(motion, GPS_PRESETS["white"], 1, a) for a in ((), (attack,)))
    shift = spoofed.positions_n_m - honest.positions_n_m
    np.testing.assert_array_equal(spoofed.positions_n_m[~spoofed.spoofed], honest.positions_n_m[:25])
    np.testing.assert_allclose(shift, spoofed.spoofed_m, atol=1e-9)
    np.testing.assert_allclose(shift[40], shift_at_8_s, atol=1e-6)
    assert spoofed.spoofed.sum() == 26 and not honest.spoofed.any()


def test_a_model_is_a_preset_with_changes():
    imu = imu_model("adis16448:rate_hz=240,position_c_m=0.1/0/-0.05")
    assert imu.rate_hz == 240 and imu.position_c_m == (0.1, 0.0, -0.05)
    assert imu.gyroscope_noise_density == 1.6968e-4
    assert spoofing("ramp:onset_s=20,rate_mps=0.5") == CarryOff(20.0, 0.5)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: imu_model("xsens"), "unknown IMU 'xsens': known are ideal, adis16448, mpu6050"),
        (lambda: imu_model("ideal:rate=9"), "unknown option 'rate', known are rate_hz"),
        (lambda: imu_model("ideal:position_c_m=1/2"), "1/2 has 2 numbers, 3 are needed"),
        (lambda: imu_model("ideal:rate_hz=fast"), "'fast' is not a finite number"),
        (lambda: imu_model("ideal:rate_hz=0"), "rate must be above 0"),
        (lambda: gps_model("white:outages_s=20/10"), "pairs of a first and a later last time"),
        (lambda: gps_model("white:white_vertical_m=0"), "their sum above 0"),
        (lambda: spoofing("drift:onset_s=3"), "unknown spoofing 'drift': known are jump, ramp, replay"),
        (lambda: spoofing("ramp:onset_s=3"), "ramp needs rate_mps"),
        (lambda: simulate_gps(motion_of(3), GpsModel(), 0, [Jump(4.0, 1.0)]), "outside the flight, 0 to 3 s"),
        (lambda: simulate_gps(motion_of(3), GpsModel(), 0, [Replay(1.0, 2.0)]), "begins before the flight"),
        (lambda: simulate_gps(motion_of(3), gps_model("white:outages_s=0/9"), 0), "leave no fix"),
    ],
)  # fmt: skip
def test_what_cannot_be_is_one_clear_error(make, message):
    with pytest.raises(DataError, match=message):
        make()
