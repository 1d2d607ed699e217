"""Time offset and turn between camera and IMU against simulated ones that are known."""

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from flowlik.datasets import ImuSamples
from flowlik.errors import DataError
from flowlik.fusion import estimate_time_offset
from flowlik.simulation.inertial import ImuModel, SmoothMotion, simulate_imu

OFFSET_S, TURN = 0.0237, np.array([0.4, -1.3, 0.8])
FRAMES, PER_SECOND = 301, 30.0
TIMES_S = np.arange(FRAMES) / PER_SECOND + 5.0
NOISE_RAD = 3e-4


def flight(
    seed: int, axes: tuple[float, ...] = (0.3, 0.5, 0.2), hertz: float | None = None
) -> RigidTransform:
    """A shaky flight: rotations about the camera's axes of so many radians, with a few frequencies."""
    rng = np.random.default_rng(seed)
    rates = rng.uniform(0.2, 1.5, (3, 3)) if hertz is None else np.full((3, 3), hertz)
    waves = np.sin(2 * np.pi * rates[:, :, None] * TIMES_S + rng.uniform(0, 6, (3, 3, 1))).sum(axis=1)
    turn = Rotation.from_rotvec((np.array(axes)[:, None] * waves / 3).T)
    return RigidTransform.from_components(np.zeros((FRAMES, 3)), turn)


def measured(seed: int, poses: RigidTransform, model: ImuModel | None = None) -> tuple[Rotation, ImuSamples]:
    """Rotations of images, half of whose errors stays for a second, and an IMU that is late and turned."""
    model = model or ImuModel(200.0, 2e-3, 1e-4, 0.01, 0.01, 0.0, 0.1, (0, 0, 0), tuple(TURN), OFFSET_S)
    imu = simulate_imu(SmoothMotion(poses, TIMES_S), model, seed)
    rng = np.random.default_rng([seed, 1])
    slow, errors = rng.standard_normal(3), []
    for _ in range(FRAMES - 1):
        slow = np.exp(-1 / PER_SECOND) * slow + np.sqrt(1 - np.exp(-2 / PER_SECOND)) * rng.standard_normal(3)
        errors.append(NOISE_RAD * np.sqrt(0.5) * (slow + rng.standard_normal(3)))
    true = poses.rotation[1:].inv() * poses.rotation[:-1]
    return Rotation.from_rotvec(np.array(errors)) * true, ImuSamples(
        imu.times_s, imu.angular_rate_radps, imu.specific_force_mps2
    )


def test_a_known_offset_and_turn_lie_within_their_intervals():
    """Over flights: 95 % intervals of the offset hold, and turns are as far off as they say."""
    held, squared, widths = [], [], []
    for seed in range(10):
        found = estimate_time_offset(TIMES_S, *measured(seed, flight(seed)))
        low, high = found.interval_s
        held.append(low < OFFSET_S < high)
        widths.append(high - low)
        off = (found.R_c_i * Rotation.from_rotvec(TURN).inv()).as_rotvec()
        squared.append(off @ np.linalg.solve(found.rotation_covariance, off))
        assert found.explained > 0.99 and found.motions > 250
    assert sum(held) >= 8
    assert np.median(widths) < 2e-3
    # of eight blocks the covariance itself is rough: Hotelling's distribution has a median of 3.8
    assert 1.0 < np.median(squared) < 8.0


def test_what_the_gyroscope_reads_at_rest_is_told():
    """Without noise all is exact but for the interpolation of samples."""
    model = ImuModel(400.0, rotation_c_i_rad=tuple(TURN), time_offset_s=-0.05)
    poses = flight(3)
    imu = simulate_imu(SmoothMotion(poses, TIMES_S), model, 0)
    bias_i = np.array([0.02, -0.01, 0.03])
    samples = ImuSamples(imu.times_s, imu.angular_rate_radps + bias_i, imu.specific_force_mps2)
    motions = poses.rotation[1:].inv() * poses.rotation[:-1]
    found = estimate_time_offset(TIMES_S, motions, samples)
    assert abs(found.offset_s + 0.05) < 2e-4
    R_c_i = Rotation.from_rotvec(TURN)
    assert (found.R_c_i * R_c_i.inv()).magnitude() < 1e-3
    np.testing.assert_allclose(found.gyroscope_bias_c_radps, R_c_i.apply(bias_i), atol=1e-4)
    given = estimate_time_offset(TIMES_S, motions, samples, R_c_i=R_c_i)
    assert abs(given.offset_s + 0.05) < 2e-4 and not given.rotation_covariance.any()


def test_refusals():
    motions, imu = measured(0, flight(0))
    still, of_still = measured(1, flight(1, (1e-4, 1e-4, 1e-4)))
    beat, of_beat = measured(2, flight(2, hertz=5.0))
    one, of_one = measured(3, flight(3, (0.0, 0.5, 0.0)))
    for rotations, samples, options, message in (
        (still, of_still, {}, "there is too little rotation"),
        (motions, of_one, {}, "explains .* they are of another flight"),
        (motions, imu, {"most_s": 0.02}, "at the end of what is looked for, 0.02 s"),
        (beat, of_beat, {}, "explain the rotations alike"),
        (motions[:-1], imu, {}, "301 frames have 299 rotations"),
        (motions, imu, {"most_s": -1.0}, "no largest offset"),
        (motions, imu, {"most_s": 4.8}, "motions lie within the IMU's times by 4.8 s"),
    ):
        with pytest.raises(DataError, match=message):
            estimate_time_offset(TIMES_S, rotations, samples, **options)
    # about one axis: the turn about it is nothing that rotations tell, unless it is given
    found = estimate_time_offset(TIMES_S, one, of_one, R_c_i=Rotation.from_rotvec(TURN))
    assert abs(found.offset_s - OFFSET_S) < 3e-3
