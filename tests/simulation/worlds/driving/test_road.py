import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from flowlik.errors import DataError
from flowlik.simulation.worlds.driving._ground import CELL_M, SQUARE_M, Ground, far_land
from flowlik.simulation.worlds.driving._profiles import PROFILES, profile_of
from flowlik.simulation.worlds.driving._roads import Roads, new_stretches
from flowlik.simulation.worlds.driving._route import CAMERA_HEIGHT_M, EXTENSION_M, Route, drive_of
from flowlik.simulation.worlds.driving._surface import GroundSurface, cut
from flowlik.support.arrays import Array

NAMES = ("asphalt", "kerb", "strip", "paving", "gravel", "ground", "marking")
NUMBERS = {name: i for i, name in enumerate(NAMES)}


def route_of(plan: Array, heights: Array | float = 0.0) -> Route:
    positions = np.column_stack([plan[:, 0], np.broadcast_to(heights, len(plan)), plan[:, 1]])
    return Route(positions, np.tile([0.0, 0.0, 1.0], (len(plan), 1)))


def straight(length_m: float, step_m: float = 0.8) -> Array:
    z = np.arange(0, length_m, step_m)
    return np.column_stack([0 * z, z])


def roads_of(route: Route, scenery: str = "street") -> Roads:
    return Roads.along(drive_of(route), PROFILES[scenery])


def block(side_m: float = 120.0, radius_m: float = 8.0) -> Array:
    """Once and a half around a block with rounded corners."""
    straight_m = side_m - 2 * radius_m
    corner = np.linspace(0, np.pi / 2, 12)[1:]
    edge = np.column_stack([np.zeros(100), np.linspace(0, straight_m, 100)])
    bend = radius_m * np.column_stack([1 - np.cos(corner), np.sin(corner)]) + edge[-1]
    quarter = np.concatenate([edge, bend])
    parts, start, turn = [], np.zeros(2), np.eye(2)
    for _ in range(6):
        parts.append(start + quarter @ turn)
        start = parts[-1][-1]
        turn = np.array([[0.0, -1.0], [1.0, 0.0]]) @ turn
    return np.concatenate(parts)


def test_the_line_follows_the_route_and_lies_below_the_camera() -> None:
    s = np.linspace(0, 300, 400)
    plan = np.column_stack([12 * np.sin(s / 40), s])
    heights = -0.04 * s
    route = route_of(plan, heights)
    drive = drive_of(route)
    distance, arc = drive.line.nearest(plan)
    assert distance.max() < 0.2
    inner = slice(20, -20)
    road = np.interp(arc, drive.line.arc_m, drive.line.heights)
    np.testing.assert_allclose(road[inner] - heights[inner], CAMERA_HEIGHT_M, atol=0.03)
    np.testing.assert_allclose(np.diff(drive.line.arc_m)[10:-10], 1.0, atol=0.05)
    # poses lie where the line says
    points, _ = drive.line.at(drive.arc_m)
    assert np.linalg.norm(points - plan, axis=1).max() < 1.0
    assert drive.arc_m[0] == pytest.approx(EXTENSION_M, abs=2.0)


@pytest.mark.parametrize("count", [1, 2, 50])
def test_standing_still_gives_a_straight_road_ahead(count: int) -> None:
    forward = np.tile([0.6, 0.0, 0.8], (count, 1))
    route = Route(np.tile([3.0, 1.0, -2.0], (count, 1)), forward)
    drive = drive_of(route)
    np.testing.assert_allclose(drive.line.along, np.tile([0.6, 0.8], (len(drive.line), 1)), atol=1e-9)
    assert drive.line.nearest(np.array([[3.0, -2.0]]))[0] < 1e-6
    np.testing.assert_allclose(drive.line.heights, 1.0 + CAMERA_HEIGHT_M)
    assert drive.line.arc_m[-1] == pytest.approx(2 * EXTENSION_M, rel=0.02)


