import numpy as np
import pytest

from flowlik.errors import DataError
from flowlik.simulation.worlds.forest._hills import HILLS_TO_M, hills
from flowlik.simulation.worlds.forest._terrain import CENTRE_M, INNER_M, Lattice, Terrain
from flowlik.simulation.worlds.paths import figure_eight, keep_free


@pytest.fixture(scope="module", params=[0, 5])
def terrain(request: pytest.FixtureRequest) -> Terrain:
    return Terrain.of(request.param)


def test_ground_is_level_below_the_paths(terrain: Terrain) -> None:
    lines = keep_free()
    ground = terrain.ground_m(lines[:, 0], lines[:, 2])
    assert ground.min() > 1.7 and ground.max() < 2.3
    eight = figure_eight(np.arange(0, 200, 0.25))[0]
    assert np.abs(np.diff(terrain.ground_m(eight[:, 0], eight[:, 2]))).max() < 0.1


def test_ground_rolls_farther_away(terrain: Terrain) -> None:
    heights = terrain.outer.values
    assert 3 < np.ptp(heights) < 15


def test_ground_height_is_that_of_the_mesh(terrain: Terrain) -> None:
    for patch in terrain.patches(0):
        corners = patch.vertices[patch.triangles[::7]].astype(float)
        weights = np.random.default_rng(0).dirichlet([1, 1, 1], len(corners))
        # off the patch's border, where it is the neighbour's mesh that counts
        points = np.einsum("fk,fki->fi", weights, corners)
        np.testing.assert_allclose(terrain.ground_m(points[:, 0], points[:, 2]), points[:, 1], atol=1e-4)


def test_patches_tile_the_square(terrain: Terrain) -> None:
    area_m2 = 0.0
    for patch in terrain.patches(2):
        a, b, c = (patch.vertices[patch.triangles[:, i]][:, [0, 2]].astype(float) for i in range(3))
        area_m2 += np.abs(np.linalg.det(np.stack([b - a, c - a], axis=1))).sum() / 2
        assert (patch.materials == 2).all() and (patch.normals[:, 1] < -0.5).all()
    assert area_m2 == pytest.approx(terrain.extent_m**2)


def test_fine_and_coarse_ground_meet(terrain: Terrain) -> None:
    low, high = CENTRE_M - INNER_M / 2, CENTRE_M + INNER_M / 2
    x = np.linspace(low[0], high[0], 500)
    for z in (low[1], high[1]):
        np.testing.assert_allclose(terrain.inner.at(x, 0 * x + z), terrain.outer.at(x, 0 * x + z), atol=1e-9)


def test_lattice_is_linear_on_its_triangles() -> None:
    values = np.array([[0.0, 1.0], [10.0, 100.0]])
    lattice = Lattice(np.zeros(2), 2.0, values)
    points = np.array([[2, 0, 1.0], [1, 1, 50], [2, 1, 50.5], [1, 2, 55], [0, 1, 5], [9, 9, 100]])
    np.testing.assert_allclose(lattice.at(points[:, 0], points[:, 1]), points[:, 2])


def test_distance_to_the_paths(terrain: Terrain) -> None:
    lines = keep_free()[:, [0, 2]]
    points = CENTRE_M + np.random.default_rng(1).uniform(-1, 1, (300, 2)) * INNER_M / 2
    exact = np.linalg.norm(points[:, None] - lines, axis=2).min(axis=1)
    np.testing.assert_allclose(terrain.path_distance_m(*points.T), exact, atol=0.1)


def test_the_track_follows_the_paths(terrain: Terrain) -> None:
    paint = terrain.inner_paint
    x, z = np.meshgrid(paint.x, paint.z)
    track = paint.values > 1.8
    assert terrain.path_distance_m(x[track], z[track]).max() < 4
    assert 300 < track.sum() * paint.cell_m**2 < 1000
    assert paint.values.min() >= 0 and paint.values.max() <= 2
    assert (paint.values < 0.2).any() and (np.abs(paint.values - 1) < 0.01).any()


def test_hills_begin_at_the_ground_and_close_the_view(terrain: Terrain) -> None:
    pieces = list(hills(0, terrain, 4))
    vertices = np.concatenate([piece.vertices for piece in pieces]).astype(float)
    half = np.abs(vertices[:, [0, 2]] - CENTRE_M).max(axis=1)
    assert half.min() == pytest.approx(terrain.extent_m / 2)
    assert half.max() > 0.95 * HILLS_TO_M
    foot = vertices[half < terrain.extent_m / 2 + 1e-3]
    np.testing.assert_allclose(terrain.outer.at(foot[:, 0], foot[:, 2]), foot[:, 1], atol=1e-4)
    for eye in ([0.0, 0.0, 50.0], [100.0, -2.0, 150.0], [-100.0, 0.0, -50.0]):
        away = vertices - eye
        level = np.hypot(away[:, 0], away[:, 2])
        heading = (np.degrees(np.arctan2(away[:, 0], away[:, 2])) % 360 // 3).astype(int)
        crest = [(-away[heading == h, 1] / level[heading == h]).max() for h in np.unique(heading)]
        assert len(crest) == 120 and min(crest) > np.tan(np.deg2rad(0.5))


def test_hill_pieces_share_their_borders(terrain: Terrain) -> None:
    pieces = list(hills(0, terrain, 4))
    for piece, following in zip(pieces, pieces[1:] + pieces[:1]):
        columns = np.reshape(piece.vertices, (-1, 17, 3)), np.reshape(following.vertices, (-1, 17, 3))
        np.testing.assert_array_equal(columns[0][:, -1], columns[1][:, 0])


@pytest.mark.parametrize("sizes", [(250.0, 0.5), (160.0, 0.5), (256.0, 0.0), (256.0, 0.7), (256.0, 4.0)])
def test_impossible_sizes_are_refused(sizes: tuple[float, float]) -> None:
    with pytest.raises(DataError, match="impossible terrain"):
        Terrain.of(0, *sizes)
