"""The rasteriser's depth against ray casters that share no code with it."""

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from flowlik.geometry.camera import Pinhole
from flowlik.simulation.render import Daylight, Instances, Material, Mesh, Prototype, Scene, Surface, placed
from tests.simulation.render.embree import agreement, cast
from tests.simulation.render.raster.small_scene import make_scene

CAMERA = Pinhole.from_fov(160, 90, 120.0)

POSES = [
    RigidTransform.from_components([0, 0, 0], Rotation.identity()),
    RigidTransform.from_components([1.0, 0.5, 12], Rotation.from_euler("YXZ", [0.7, -0.2, 0.3])),
    RigidTransform.from_components([-2.0, 1.0, 30], Rotation.from_euler("YXZ", [-2.0, 0.3, -0.1])),
]


def nearest_of(triangles: np.ndarray, rays: np.ndarray) -> np.ndarray:
    """Depth (N,) of the first triangle (F, 3, 3) in {c} that each ray (N, 3) of z = 1 meets."""
    depth = np.full(len(rays), np.inf)
    for a, b, c in triangles:
        # ray * depth = r a + s b + t c with r + s + t = 1
        inverse = np.linalg.inv(np.column_stack([a, b, c]))
        weights = rays @ inverse.T
        met = (weights >= 0).all(axis=1)
        depth[met] = np.minimum(depth[met], 1 / weights[met].sum(axis=1))
    return depth


def test_a_handful_of_triangles_in_numpy():
    rng = np.random.default_rng(3)
    middles = np.column_stack([rng.uniform(-8, 8, 25), rng.uniform(-4, 4, 25), rng.uniform(2, 20, 25)])
    corners = (middles[:, None] + rng.uniform(-3, 3, (25, 3, 3))).astype(np.float32)
    corners[..., 2] = np.maximum(corners[..., 2], 0.5)  # in front, so that no near plane is needed
    flat = corners.reshape(-1, 3)
    mesh = Mesh.of(
        flat, np.tile([0, -1, 0], (75, 1)), np.zeros((75, 2)), np.arange(75, dtype=np.int32).reshape(25, 3), 0
    )
    instances = Instances.of([(0, placed(np.zeros(3)))])
    scene = Scene.of([Prototype(mesh)], instances, [Material((Surface(0.3),))], Daylight(), 0)
    depth = scene.render(RigidTransform.identity(), CAMERA, samples=0).depth.ravel()
    expected = nearest_of(corners.astype(np.float64), CAMERA.rays(CAMERA.pixel_grid()))
    hit = np.isfinite(expected)
    assert 0.1 < hit.mean() < 0.95
    # a centre on the very border of a triangle may be given to either side
    assert agreement(depth, expected, 1e-9) > 0.9995


@pytest.mark.parametrize("pose", POSES)
def test_small_scene_is_what_embree_sees(pose: RigidTransform) -> None:
    pytest.importorskip("embreex", reason="the embreex wheel (extra `test`) is not installed")
    scene = make_scene()
    depth = scene.render(pose, CAMERA, samples=0).depth
    expected = cast(scene.drawn_triangles(pose, CAMERA), pose, CAMERA)
    assert 0.2 < np.isfinite(expected).mean() < 1
    assert agreement(depth, expected) >= 0.995


def test_agreement_counts_what_only_one_of_them_hits() -> None:
    depth = np.array([1.0, 2.0, np.inf, np.inf, 5.0])
    expected = np.array([1.00005, 2.1, np.inf, 4.0, np.inf])
    assert agreement(depth, expected) == pytest.approx(2 / 5)
