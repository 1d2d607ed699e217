"""A rotation that explains the flow alone is kept, and nothing is said of the translation."""

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from flowlik.egomotion import Epipolar, KnownDepth, Status, lcmsac, mle
from flowlik.egomotion._parallax import Parallax, share_in_front
from flowlik.egomotion.observability import IN_FRONT_SHARE
from flowlik.measurement.measurements import Measurements
from tests.helpers import CAMERA, make_scene, random_motion

from .test_estimator import MODEL


def turned(degrees):
    return RigidTransform.from_rotation(Rotation.from_rotvec(degrees, degrees=True))


@pytest.mark.parametrize("make", [lcmsac, mle])
@pytest.mark.parametrize("degrees", [(0, 0.3, 0), (0, 3, 0), (0, 0, 2), (0.5, -1, 0.3)])
def test_a_pure_rotation_is_kept_and_consistent(make, degrees):
    T, nees = turned(degrees), []
    for seed in range(12):
        scene = make_scene(T, np.random.default_rng(seed), 400, MODEL, outliers=0.1)
        result = make(MODEL).estimate(scene.epipolar, seed=seed)
        assert result.status is Status.DEGENERATE
        assert "rotation" in result.reason
        assert result.rotation_alone
        assert not result.scale_known
        np.testing.assert_array_equal(result.T_k_prev.translation, 0)
        assert np.isnan(result.covariance[3:]).all()
        error = (T.rotation * result.T_k_prev.rotation.inv()).as_rotvec()
        nees.append(error @ np.linalg.solve(result.covariance[:3, :3], error))
    # 12 draws of a chi-squared of 3 freedoms: mean 3 within four standard errors
    assert np.mean(nees) < 3 + 4 * np.sqrt(6 / 12)


def test_few_near_points_before_far_ones_are_parallax():
    T = RigidTransform.from_components([-0.3, 0.05, -0.4], Rotation.from_rotvec([0.1, 0.8, 0], degrees=True))
    far = np.where(np.random.default_rng(5).random(600) < 0.75, 1e4, 4.0)
    scene = make_scene(T, np.random.default_rng(6), 600, MODEL, depth_of=lambda rays: far)
    result = lcmsac(MODEL).estimate(scene.epipolar)
    assert result.status is Status.SOLVED
    d, t = result.T_k_prev.translation, T.translation / np.linalg.norm(T.translation)
    assert np.degrees(np.arccos(d @ t)) < 3


def test_parallax_gives_the_inverse_depth_of_exact_flow():
    scene = make_scene(random_motion(np.random.default_rng(2), 2.0, 0.4), np.random.default_rng(3))
    length = np.linalg.norm(scene.T.translation)
    T = np.column_stack([scene.T.rotation.as_matrix(), scene.T.translation / length])
    parallax = Parallax.of(scene.measurements, CAMERA, T)
    np.testing.assert_allclose(parallax.inverse_depth, length / scene.depth, rtol=1e-8)
    far = CAMERA.v2p(scene.T.rotation.apply(CAMERA.rays(scene.measurements.pixels)))
    along = np.einsum("ij,ij->i", scene.measurements.pixels + scene.measurements.flow - far, parallax.line)
    np.testing.assert_allclose(parallax.along, along, atol=1e-9)
    assert (parallax.along > 0).all()


def test_all_parallax_of_a_motion_is_in_front_and_half_of_a_rotation():
    rng = np.random.default_rng(4)
    estimator = lcmsac(MODEL)
    for T, low, high in ((random_motion(rng, 1.0, 0.4), IN_FRONT_SHARE, 1.0), (turned((0, 1, 0)), 0.0, 0.5)):
        problem = estimator.problem(make_scene(T, rng, 600, MODEL).epipolar)
        t = T.translation if np.any(T.translation) else np.array([0.6, 0.0, 0.8])
        M = np.column_stack([T.rotation.as_matrix(), t / np.linalg.norm(t)])
        assert low <= share_in_front(problem, M, problem.components) <= high


@pytest.mark.parametrize("kind", ["known_depth", "epipolar"])
def test_one_image_twice_tells_nothing(kind):
    scene = make_scene(turned((0, 0, 0)), np.random.default_rng(0))
    result = lcmsac(MODEL).estimate(getattr(scene, kind))
    assert (result.status, result.solved) == (Status.DEGENERATE, False)
    assert "same" in result.reason


@pytest.mark.parametrize("kind", ["known_depth", "epipolar"])
def test_flow_that_hardly_knows_anything_is_not_solved(kind):
    scene = make_scene(random_motion(np.random.default_rng(1)), np.random.default_rng(2), 400, MODEL)
    m = scene.measurements
    # so little texture that errors of many pixels are expected everywhere
    t = np.full_like(m.t, 1e-2)
    flat = Measurements(m.pixels, m.flow, m.R_i_e, t, m.texture, m.method)
    residual = (
        KnownDepth.of(flat, CAMERA, scene.depth) if kind == "known_depth" else Epipolar.of(flat, CAMERA)
    )
    assert MODEL.bound(np.log(1e-2), 0.9) > 2
    result = lcmsac(MODEL).estimate(residual)
    assert result.status is Status.DEGENERATE
    assert "hardly" in result.reason
