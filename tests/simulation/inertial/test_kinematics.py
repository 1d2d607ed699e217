"""The continuous motion against formulas, and the noiseless IMU integrated back to the trajectory."""

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from flowlik.errors import DataError
from flowlik.simulation import GRAVITY_N_MPS2, IMU_PRESETS, ImuModel, SmoothMotion, simulate_imu
from flowlik.simulation.flight._trajectories import TRAJECTORIES

RADIUS_M, RATE = 5.0, 0.8
ELSEWHERE = ImuModel(
    rate_hz=200.0, position_c_m=(0.1, -0.05, 0.2), rotation_c_i_rad=(0.3, -1.2, 0.5), time_offset_s=0.03
)


def circle(times_s):
    """A level circle, looking along it and turning right, rolled by 0.2 rad."""
    angle = RATE * times_s
    positions = RADIUS_M * np.stack([-np.cos(angle), 0 * angle, np.sin(angle)], axis=1)
    headings = np.stack([angle, 0 * angle, 0 * angle + 0.2], axis=1)
    return RigidTransform.from_components(positions, Rotation.from_euler("YXZ", headings))


@pytest.fixture(scope="module")
def turning():
    times_s = np.arange(120) / 30
    return SmoothMotion(circle(times_s), times_s)


def flown(name, frames, rate_hz, seed=3):
    return SmoothMotion(TRAJECTORIES[name](frames, 6.0, rate_hz, seed), np.arange(frames) / rate_hz)


def test_a_circle_has_the_derivatives_of_its_formula(turning):
    motion = turning.at(np.linspace(1.0, 3.0, 41))
    down = np.broadcast_to([0, RATE, 0], (41, 3))
    np.testing.assert_allclose(motion.poses.translation, circle(motion.times_s).translation, atol=1e-9)
    np.testing.assert_allclose(motion.velocity_n_mps, np.cross(down, motion.poses.translation), atol=1e-7)
    toward_centre = -(RATE**2) * motion.poses.translation
    np.testing.assert_allclose(motion.acceleration_n_mps2, toward_centre, atol=1e-6)
    np.testing.assert_allclose(motion.poses.rotation.apply(motion.angular_rate_c_radps), down, atol=1e-7)
    np.testing.assert_allclose(motion.angular_acceleration_c_radps2, 0, atol=1e-5)


def test_a_lever_arm_feels_the_centripetal_acceleration(turning):
    """Outwards by 0.5 m the acceleration toward the centre is rate² times 0.5 m larger."""
    times_s = np.linspace(1.0, 3.0, 41)
    motion = turning.at(times_s)
    outwards_n = motion.poses.translation / RADIUS_M
    arm_c = motion.poses.rotation.inv().apply(0.5 * outwards_n)
    np.testing.assert_allclose(arm_c, arm_c[:1].repeat(41, axis=0), atol=1e-9)
    more = motion.acceleration_at(arm_c[0]) - motion.acceleration_n_mps2
    np.testing.assert_allclose(more, -0.5 * RATE**2 * outwards_n, atol=1e-5)


def test_derivatives_are_finite_differences_of_the_motion():
    motion, times_s, h = flown("training", 90, 30.0), np.linspace(0.5, 2.5, 37), 1e-4
    before, here, after = (motion.at(times_s + d) for d in (-h, 0, h))
    arm = (0.1, -0.05, 0.2)
    velocity = (after.positions_n_m(arm) - before.positions_n_m(arm)) / (2 * h)
    np.testing.assert_allclose(here.velocity_at(arm), velocity, atol=1e-5)
    acceleration = (after.velocity_at(arm) - before.velocity_at(arm)) / (2 * h)
    np.testing.assert_allclose(here.acceleration_at(arm), acceleration, atol=1e-4)
    turn = (before.poses.rotation.inv() * after.poses.rotation).as_rotvec() / (2 * h)
    np.testing.assert_allclose(here.angular_rate_c_radps, turn, atol=1e-6)
    growth = (after.angular_rate_c_radps - before.angular_rate_c_radps) / (2 * h)
    np.testing.assert_allclose(here.angular_acceleration_c_radps2, growth, atol=1e-4)


