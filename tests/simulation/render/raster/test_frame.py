import hashlib

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from flowlik.geometry.camera import Pinhole
from flowlik.simulation.render import (
    Daylight,
    Instances,
    Material,
    Mesh,
    Prototype,
    Scene,
    Surface,
    placed,
    quad,
)
from flowlik.simulation.render._raster.frame import triangles_of
from flowlik.support import threads
from tests.simulation.render.raster.small_scene import CAMERA, make_scene

POSES = [
    RigidTransform.from_components([0, 0, 0], Rotation.identity()),
    RigidTransform.from_components([1.0, 0.5, 12], Rotation.from_euler("YXZ", [0.7, -0.2, 0.3])),
    RigidTransform.from_components([-2.0, 1.0, 30], Rotation.from_euler("YXZ", [-2.0, 0.3, -0.1])),
]


@pytest.fixture(scope="module")
def scene() -> Scene:
    return make_scene()


def cast_rays(triangles: np.ndarray, T_n_c: RigidTransform, camera: Pinhole) -> np.ndarray:
    """Depth (H, W) by testing every ray against every triangle (Moeller and Trumbore), plainly."""
    rays = camera.rays(camera.pixel_grid()) @ T_n_c.rotation.as_matrix().T
    a = triangles[:, 0] - T_n_c.translation
    e1, e2 = triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
    best = np.full(len(rays), np.inf)
    with np.errstate(divide="ignore", invalid="ignore"):
        for some in np.array_split(np.arange(len(rays)), 64):
            d = rays[some, None]
            p = np.cross(d, e2)
            det = (p * e1).sum(-1)
            s = -(p * a).sum(-1) / det
            q = np.cross(-a, e1)
            t = (d * q).sum(-1) / det
            depth = (e2 * q).sum(-1) / det
            hit = (s >= 0) & (t >= 0) & (s + t <= 1) & (depth > 0)
            best[some] = np.where(hit, depth, np.inf).min(axis=1)
    return best.reshape(camera.height, camera.width)


@pytest.mark.parametrize("pose", POSES)
def test_depth_is_that_of_a_plain_ray_caster(scene, pose):
    depth = scene.render(pose, CAMERA, samples=0).depth
    expected = cast_rays(scene.drawn_triangles(pose, CAMERA), pose, CAMERA)
    with np.errstate(invalid="ignore"):
        agree = np.isclose(depth, expected, rtol=1e-9) | (np.isinf(depth) & np.isinf(expected))
    assert 0.2 < np.isfinite(expected).mean() < 1
    assert agree.mean() > 0.999


def test_depth_of_a_plane_is_exact():
    ground = quad([(-500, 2, 500), (500, 2, 500), (500, 2, -500), (-500, 2, -500)], 0)
    plane = Scene.of(
        [Prototype(ground)],
        Instances.of([(0, placed(np.zeros(3)))]),
        [Material((Surface(0.3),))],
        Daylight(),
        0,
    )
    pose = RigidTransform.from_components([3.0, 0.3, -20], Rotation.from_euler("YXZ", [0.3, -0.25, 0.1]))
    depth = plane.render(pose, CAMERA, samples=0).depth
    rays = (CAMERA.rays(CAMERA.pixel_grid()) @ pose.rotation.as_matrix().T).reshape(*depth.shape, 3)
    expected = 1.7 / rays[..., 1]
    near = (expected > 0) & (expected < 100)
    assert near.sum() > 1000
    np.testing.assert_allclose(depth[near], expected[near], rtol=1e-9)
    assert np.isinf(depth[rays[..., 1] < 0]).all()


def test_picture_does_not_depend_on_threads_nor_on_what_was_rendered_before(scene, monkeypatch):
    first = [scene.render(pose, CAMERA) for pose in POSES]
    monkeypatch.setattr(threads, "THREADS", 1)
    for frame, pose in zip(reversed(first), reversed(POSES)):
        again = make_scene().render(pose, CAMERA)
        assert again.radiance.tobytes() == frame.radiance.tobytes()
        assert again.depth.tobytes() == frame.depth.tobytes()


def test_picture_of_a_small_scene_keeps_its_bytes(scene):
    frame = scene.render(POSES[1], CAMERA)
    digest = hashlib.sha256(frame.radiance.tobytes() + frame.depth.tobytes()).hexdigest()
    assert digest[:16] == "6f75cc0a2363aa10"


def test_copies_look_the_same_whatever_else_is_in_the_list(scene):
    places = scene.instances
    order = np.random.default_rng(1).permutation(len(places))
    shuffled = Scene(
        scene.shapes,
        scene.looks,
        Instances(places.prototypes[order], places.transforms[order]),
        scene.identities[order],
        scene.spheres[order],
        scene.movers,
        scene.light,
        scene.shadows,
    )
    np.testing.assert_allclose(
        shuffled.render(POSES[0], CAMERA).radiance, scene.render(POSES[0], CAMERA).radiance, atol=1e-6
    )


