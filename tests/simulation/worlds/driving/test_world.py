import json
import pickle

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from flowlik.errors import DataError
from flowlik.geometry.camera import Pinhole
from flowlik.simulation._base import Frame
from flowlik.simulation.worlds.driving import DrivingWorld
from flowlik.simulation.worlds.driving import _world as driving
from flowlik.simulation.worlds.driving._kinds import make_kinds
from flowlik.simulation.worlds.driving._places import Footprints
from flowlik.simulation.worlds.driving._route import CAMERA_HEIGHT_M, Route
from flowlik.support.arrays import Array

CAMERA = Pinhole(240, 72, 139.4, 139.4, 117.8, 33.4)
LEAVES = 300


def poses(plan: Array, heights: Array | float = 0.0) -> RigidTransform:
    """Camera poses that look where they go."""
    along = np.gradient(plan, axis=0)
    turn = Rotation.from_euler("y", np.arctan2(along[:, [0]], along[:, [1]]))
    positions = np.column_stack([plan[:, 0], np.broadcast_to(heights, len(plan)), plan[:, 1]])
    return RigidTransform.from_components(positions, turn)


def straight(length_m: float = 120.0, step_m: float = 0.8) -> RigidTransform:
    z = np.arange(0, length_m, step_m)
    return poses(np.column_stack([0 * z, z]))


def bend() -> RigidTransform:
    angle = np.linspace(0, np.pi / 2, 30)[1:]
    before = np.column_stack([np.zeros(60), np.linspace(0, 60, 60)])
    corner = 12 * np.column_stack([1 - np.cos(angle), np.sin(angle)]) + [0, 60]
    after = corner[-1] + np.column_stack([np.linspace(1, 60, 60), np.zeros(60)])
    return poses(np.concatenate([before, corner, after]))


@pytest.fixture(scope="module")
def world() -> DrivingWorld:
    return DrivingWorld.along(straight(), traffic=4, leaves=LEAVES)


@pytest.fixture(scope="module")
def frame(world: DrivingWorld) -> Frame:
    return world.render(straight()[40], CAMERA, 4.0)


def test_the_road_lies_below_the_camera_in_the_picture(frame: Frame) -> None:
    v = 68
    depth = frame.depth[v, 105:130]
    np.testing.assert_allclose(depth, CAMERA_HEIGHT_M * CAMERA.fy / (v - CAMERA.cy), rtol=0.02)
    assert np.isfinite(frame.radiance).all()
    assert frame.radiance.min() >= 0
    assert 0.02 < frame.radiance.mean() < 0.8
    # houses and trees stand on both sides, and there is sky
    assert np.isinf(frame.depth).any()
    for side in (slice(0, 60), slice(180, 240)):
        assert (frame.depth[20:33, side] < 80).mean() > 0.1


def test_equal_worlds_render_equal_bytes(world: DrivingWorld, frame: Frame) -> None:
    again = DrivingWorld.along(straight(), traffic=4, leaves=LEAVES)
    assert again == world
    assert hash(again) == hash(world)
    for kept in (driving._scene, driving._patch, driving._things, driving._kinds):
        kept.cache_clear()
    other = again.render(straight()[40], CAMERA, 4.0)
    assert other.radiance.tobytes() == frame.radiance.tobytes()
    assert other.depth.tobytes() == frame.depth.tobytes()
    seeded = DrivingWorld.along(straight(), seed=1, traffic=4, leaves=LEAVES)
    assert seeded != world


def test_the_world_is_pickled_without_what_was_built(world: DrivingWorld, frame: Frame) -> None:
    data = pickle.dumps(world)
    assert len(data) < 20_000
    assert pickle.loads(data) == world


def test_parameters_are_plain_and_name_the_route(world: DrivingWorld) -> None:
    parameters = json.loads(json.dumps(world.parameters()))
    assert parameters["route"]["poses"] == len(straight())
    assert parameters["route"]["length_m"] == pytest.approx(119.2)
    assert parameters["route"]["sha256"] == Route.of(straight()).digest
    assert parameters["scenery"] == "street"
    other = DrivingWorld.along(bend(), leaves=LEAVES).parameters()
    assert other["route"]["sha256"] != parameters["route"]["sha256"]


@pytest.mark.parametrize(("scenery", "path"), [("street", bend), ("motorway", straight), ("country", bend)])
def test_nothing_but_the_road_stands_near_the_route(scenery: str, path: type) -> None:
    route = path()
    world = DrivingWorld.along(route, seed=2, scenery=scenery, leaves=LEAVES)
    positions = route.translation
    clearance_m = world.clearance(positions)
    assert clearance_m.min() > 0.9
    assert np.median(clearance_m) == pytest.approx(CAMERA_HEIGHT_M, abs=0.05)
    # negative below ground, and near things where things are
    below = positions + np.array([0.0, 2.0, 0.0])
    np.testing.assert_allclose(world.clearance(below), -(2.0 - CAMERA_HEIGHT_M), atol=0.1)
    aside = positions[:, [0, 2]] + np.array([[9.0, 0.0]])
    high = np.column_stack([aside[:, 0], world.surface_m(aside) - 1.0, aside[:, 1]])
    assert (world.clearance(high) < 0.95).any()


def test_a_square_holds_the_same_whichever_scene_asks_for_it(world: DrivingWorld) -> None:
    layout = world._layout
    for square in ((0, 0), (-1, 1), (5, 7)):
        a, b = layout.square(square, 2), layout.square(square, 2)
        assert a.transforms.tobytes() == b.transforms.tobytes()
        most, tall = layout.square(square, 1), layout.square(square, 0)
        assert len(tall) <= len(most) <= len(a)
        feet = a.transforms[:, [0, 2], 3]
        assert ((feet >= np.array(square) * 64.0) & (feet < np.array(square) * 64.0 + 64.0)).all()


