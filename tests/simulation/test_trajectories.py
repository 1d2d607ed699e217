import numpy as np
import pytest

from flowlik.errors import DataError
from flowlik.simulation.trajectories import TRAJECTORIES, curve, straight, training


def test_straight_flies_along_z_at_its_speed() -> None:
    poses = straight(61, speed_mps=6.0, frames_per_second=60.0)
    np.testing.assert_allclose(poses.translation[-1], [0, 0, 6])
    np.testing.assert_allclose(poses.rotation.magnitude(), 0)


@pytest.mark.parametrize("fly", [straight, curve])
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


@pytest.mark.parametrize("name", TRAJECTORIES)
def test_camera_moves_smoothly_and_looks_roughly_ahead(name: str) -> None:
    poses = TRAJECTORIES[name](1000, 6.0, 60.0, 1)
    steps = poses[:-1].inv() * poses[1:]
    assert np.rad2deg(steps.rotation.magnitude()).max() < 4
    ahead = steps.translation[:, 2] / np.linalg.norm(steps.translation, axis=1)
    assert ahead.min() > 0.5


def test_seed_draws_the_path() -> None:
    assert np.array_equal(curve(9, seed=1).as_matrix(), curve(9, seed=1).as_matrix())
    assert not np.allclose(curve(9, seed=1).as_matrix(), curve(9, seed=2).as_matrix())


@pytest.mark.parametrize(("frames", "speed", "rate"), [(0, 6.0, 60.0), (5, np.nan, 60.0), (5, 6.0, 0.0)])
def test_impossible_flights_are_refused(frames: int, speed: float, rate: float) -> None:
    with pytest.raises(DataError, match="impossible flight"):
        straight(frames, speed, rate)
