import numpy as np
import pytest

from flowlik.simulation._noise import TILE_PX
from flowlik.simulation.render import Mesh
from flowlik.simulation.render._textures._built import BUILT_TILES
from flowlik.simulation.things import (
    billboard,
    bollard,
    facade_block,
    fence,
    gantry,
    garden_wall,
    guard_rail,
    hedge,
    house,
    railing,
    street_lamp,
    traffic_sign,
)
from flowlik.simulation.things._buildings import STOREY_M
from flowlik.simulation.things._walls import FRAME, PANE, Plane, pierced_wall
from flowlik.support.arrays import Array

WALL, ROOF, WINDOW = 0, 1, 2


def rng() -> np.random.Generator:
    return np.random.default_rng(5)


MESHES = {
    "house": lambda: house(rng(), WALL, ROOF, WINDOW, 10.0, 8.0, 2),
    "block": lambda: facade_block(rng(), WALL, 3, ROOF, 12.0, 10.0, 4),
    "garden wall": lambda: garden_wall(4.0, 1.2, 0, 1),
    "fence": lambda: fence(4.0, 1.2, 0, 1),
    "railing": lambda: railing(4.0, 1.2, 0),
    "hedge": lambda: hedge(rng(), 0, 1, 2.0, 1.3).mesh,
    "lamp": lambda: street_lamp(0, 1),
    "sign": lambda: traffic_sign(rng(), 0, 1, 4.0),
    "billboard": lambda: billboard(rng(), 0, 1, 4.0),
    "bollard": lambda: bollard(0, 1),
    "guard rail": lambda: guard_rail(4.0, 0),
    "gantry": lambda: gantry(16.0, 0, 1, 4.0),
}


def face_normals(mesh: Mesh) -> tuple[Array, Array]:
    """Unit normals (F, 3) by the corners, and areas (F,)."""
    a, b, c = np.moveaxis(mesh.vertices[mesh.triangles].astype(np.float64), 1, 0)
    normals = np.cross(b - a, c - a)
    size = np.linalg.norm(normals, axis=1)
    return normals / size[:, None], size / 2


@pytest.mark.parametrize("name", MESHES)
def test_faces_are_whole_and_their_normals_upright_on_them(name: str) -> None:
    mesh = MESHES[name]()
    np.testing.assert_allclose(np.linalg.norm(mesh.normals, axis=1), 1, atol=1e-5)
    normals, areas = face_normals(mesh)
    assert areas.min() > 1e-6
    turned = np.abs((normals * mesh.normals[mesh.triangles[:, 0]]).sum(axis=1))
    # round posts are shaded smoothly, and their small tops are closed
    flat = turned > (0.8 if name in ("lamp", "sign") else 0.999)
    assert areas[~flat].sum() < (0.01 * areas.sum() if name in ("lamp", "sign") else 1e-9)


@pytest.mark.parametrize("name", MESHES)
def test_the_same_seed_gives_the_same_bytes(name: str) -> None:
    a, b = MESHES[name](), MESHES[name]()
    assert a.vertices.tobytes() == b.vertices.tobytes()
    assert a.uv.tobytes() == b.uv.tobytes()


@pytest.mark.parametrize("name", MESHES)
def test_things_stand_in_the_ground(name: str) -> None:
    y = MESHES[name]().vertices[:, 1]
    assert y.max() >= 0.04
    assert y.min() < -0.7


def test_a_house_has_walls_below_ground_and_a_roof_with_eaves() -> None:
    mesh = house(rng(), WALL, ROOF, WINDOW, 10.0, 8.0, 2)
    of = {m: mesh.vertices[np.unique(mesh.triangles[mesh.materials == m])] for m in (WALL, ROOF, WINDOW)}
    assert of[WALL][:, 1].max() == pytest.approx(1.0)
    assert of[ROOF][:, 1].max() < -2 * STOREY_M
    np.testing.assert_allclose(np.abs(of[ROOF][:, [0, 2]]).max(axis=0), [5.4, 4.4], atol=1e-4)
    roof_faces = mesh.normals[mesh.triangles[mesh.materials == ROOF, 0]]
    assert (roof_faces[:, 1] < -0.6).all()
    assert set(np.unique(mesh.paint[mesh.triangles[mesh.materials == WINDOW]])) == {PANE, FRAME}