def test_things_stand_on_the_ground_and_houses_keep_off_the_road(world: DrivingWorld) -> None:
    layout, ground = world._layout, world._ground
    kinds = layout.kinds
    houses = [n for kind in ("house", "block") for n in kinds.numbers[kind]]
    found = 0
    for i in range(-2, 2):
        for j in range(-2, 4):
            instances = layout.square((i, j), 2)
            feet = instances.transforms[:, :, 3]
            gap = ground.surface(feet[:, [0, 2]]) - feet[:, 1]
            assert np.abs(gap).max() < 0.12
            built = np.isin(instances.prototypes, houses)
            half = kinds.half_sizes_m[instances.prototypes[built]]
            for transform, (a, b) in zip(instances.transforms[built], half):
                corners = np.array([(x * a, 0, z * b) for x in (-1, 0, 1) for z in (-1, 1)])
                points = corners @ transform[:, :3].T + transform[:, 3]
                assert ground.roads.edge(points[:, [0, 2]]).min() > 3.9
                found += 1
    assert found > 8


def test_traffic_drives_on_the_road_and_keeps_its_distance(world: DrivingWorld) -> None:
    camera = straight().translation
    lanes = np.array([vehicle.lateral_m for vehicle in world._traffic.vehicles])
    assert (lanes == 0).any()
    assert (lanes < 0).any()
    for k in range(0, len(camera), 7):
        T_n_o = world.mover_poses(k / 10)
        assert T_n_o is not None
        positions, axes = T_n_o.translation, T_n_o.rotation.as_matrix()
        np.testing.assert_allclose(positions[:, 1], world._ground.level(positions[:, [0, 2]]), atol=1e-9)
        np.testing.assert_allclose(positions[:, 0], lanes, atol=0.05)
        assert (axes[:, 1, 1] > 0.99).all()
        away = np.linalg.norm(positions - camera[k], axis=1)
        assert away[lanes == 0].min() >= 12.0
        assert away.min() > 3.0
        apart = np.linalg.norm(positions[:, None] - positions[None], axis=-1) + 99 * np.eye(len(lanes))
        assert apart.min() > 2.7
    moved = world.mover_poses(3.0).translation - world.mover_poses(2.0).translation  # type: ignore[union-attr]
    assert (np.sign(moved[:, 2]) == np.where(lanes == 0, 1, -1)).all()


def test_the_picture_shows_moving_vehicles_where_they_are(world: DrivingWorld, frame: Frame) -> None:
    assert frame.movers is not None
    T_n_o = world.mover_poses(4.0)
    assert T_n_o is not None
    shown = np.unique(frame.movers[frame.movers >= 0])
    assert len(shown) >= 1
    prototypes = world._layout.kinds.prototypes
    pixels = CAMERA.pixel_grid().reshape(*frame.depth.shape, 2)
    for i in shown:
        seen = frame.movers == i
        rays = CAMERA.rays(pixels[seen])
        points = T_n_o[int(i)].inv().apply(straight()[40].apply(rays * frame.depth[seen][:, None]))
        vertices = prototypes[world._traffic.prototypes[i]].mesh.vertices
        assert (points > vertices.min(axis=0) - 1e-3).all()
        assert (points < vertices.max(axis=0) + 1e-3).all()


def test_without_traffic_nothing_moves() -> None:
    still = DrivingWorld.along(straight(), leaves=LEAVES)
    assert still.mover_poses(1.0) is None


def test_too_much_traffic_is_refused() -> None:
    crowded = DrivingWorld.along(straight(20.0), traffic=400, leaves=LEAVES)
    with pytest.raises(DataError, match="no room for 400 moving vehicles"):
        crowded.mover_poses(0.0)


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"seed": -1}, "must be 0 or more"),
        ({"traffic": -1}, "must be 0 or more"),
        ({"leaves": 3}, "leaves 3 at least 10"),
        ({"frames_per_second": 0.0}, "frame rate 0.0 must be positive"),
        ({"scenery": "moon"}, "unknown scenery 'moon'"),
    ],
)
def test_impossible_worlds_are_refused(wrong: dict[str, float], message: str) -> None:
    with pytest.raises(DataError, match=message):
        DrivingWorld.along(straight(), **wrong)


def test_footprints_overlap_like_rectangles() -> None:
    taken = Footprints()
    diagonal = np.sqrt(0.5)
    taken.add(np.array([0.0, 0.0, diagonal, diagonal, 4.0, 1.0]))
    # beside the turned block, though inside its upright bounds
    assert not taken.overlaps(np.array([2.5, -2.5, 1.0, 0.0, 0.5, 0.5]))
    assert taken.overlaps(np.array([2.5, 2.5, 1.0, 0.0, 0.5, 0.5]))
    assert taken.overlaps(np.array([2.5, -2.5, 1.0, 0.0, 0.5, 0.5]), margin_m=2.5)
    points = np.array([[0.0, 0.0], [2.0, 2.0], [2.0, -2.0], [40.0, 0.0]])
    np.testing.assert_array_equal(taken.clear(points, 0.1), [False, False, True, True])
    np.testing.assert_array_equal(taken.clear(points, 2.0), [False, False, False, True])


def test_street_trees_leave_room_below_their_crowns() -> None:
    kinds = make_kinds(0, LEAVES)
    for number in kinds.numbers["avenue"]:
        foliage = kinds.prototypes[number].foliage
        assert foliage is not None
        assert len(foliage) > LEAVES / 2
        assert foliage.centres[:, 1].max() < -3
