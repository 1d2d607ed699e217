import json

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from flowlik.errors import DataError
from flowlik.geometry.camera import Pinhole
from flowlik.simulation.flight._trajectories import curve, straight, training
from flowlik.simulation.render import Daylight, Prototype
from flowlik.simulation.render._textures.tiles import TILES
from flowlik.simulation.worlds.forest import ForestWorld
from flowlik.simulation.worlds.forest._kinds import MATERIALS, make_kinds
from flowlik.simulation.worlds.paths import FREE_RADIUS_M, keep_free
from flowlik.support.arrays import Array

TINY = {
    "near_trees": 20,
    "far_trees": 40,
    "bushes": 40,
    "ferns": 30,
    "grass": 60,
    "rocks": 20,
    "houses": 2,
    "leaves": 500,
    "extent_m": 192.0,
    "cell_m": 1.0,
}
LOW = ("stone", "fern", "grass")
"""What may stand below the paths."""


@pytest.fixture(scope="module")
def world() -> ForestWorld:
    return ForestWorld(seed=2, **TINY)


@pytest.fixture(scope="module")
def camera() -> Pinhole:
    return Pinhole.from_fov(160, 90, 120.0)


def pose(x: float, y: float, z: float, yaw_deg: float = 0.0, pitch_deg: float = 0.0) -> RigidTransform:
    turn = Rotation.from_euler("YX", [yaw_deg, pitch_deg], degrees=True)
    return RigidTransform.from_components([x, y, z], turn)


def surface_points(prototype: Prototype) -> Array:
    """Points on every triangle, and the ends of every leaf."""
    mesh, leaves = prototype.mesh, prototype.foliage
    weights = np.array([[1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 0], [0, 1, 1], [1, 0, 1], [1, 1, 1]], float)
    weights /= weights.sum(axis=1, keepdims=True)
    points = [np.einsum("wk,fki->fwi", weights, mesh.vertices[mesh.triangles].astype(float)).reshape(-1, 3)]
    if leaves is not None:
        centres, along, across = (a.astype(float) for a in (leaves.centres, leaves.along, leaves.across))
        points += [centres + s * along + t * across for s, t in ((0, 0), (1, 0), (-1, 0), (0, 1), (0, -1))]
    return np.concatenate(points)