def test_windows_lie_behind_the_wall_and_leave_a_hole_in_it() -> None:
    plane = Plane(np.zeros(3), np.array([1.0, 0, 0]), np.array([0.0, -1, 0]))
    mesh = pierced_wall(plane, 6.0, 3.0, [(1.0, 2.0), (4.0, 5.0)], [(1.0, 2.2)], WALL, WINDOW)
    _, areas = face_normals(mesh)
    in_front = (mesh.materials == WALL) & (np.abs(mesh.vertices[mesh.triangles][..., 2]).max(axis=1) < 1e-6)
    assert areas[in_front].sum() == pytest.approx(6.0 * 4.0 - 2 * 1.2, rel=1e-5)
    pane = mesh.vertices[mesh.triangles[mesh.materials == WINDOW]]
    # the front looks towards -z, so 12 cm behind it is z = 0.12
    behind = pane[pane[..., 2].min(axis=1) > 0.1]
    a, b, c = np.moveaxis(behind, 1, 0)
    assert np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2 == pytest.approx(2 * 1.2, rel=1e-4)
    # reveals join the two, seen from the opening
    middle = np.array([1.5, -1.6, 0.06])
    deep = (mesh.materials == WALL) & (mesh.vertices[mesh.triangles][..., 2].max(axis=1) > 0.1)
    near = deep & (mesh.vertices[mesh.triangles].mean(axis=1)[:, 0] < 3)
    inward = (middle - mesh.vertices[mesh.triangles].mean(axis=1)) * mesh.normals[mesh.triangles[:, 0]]
    assert near.sum() == 8
    assert (inward.sum(axis=1)[near] > 0).all()


def test_facades_count_their_texture_from_the_ground() -> None:
    mesh = facade_block(rng(), WALL, 3, ROOF, 12.0, 10.0, 4)
    walls = np.unique(mesh.triangles[mesh.materials == WALL])
    np.testing.assert_allclose(mesh.uv[walls, 1], -mesh.vertices[walls, 1], atol=1e-5)


def test_hedges_are_covered_with_leaves_in_the_light() -> None:
    plant = hedge(rng(), 0, 1, 2.0, 1.3)
    assert plant.foliage is not None
    leaves = plant.foliage
    assert len(leaves) > 500
    assert np.abs((leaves.along * leaves.across).sum(axis=1)).max() < 1e-6
    assert np.abs((leaves.along * leaves.normals).sum(axis=1)).max() < 1e-6
    assert leaves.centres[:, 1].max() < 0.01
    assert -1.5 < leaves.centres[:, 1].min() < -1.2
    assert (leaves.shade > 0.15).all()
    assert (leaves.shade <= 1).all()


@pytest.mark.parametrize("name", BUILT_TILES)
def test_tiles_are_grey_images_that_fill_their_range_sensibly(name: str) -> None:
    tile = BUILT_TILES[name](np.random.default_rng(1))
    assert tile.shape == (TILE_PX, TILE_PX)
    assert tile.dtype == np.float32
    assert tile.min() >= 0
    assert tile.max() <= 1
    assert 0.25 < tile.mean() < 0.7
    assert tile.std() > 0.02
    assert BUILT_TILES[name](np.random.default_rng(1)).tobytes() == tile.tobytes()


@pytest.mark.parametrize(
    "name", ["asphalt", "road-wear", "concrete", "plaster", "car-paint", "glass", "hedge"]
)
def test_tiles_without_joints_match_across_their_borders(name: str) -> None:
    tile = BUILT_TILES[name](np.random.default_rng(2)).astype(np.float64)
    for axis in (0, 1):
        steps = np.abs(np.diff(tile, axis=axis)).mean()
        first, last = np.take(tile, 0, axis=axis), np.take(tile, -1, axis=axis)
        # patches of a road end there too
        assert np.abs(first - last).mean() < (8 if name == "road-wear" else 1.5) * steps
