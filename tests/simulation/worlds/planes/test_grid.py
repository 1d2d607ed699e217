import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from flowlik.errors import DataError
from flowlik.geometry.camera import Pinhole
from flowlik.simulation import GridWorld, PlanesWorld
from flowlik.simulation.flight import TRAJECTORIES


def facing(position_m: list[float], axis: str, degrees: float) -> RigidTransform:
    return RigidTransform.from_components(position_m, Rotation.from_euler(axis, degrees, degrees=True))


@pytest.mark.parametrize(
    ("pose", "along"),
    [(facing([0, 0, 30], "y", 90), [0, 0, 1]), (facing([0, 0, 30], "x", -90), [1, 0, 0])],
    ids=["wall", "ground"],
)
@pytest.mark.parametrize("period_m", [0.5, 0.8])
def test_a_step_of_one_period_changes_nothing_and_half_of_it_does(pose, along, period_m: float) -> None:
    world = GridWorld(rectangles=0, period_m=period_m)
    camera = Pinhole.from_fov(64, 48, 20.0)
    step = RigidTransform.from_translation(period_m * np.array(along, float))
    here, there = (world.render(p, camera) for p in (pose, step * pose))
    np.testing.assert_allclose(there.radiance, here.radiance, atol=1e-4)
    np.testing.assert_allclose(there.depth, here.depth, rtol=1e-12)
    halfway = world.render(RigidTransform.from_translation(step.translation / 2) * pose, camera).radiance
    assert here.radiance.std() > 0.02
    assert np.abs(halfway - here.radiance).max() > 0.05


def test_geometry_is_that_of_planes_and_patterns_are_of_three_kinds(camera: Pinhole) -> None:
    pose = facing([0.5, -0.3, 20], "y", 20)
    np.testing.assert_array_equal(
        GridWorld(4).render(pose, camera).depth, PlanesWorld(4).render(pose, camera).depth
    )
    assert set(GridWorld()._paint.tiles[:6, 0]) == {0, 1, 2}
    tiles = GridWorld()._paint.textures.pyramids[:, : 256**2].reshape(3, 256, 256)
    assert all(set(np.unique(tile)) == {-1.0, 1.0} for tile in tiles)


def test_far_patterns_fade_to_grey_instead_of_aliasing() -> None:
    """From afar a period is a fraction of a pixel: neighbouring poses see the same grey."""
    world, camera = GridWorld(rectangles=0), Pinhole.from_fov(64, 48, 90.0)
    poses = [RigidTransform.from_translation([0.1 * i, 0.0, 0.0]) for i in range(3)]
    small = Pinhole(16, 8, 12.0, 12.0, 7.5, 3.5)
    end = [world.render(pose, small).radiance[3:5, 7:9] for pose in poses]
    assert np.ptp(np.stack(end), axis=0).max() < 0.01
    assert world.render(poses[0], camera).radiance.std() > 0.02


@pytest.mark.parametrize("name", TRAJECTORIES)
def test_every_trajectory_keeps_clear(name: str) -> None:
    poses = TRAJECTORIES[name](600, 6.0, 60.0, 1)
    assert GridWorld(1).clearance(poses.translation).min() > 1.0


@pytest.mark.parametrize("bad", [{"seed": -1}, {"rectangles": -1}, {"samples": 0}, {"period_m": 0.0}])
def test_impossible_worlds_are_refused(bad: dict[str, float]) -> None:
    with pytest.raises(DataError, match="impossible"):
        GridWorld(**bad)