def test_everything_keeps_clear_of_the_paths(world: ForestWorld) -> None:
    kinds, lines = make_kinds(world.seed, world.leaves, world.foliage), keep_free()
    checked = 0
    for name, copies in world._layout(kinds).items():
        least = 1.2 if name in LOW else FREE_RADIUS_M
        for which, transform in copies:
            points = surface_points(kinds[name][which]) @ transform[:, :3].T + transform[:, 3]
            points = points[np.abs(points[:, 1]) < least]
            if not len(points) or np.hypot(*(lines - transform[:, 3]).T[[0, 2]]).min() > 12:
                continue
            step = max(1, len(points) // 400)
            distance = np.linalg.norm(points[::step, None] - lines[::2], axis=2).min()
            assert distance > least - 0.02, (name, transform[:, 3])
            checked += 1
    assert checked > 20


def test_things_stand_on_the_ground(world: ForestWorld) -> None:
    kinds = make_kinds(world.seed, world.leaves, world.foliage)
    for copies in world._layout(kinds).values():
        feet = np.array([transform[:, 3] for _, transform in copies])
        sunk_m = feet[:, 1] - world._terrain.ground_m(feet[:, 0], feet[:, 2])
        assert sunk_m.min() > -1e-6 and sunk_m.max() < 0.3


def test_as_much_stands_there_as_was_asked_for(world: ForestWorld) -> None:
    stand = {
        name: len(copies) for name, copies in world._layout(make_kinds(world.seed, world.leaves, 1.0)).items()
    }
    assert stand["tree"] == 20 and stand["far tree"] == 40 and stand["rock"] + stand["stone"] == 20
    assert [stand[name] for name in ("bush", "fern", "grass", "house")] == [40, 30, 60, 2]


@pytest.mark.parametrize("fly", [straight, curve, training])
def test_every_trajectory_can_be_flown(world: ForestWorld, fly) -> None:
    poses = fly(300, 20.0, 60.0, 3)
    assert world.clearance(np.asarray(poses.translation)).min() > 0.5


def test_clearance_is_negative_outside(world: ForestWorld) -> None:
    ground_m = float(world._terrain.ground_m(np.array(0.0), np.array(20.0)))
    places = np.array(
        [[0, 0, 20], [0, ground_m - 0.4, 20], [0, ground_m + 0.5, 20], [97, -3, 20], [0, 0, 147]]
    )
    clearance = world.clearance(places)
    assert clearance[0] == pytest.approx(ground_m, abs=0.05)
    assert clearance[1] == pytest.approx(0.4, abs=0.02)
    np.testing.assert_allclose(clearance[2:], [-0.5, -1, -1], atol=1e-6)


def test_pictures_are_lit_and_deep(world: ForestWorld, camera: Pinhole) -> None:
    frame = world.render(pose(0, 0, 10), camera)
    assert frame.radiance.shape == frame.depth.shape == (90, 160)
    assert frame.movers is None and world.mover_poses(0.0) is None
    assert 0.02 < frame.radiance.mean() < 0.6 and (frame.radiance > 1).mean() < 0.05
    assert frame.radiance.std() > 0.05
    seen = frame.depth[np.isfinite(frame.depth)]
    assert 0.5 < seen.min() < 5 < np.quantile(seen, 0.9)


@pytest.mark.parametrize("place", [(0, 0, 50), (85, -6, 130), (-90, -4, -35), (0, -25, 50)])
@pytest.mark.parametrize("yaw_deg", [0, 90, 180, 270])
def test_no_edge_of_the_world_shows(world: ForestWorld, place, yaw_deg: float) -> None:
    wide = Pinhole.from_fov(120, 60, 100.0)
    depth = world.render(pose(*place, yaw_deg), wide).depth
    assert np.isfinite(depth[30:]).all()
    assert depth[np.isfinite(depth)].max() < 2000


def test_equal_worlds_render_equal_bytes(world: ForestWorld, camera: Pinhole) -> None:
    again, other = ForestWorld(seed=2, **TINY), ForestWorld(seed=3, **TINY)
    frames = [w.render(pose(0, 0, 30, 20), camera) for w in (world, again, other)]
    assert again == world and hash(again) == hash(world) and other != world
    assert frames[0].radiance.tobytes() == frames[1].radiance.tobytes()
    assert frames[0].depth.tobytes() == frames[1].depth.tobytes()
    assert not np.array_equal(frames[0].radiance, frames[2].radiance)


def test_worlds_can_be_built_again_from_their_parameters(world: ForestWorld) -> None:
    parameters = json.loads(json.dumps(world.parameters()))
    assert ForestWorld(**{**parameters, "light": Daylight(**parameters["light"])}) == world


def test_foliage_thins_the_crowns(world: ForestWorld, camera: Pinhole) -> None:
    up = pose(0, 0, 30, 0, 60)
    sky = []
    for foliage in (0.0, 1.0):
        depth = ForestWorld(seed=2, foliage=foliage, **TINY).render(up, camera).depth
        sky.append(np.isinf(depth).mean())
    assert sky[0] > sky[1] + 0.05


def test_small_forest_differs_from_the_whole_one() -> None:
    small, whole = ForestWorld.small(4), ForestWorld(4)
    assert small.name == whole.name == "forest" and small != whole
    assert small.near_trees < whole.near_trees and small.leaves < whole.leaves


def test_materials_name_known_tiles() -> None:
    for name, material in MATERIALS.items():
        layers = [layer for surface in material.surfaces for layer in surface.layers]
        layers += [material.fray] if material.fray else []
        assert {layer.texture for layer in layers} <= set(TILES), name


@pytest.mark.parametrize(
    "wrong", [{"seed": -1}, {"near_trees": -1}, {"foliage": -0.5}, {"foliage": np.nan}, {"extent_m": 100.0}]
)
def test_impossible_worlds_are_refused(wrong) -> None:
    with pytest.raises(DataError, match=r"impossible (ForestWorld|terrain)"):
        ForestWorld(**wrong)


def test_too_many_things_are_refused(camera: Pinhole) -> None:
    crowded = ForestWorld(**{**TINY, "houses": 60})
    with pytest.raises(DataError, match="ask for fewer"):
        crowded.render(pose(0, 0, 0), camera)