@pytest.mark.parametrize("name", ["training", "forest-fig8"])
def test_the_spline_flies_between_frames_where_the_flight_itself_does(name):
    dense = TRAJECTORIES[name](8 * 119 + 1, 6.0, 480.0, 3)
    between = flown(name, 120, 60.0).at(np.arange(8 * 119 + 1) / 480).poses
    assert np.abs(between.translation - dense.translation).max() < 1e-6
    assert (between.rotation.inv() * dense.rotation).magnitude().max() < 1e-6


def integrated(imu):
    """Strapdown integration of ideal samples: Simpson's rule over pairs of periods, from the true start."""
    h = imu.times_s[1] - imu.times_s[0]
    R, v, p = imu.poses.rotation[0], imu.velocity_n_mps[0], imu.poses.translation[0]
    w, f = imu.angular_rate_radps, imu.specific_force_mps2
    for k in range(0, len(w) - 2, 2):
        # rotation within the pair by the fourth-order Magnus series of a parabola through three rates
        def turned(s, w0=w[k], w1=w[k + 1], w2=w[k + 2]):
            b, c = (4 * w1 - 3 * w0 - w2) / 2, (w0 - 2 * w1 + w2) / 2
            mean = h * (w0 * s + b * s**2 / 2 + c * s**3 / 3)
            return Rotation.from_rotvec(mean + (h * s) ** 2 * s / 12 * np.cross(w0, b))

        a = [(R * turned(s)).apply(f[k + s]) + GRAVITY_N_MPS2 for s in range(3)]
        p = p + 2 * h * v + (2 * h) ** 2 * (a[0] + 2 * a[1]) / 6
        v = v + 2 * h * (a[0] + 4 * a[1] + a[2]) / 6
        R = R * turned(2)
    return R, v, p


def test_integrating_the_noiseless_imu_gives_the_trajectory_back():
    """After 5 s and 30 m at 200 Hz, beside the camera and turned: 0.1 mm, 0.1 mm/s, 0.01 mrad."""
    imu = simulate_imu(flown("training", 301, 60.0), ELSEWHERE, 0)
    assert len(imu.times_s) == 1001
    R, v, p = integrated(imu)
    assert np.linalg.norm(p - imu.poses.translation[-1]) < 1e-4
    assert np.linalg.norm(v - imu.velocity_n_mps[-1]) < 1e-4
    assert (R.inv() * imu.poses.rotation[-1]).magnitude() < 1e-5


def test_a_hovering_imu_feels_gravity_upwards_and_nothing_else():
    """In {n} y points down, so the force that holds it has a negative y."""
    imu = simulate_imu(flown("hover", 10, 60.0), IMU_PRESETS["ideal"], 0)
    np.testing.assert_allclose(imu.specific_force_mps2, np.tile([0, -9.80665, 0], (31, 1)), atol=1e-7)
    np.testing.assert_allclose(imu.angular_rate_radps, 0, atol=1e-12)


def test_stamps_are_late_by_the_offset():
    imu = simulate_imu(flown("hover", 10, 60.0), ELSEWHERE, 0)
    np.testing.assert_allclose(imu.times_s - imu.true_times_s, 0.03)


def test_epoch_times_cost_no_more_than_their_own_rounding(turning):
    """A double holds such times to 0.24 us, in which the camera moves a micrometre."""
    later = SmoothMotion(turning.poses, turning.times_s + 1.7e9)
    a, b = turning.at(turning.times_s), later.at(later.times_s)
    inner = slice(10, -10)
    np.testing.assert_allclose(a.acceleration_n_mps2[inner], b.acceleration_n_mps2[inner], atol=0.02)
    np.testing.assert_allclose(a.poses.translation, b.poses.translation, atol=1e-5)


def test_motions_that_are_none(turning):
    with pytest.raises(DataError, match="at least 6 frames, here are 5"):
        SmoothMotion(turning.poses[:5], turning.times_s[:5])
    with pytest.raises(DataError, match="times must increase"):
        SmoothMotion(turning.poses, turning.times_s[::-1])
    spun = RigidTransform.from_rotation(Rotation.from_rotvec(np.outer(np.arange(8), [0, 2.0, 0])))
    with pytest.raises(DataError, match=r"frames \d and \d turn by 115 deg"):
        SmoothMotion(spun, np.arange(8.0))
    with pytest.raises(DataError, match="outside the motion, 0 to"):
        turning.at(np.array([-0.1]))
