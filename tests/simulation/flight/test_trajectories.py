import numpy as np
import pytest

from flowlik.errors import DataError
from flowlik.simulation.flight import TRAJECTORIES, lap_frames
from flowlik.simulation.flight._trajectories import curve, forest_fig8, hover, straight, training
from flowlik.simulation.worlds.paths import LOOP_LENGTH_M, keep_free


def test_straight_flies_along_z_at_its_speed() -> None:
    poses = straight(61, speed_mps=6.0, frames_per_second=60.0)
    np.testing.assert_allclose(poses.translation[-1], [0, 0, 6])
    np.testing.assert_allclose(poses.rotation.magnitude(), 0)


@pytest.mark.parametrize("fly", [straight, curve, forest_fig8])
@pytest.mark.parametrize("factor", [0.25, 2, 4])
def test_another_speed_is_the_same_path(fly, factor: float) -> None:
    slow, fast = fly(401, 6.0 * min(factor, 1), seed=2), fly(101, 6.0 * max(factor, 1), seed=2)
    ratio = round(max(factor, 1) / min(factor, 1))
    shared = slow.as_matrix()[::ratio]
    count = min(len(shared), 101)
    np.testing.assert_allclose(fast.as_matrix()[:count], shared[:count], atol=1e-12)


def test_training_turns_both_ways_in_all_degrees_of_freedom() -> None:
    poses = training(3000)
    steps = poses[:-1].inv() * poses[1:]
    rotations, translations = steps.rotation.as_rotvec(), steps.translation
    assert (np.quantile(rotations, 0.95, axis=0) > np.deg2rad(0.3)).all()
    assert (np.quantile(rotations, 0.05, axis=0) < -np.deg2rad(0.3)).all()
    speeds_mps = np.linalg.norm(translations, axis=1) * 60
    assert speeds_mps.min() < 3.5 and speeds_mps.max() > 9 and abs(speeds_mps.mean() - 6) < 0.5


@pytest.mark.parametrize("name", sorted(set(TRAJECTORIES) - {"hover"}))
def test_camera_moves_smoothly_and_looks_roughly_ahead(name: str) -> None:
    poses = TRAJECTORIES[name](1000, 6.0, 60.0, 1)
    steps = poses[:-1].inv() * poses[1:]
    assert np.rad2deg(steps.rotation.magnitude()).max() < 4
    ahead = steps.translation[:, 2] / np.linalg.norm(steps.translation, axis=1)
    assert ahead.min() > 0.5


def test_figure_eight_closes_after_a_lap_at_constant_speed() -> None:
    assert LOOP_LENGTH_M >= 100
    poses = forest_fig8(lap_frames())
    assert len(poses) == 1981
    np.testing.assert_allclose(poses[-1].as_matrix(), poses[0].as_matrix(), atol=1e-9)
    steps = poses[:-1].inv() * poses[1:]
    lengths_m = np.linalg.norm(steps.translation, axis=1)
    np.testing.assert_allclose(lengths_m, 0.1, rtol=1e-4)
    assert lengths_m.sum() == pytest.approx(LOOP_LENGTH_M, rel=1e-5)
    # heading along the path, and level
    assert (steps.translation[:, 2] / lengths_m).min() > 0.9999
    np.testing.assert_allclose(poses.translation[:, 1], 0, atol=1e-12)
    again = forest_fig8(lap_frames(laps=2))
    np.testing.assert_allclose(again[1980:].as_matrix(), poses.as_matrix(), atol=1e-9)


@pytest.mark.parametrize(("speed", "rate"), [(6.0, 60.0), (9.0, 60.0), (4.7, 25.0)])
def test_a_lap_of_any_speed_ends_near_its_beginning(speed: float, rate: float) -> None:
    poses = forest_fig8(lap_frames(speed, rate, laps=3), speed, rate)
    gap_m = np.linalg.norm(poses.translation[-1] - poses.translation[0])
    assert gap_m <= 0.5001 * speed / rate


def test_figure_eight_turns_both_ways_and_banks_into_the_turns() -> None:
    poses = forest_fig8(lap_frames())
    yaw = (poses[:-1].inv() * poses[1:]).rotation.as_rotvec()[:, 1]
    right_side_down = poses.rotation.apply([1.0, 0, 0])[:-1, 1]
    assert yaw.min() < -0.005 and yaw.max() > 0.005
    turning = np.abs(yaw) > 1e-3
    assert (np.sign(right_side_down) == np.sign(yaw))[turning].all()
    assert 5 < np.rad2deg(np.arcsin(right_side_down)).max() < 12


def test_straight_and_figure_eight_stay_on_the_centre_lines() -> None:
    free_m = keep_free()
    for poses in (straight(1001), forest_fig8(lap_frames())):
        nearest_m = np.linalg.norm(poses.translation[::7, None] - free_m, axis=-1).min(axis=1)
        assert nearest_m.max() < 0.2
    np.testing.assert_allclose(straight(1001).translation[-1], [0, 0, 100], atol=1e-9)


def test_hovering_is_standing_still() -> None:
    poses = hover(5, speed_mps=9.0, seed=3)
    assert len(poses) == 5
    np.testing.assert_array_equal(poses.as_matrix(), poses[:1].as_matrix().repeat(5, axis=0))


def test_a_lap_at_no_speed_never_ends() -> None:
    with pytest.raises(DataError, match="impossible lap"):
        lap_frames(speed_mps=0.0)


def test_seed_draws_the_path() -> None:
    assert np.array_equal(curve(9, seed=1).as_matrix(), curve(9, seed=1).as_matrix())
    assert not np.allclose(curve(9, seed=1).as_matrix(), curve(9, seed=2).as_matrix())


@pytest.mark.parametrize(("frames", "speed", "rate"), [(0, 6.0, 60.0), (5, np.nan, 60.0), (5, 6.0, 0.0)])
def test_impossible_flights_are_refused(frames: int, speed: float, rate: float) -> None:
    with pytest.raises(DataError, match="impossible flight"):
        straight(frames, speed, rate)