def test_a_street_that_is_driven_again_is_laid_once() -> None:
    plan = block()
    points = drive_of(route_of(plan)).line.points
    stretches = new_stretches(points)
    laid = sum(last - first for first, last in stretches)
    around = 2 * EXTENSION_M + np.linalg.norm(np.diff(plan[: 4 * 111], axis=0), axis=1).sum()
    driven = len(points)
    assert driven > around + 150
    assert laid < around + 40
    # and there and back is one street
    there = straight(100)
    back = there[::-1] + np.array([-3.5, 0])
    assert len(new_stretches(np.concatenate([there, back]))) == 1


def test_the_roadway_of_a_straight_street_ends_where_the_profile_says() -> None:
    roads = roads_of(route_of(straight(200)))
    x = np.linspace(-30, 30, 241)
    points = np.column_stack([x, np.full_like(x, 100.0)])
    np.testing.assert_allclose(roads.edge(points), np.abs(x + 1.75) - 3.5, atol=1e-6)


def test_every_pose_lies_on_the_roadway_and_edges_have_no_jumps() -> None:
    rng = np.random.default_rng(3)
    plan = block() + rng.normal(0, 0.05, (6 * 111, 2))
    roads = roads_of(route_of(plan))
    assert roads.edge(plan).max() < -1.0
    points = rng.uniform(-30, 150, (4000, 2))
    near = points + rng.normal(0, 0.3, points.shape)
    change = np.abs(roads.edge(points) - roads.edge(near))
    assert (change <= np.linalg.norm(points - near, axis=1) + 1e-9).all()


def test_speed_chooses_the_scenery() -> None:
    assert profile_of("auto", route_of(straight(200, 0.8)).positions_m, 10.0).name == "street"
    assert profile_of("auto", route_of(straight(200, 1.5)).positions_m, 10.0).name == "country"
    assert profile_of("auto", route_of(straight(200, 2.5)).positions_m, 10.0).name == "motorway"
    assert profile_of("auto", route_of(straight(200, 2.5)).positions_m, 3.0).name == "street"
    with pytest.raises(DataError, match="unknown scenery 'desert'"):
        profile_of("desert", np.zeros((1, 3)), 10.0)


def test_the_ground_lies_below_the_camera_even_where_two_passes_differ_in_height() -> None:
    there = straight(200)
    route = route_of(there, 0.02 * there[:, 1])
    ground = Ground(roads_of(route), seed=0)
    below = ground.level(there) - route.positions_m[:, 1]
    np.testing.assert_allclose(below[10:-10], CAMERA_HEIGHT_M, atol=0.06)
    back = there[::-1] + np.array([-3.5, 0])
    differing = np.concatenate([np.zeros(len(there)), np.full(len(back), 1.5)])
    route = route_of(np.concatenate([there, back]), differing)
    ground = Ground(roads_of(route), seed=0)
    assert (ground.level(route.positions_m[:, [0, 2]]) - route.positions_m[:, 1]).min() > 1.2


def test_cutting_keeps_the_area_and_the_winding() -> None:
    rng = np.random.default_rng(0)
    triangles = rng.normal(size=(500, 3, 3))
    triangles[::7, 1, 2] = 0.3  # corners on the cut
    below, above, border = cut(triangles, 0.3)

    def areas(t: Array) -> Array:
        a, b = t[:, 1, :2] - t[:, 0, :2], t[:, 2, :2] - t[:, 0, :2]
        return (a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]) / 2

    signed = areas(triangles)
    pieces = np.concatenate([areas(below), areas(above)])
    assert pieces.sum() == pytest.approx(signed.sum(), abs=1e-9)
    assert np.abs(pieces).sum() == pytest.approx(np.abs(signed).sum(), rel=1e-9)
    assert below[..., 2].max() <= 0.3 + 1e-9
    assert above[..., 2].min() >= 0.3 - 1e-9
    np.testing.assert_allclose(border[..., 2], 0.3)