def test_radiance_is_the_mean_over_the_pixel():
    # a white wall over the left of the picture, its edge at a known place within a column of pixels
    wall = quad([(-50, -50, 10), (0.2, -50, 10), (0.2, 50, 10), (-50, 50, 10)], 0)
    light = Daylight(haze_per_m=0.0, clouds=0.0)
    bright = Scene.of(
        [Prototype(wall)], Instances.of([(0, placed(np.zeros(3)))]), [Material((Surface(0.9),))], light, 0
    )
    camera = Pinhole(21, 11, 25.0, 25.0, 10.0, 5.0)
    radiance = bright.render(RigidTransform.identity(), camera).radiance
    inside, outside, edge = radiance[5, 5], radiance[5, 16], radiance[5, 10]
    share = (edge - outside) / (inside - outside)
    # 0.2 m at 10 m is half a pixel right of the centre of column 10: all of it is covered
    np.testing.assert_allclose(share, 1.0, atol=0.05)
    moved = RigidTransform.from_translation([0.1, 0, 0])
    edge = bright.render(moved, camera).radiance[5, 10]
    np.testing.assert_allclose((edge - outside) / (inside - outside), 0.75, atol=1 / 16)


def test_sun_and_shadow():
    # a roof above one half of the floor, the sun overhead
    floor = quad([(-9, 2, 29), (9, 2, 29), (9, 2, 1), (-9, 2, 1)], 0)
    roof = quad([(-9, -4, 29), (0, -4, 29), (0, -4, 1), (-9, -4, 1)], 0)
    mesh = Mesh.joined([floor, roof])
    light = Daylight(elevation_deg=90.0, haze_per_m=0.0, sun=1.0, sky=0.5)
    scene = Scene.of(
        [Prototype(mesh)],
        Instances.of([(0, placed(np.zeros(3)))]),
        [Material((Surface(0.4),))],
        light,
        0,
        shadow_area=(0, 15, 20),
    )
    down = RigidTransform.from_components([0, 0, 10], Rotation.from_euler("X", -90, degrees=True))
    radiance = scene.render(down, Pinhole(41, 41, 20.0, 20.0, 20.0, 20.0)).radiance
    np.testing.assert_allclose(radiance[:, 5], 0.4 * 0.5, rtol=1e-5)
    np.testing.assert_allclose(radiance[:, 35], 0.4 * 1.5, rtol=1e-5)


def test_moving_object_is_drawn_where_it_is_and_named():
    scene = make_scene(movers=(2,))
    at = placed(np.array([0.0, 0.5, 6.0]))[None]
    frame = scene.render(POSES[0], CAMERA, mover_transforms=at)
    without = scene.render(POSES[0], CAMERA)
    assert without.movers is None
    moving = frame.movers == 0
    assert 100 < moving.sum() < moving.size / 4
    np.testing.assert_allclose(frame.depth[moving].min(), 5.0, rtol=1e-6)
    np.testing.assert_array_equal(frame.depth[~moving], without.depth[~moving])


def test_clearance_is_the_distance_to_the_nearest_triangle(scene):
    rng = np.random.default_rng(0)
    points = np.column_stack([rng.uniform(-20, 20, 30), rng.uniform(-4, 1.5, 30), rng.uniform(0, 60, 30)])
    clearance = scene.clearance(points)
    triangles = everything(scene)
    weights = rng.dirichlet([0.5, 0.5, 0.5], 60).T
    samples = np.einsum("fik,ij->fjk", triangles, weights).reshape(-1, 3)
    nearest = np.array([np.linalg.norm(samples - p, axis=1).min() for p in points])
    # samples on the triangles are a little farther than the nearest point; leaves count as balls
    assert (clearance <= np.minimum(nearest, 10) + 1e-9).all()
    assert (clearance >= np.minimum(nearest, 10) - 0.8).all()


def everything(scene: Scene) -> np.ndarray:
    """All triangles of the scene, every leaf in its shape."""
    leaves = np.diff(scene.shapes.leaf_starts)[scene.instances.prototypes]
    from_within = scene.drawn(POSES[0], CAMERA)
    return triangles_of(
        scene.shapes,
        from_within._replace(
            prototypes=scene.instances.prototypes,
            transforms=scene.instances.transforms,
            parts=np.diff(scene.shapes.triangle_starts)[scene.instances.prototypes],
            fine=leaves,
            leaves=leaves,
            leaf_scale=np.ones(len(leaves)),
        ),
    )