@pytest.mark.parametrize("scenery", ["street", "country", "motorway"])
def test_squares_are_covered_once_and_meet_without_gaps(scenery: str) -> None:
    plan = block()
    ground = Ground(roads_of(route_of(plan, 0.03 * plan[:, 0]), scenery), seed=1)
    surface = GroundSurface(ground, NUMBERS, seed=1)
    squares = {(i, 0): surface.square((i, 0), fine=i == 0) for i in (0, 1)}
    kerb_m = ground.roads.profile.kerb_m
    for (column, row), mesh in squares.items():
        corners = mesh.vertices[mesh.triangles].astype(np.float64)
        flat = (np.abs(mesh.normals[mesh.triangles[:, 0], 1]) > 0.5) & (mesh.materials != NUMBERS["marking"])
        a, b = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
        plan_area = np.abs(a[:, 0] * b[:, 2] - a[:, 2] * b[:, 0])[flat] / 2
        assert plan_area.sum() == pytest.approx(SQUARE_M**2, rel=1e-5)
        # every vertex lies on the ground, raised by the kerb or not
        points = mesh.vertices[:, [0, 2]] + np.array([column, row]) * SQUARE_M
        above = ground.level(points) - mesh.vertices[:, 1]
        # painted lines and the diagonals of coarse cells may differ by millimetres
        assert np.minimum(np.abs(above), np.abs(above - kerb_m)).max() < 0.012
    rims = []
    for (column, _), mesh in squares.items():
        on_rim = np.abs(mesh.vertices[:, 0] + (column - 1) * SQUARE_M) < 1e-4
        whole = np.abs(mesh.vertices[:, 2] / CELL_M - np.rint(mesh.vertices[:, 2] / CELL_M)) < 1e-5
        rims.append({(round(float(z)), round(float(y), 3)) for _, y, z in mesh.vertices[on_rim & whole]})
    assert rims[0] == rims[1]
    assert len(rims[0]) >= 17


def test_kerbs_face_the_roadway() -> None:
    ground = Ground(roads_of(route_of(straight(200))), seed=0)
    mesh = GroundSurface(ground, NUMBERS, seed=0).square((0, 1), fine=True)
    upright = np.flatnonzero(np.abs(mesh.normals[:, 1]) < 0.01)
    assert len(upright) > 100
    points = mesh.vertices[upright][:, [0, 2]] + [0.0, SQUARE_M]
    step = 0.2 * mesh.normals[upright][:, [0, 2]]
    edge = ground.roads.edge
    np.testing.assert_allclose(edge(points + step) - edge(points - step), -0.4, atol=0.02)


def test_far_land_leaves_out_what_is_drawn_and_reaches_the_horizon() -> None:
    ground = Ground(roads_of(route_of(straight(100))), seed=0)
    drawn = frozenset((i, j) for i in range(-1, 2) for j in range(-1, 2))
    land = far_land(ground, (0, 0), drawn, 0)
    middles = land.vertices[land.triangles].mean(axis=1)[:, [0, 2]]
    inside = ((middles > -SQUARE_M + 1) & (middles < 2 * SQUARE_M - 1)).all(axis=1)
    assert not inside.any()
    assert np.abs(land.vertices[:, [0, 2]]).max() > 1200


def test_routes_are_equal_by_their_numbers() -> None:
    a, b = route_of(straight(20)), route_of(straight(20))
    assert a == b
    assert hash(a) == hash(b)
    assert a.digest == b.digest
    assert a != route_of(straight(20) + np.array([0, 1e-9]))


def test_impossible_routes_are_refused() -> None:
    with pytest.raises(DataError, match="finite positions_m"):
        Route(np.array([[0.0, np.nan, 0.0]]), np.array([[0.0, 0.0, 1.0]]))
    with pytest.raises(DataError, match="at least one pose"):
        Route.of(RigidTransform.identity())
    down = RigidTransform.from_components([[0.0, 0.0, 0.0]], Rotation.from_euler("x", [-90], degrees=True))
    with pytest.raises(DataError, match="straight up or down"):
        drive_of(Route.of(down))
