import cv2
import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

from flowlik.geometry import motion
from tests.helpers import CAMERA, finite_difference, make_scene, random_motion

SEEDS = range(5)
MOTIONS = [random_motion(np.random.default_rng(seed), 5.0, 0.5) for seed in SEEDS]


@pytest.fixture(params=MOTIONS, ids=[f"motion{seed}" for seed in SEEDS])
def scene(request):
    return make_scene(request.param, np.random.default_rng(1), n=60)


@pytest.fixture
def noisy(scene):
    """Pixels, and flow that is off its epipolar lines by some pixels."""
    m = scene.measurements
    return m.pixels, m.flow + np.random.default_rng(2).normal(0, 3, m.flow.shape)


def rho_of(scene):
    return motion.inverse_range(CAMERA, scene.measurements.pixels, scene.depth)


def test_h_is_reprojection_by_opencv(scene):
    pixels = scene.measurements.pixels
    points = scene.depth[:, None] * CAMERA.rays(pixels)
    rotation, translation = scene.T.rotation.as_rotvec(), scene.T.translation
    ends, _ = cv2.projectPoints(points, rotation, translation, CAMERA.K, None)
    np.testing.assert_allclose(
        motion.h(scene.T, CAMERA, pixels, rho_of(scene)), ends[:, 0] - pixels, atol=1e-9
    )


def test_points_that_end_behind_the_camera_have_no_flow():
    backwards = RigidTransform.from_translation([0, 0, -3.0])
    flow = motion.h(backwards, CAMERA, np.array([[CAMERA.cx, CAMERA.cy]] * 2), np.array([1 / 2, 1 / 4]))
    assert np.isnan(flow[0]).all()
    np.testing.assert_allclose(flow[1], 0, atol=1e-12)


def test_jacobian_of_h_is_its_derivative_by_a_left_perturbation(scene):
    pixels, rho = scene.measurements.pixels, rho_of(scene)
    numeric = finite_difference(
        lambda xi: motion.h(motion.exp_se3(xi) * scene.T, CAMERA, pixels, rho), np.zeros(6), 1e-6
    )
    np.testing.assert_allclose(motion.h_jacobian(scene.T, CAMERA, pixels, rho), numeric, rtol=1e-6, atol=1e-6)


def test_epipolar_distance_agrees_with_opencv(scene, noisy):
    pixels, flow = noisy
    K_inverse = np.linalg.inv(CAMERA.K)
    F = K_inverse.T @ motion.essential_matrix(scene.T) @ K_inverse
    lines = cv2.computeCorrespondEpilines(pixels[:, None], 1, F)[:, 0]
    z, normal, _ = motion.epipolar_error(scene.T, CAMERA, pixels, flow)
    signed = np.einsum("ij,ij->i", lines[:, :2], pixels + flow) + lines[:, 2]
    side = np.sign(np.einsum("ij,ij->i", lines[:, :2], normal))
    np.testing.assert_allclose(normal, side[:, None] * lines[:, :2], atol=1e-6)
    np.testing.assert_allclose(z, side * signed, atol=1e-3)  # OpenCV's lines are float32


def test_exact_flow_lies_on_its_epipolar_lines(scene):
    m = scene.measurements
    z, _, _ = motion.epipolar_error(scene.T, CAMERA, m.pixels, m.flow)
    np.testing.assert_allclose(z, 0, atol=1e-9)


def test_a_step_along_the_normal_is_a_step_of_the_epipolar_error(scene, noisy):
    pixels, flow = noisy
    z, normal, _ = motion.epipolar_error(scene.T, CAMERA, pixels, flow)
    moved, _, _ = motion.epipolar_error(scene.T, CAMERA, pixels, flow + 2.5 * normal)
    np.testing.assert_allclose(moved - z, 2.5, atol=1e-9)


def test_jacobian_of_the_epipolar_error_is_its_derivative(scene, noisy):
    unit = RigidTransform.from_components(
        scene.T.translation / np.linalg.norm(scene.T.translation), scene.T.rotation
    )
    z, _, jacobian = motion.epipolar_error(unit, CAMERA, *noisy)
    numeric = finite_difference(
        lambda xi: motion.epipolar_error(motion.exp_se3(xi) * unit, CAMERA, *noisy)[0], np.zeros(6), 1e-6
    )
    np.testing.assert_allclose(jacobian, numeric, rtol=1e-5, atol=1e-3)
    # the length of the translation does not matter
    np.testing.assert_allclose(z, motion.epipolar_error(scene.T, CAMERA, *noisy)[0], atol=1e-9)
    np.testing.assert_allclose(jacobian[:, 3:] @ unit.translation, 0, atol=1e-9)


@pytest.mark.parametrize("T", MOTIONS)
def test_decomposition_of_an_essential_matrix_agrees_with_opencv(T):
    E = motion.essential_matrix(T)
    first, second, t = cv2.decomposeEssentialMat(E)
    expected = {(i, s): np.column_stack([R, s * t]) for i, R in enumerate((first, second)) for s in (1, -1)}
    ours = [T.as_matrix()[:3] for T in motion.decompose_essential(E)]
    matched = {key for key, M in expected.items() for T in ours if np.allclose(T, M, atol=1e-9)}
    assert len(ours) == 4
    assert matched == expected.keys()
    truth = np.column_stack([T.rotation.as_matrix(), T.translation / np.linalg.norm(T.translation)])
    assert any(np.allclose(M, truth, atol=1e-9) for M in ours)


@pytest.mark.parametrize("T", MOTIONS)
def test_in_front_is_positive_depth_in_both_cameras(T):
    rng = np.random.default_rng(3)
    points = rng.uniform([-4, -3, -4], [4, 3, 4], (500, 3))
    moved = T.apply(points)
    first, second = ((p / p[:, 2:]) @ CAMERA.K.T for p in (points, moved))
    expected = (points[:, 2] > 0) & (moved[:, 2] > 0)
    assert 0 < expected.sum() < len(expected)
    found = motion.in_front(T, CAMERA, first[:, :2], (second - first)[:, :2])
    np.testing.assert_array_equal(found, expected)


@pytest.mark.parametrize("T", MOTIONS)
def test_the_adjoint_moves_a_perturbation_to_the_other_side(T):
    xi = np.random.default_rng(4).normal(0, 0.3, 6)
    left = T * motion.exp_se3(xi) * T.inv()
    np.testing.assert_allclose(
        left.as_matrix(), motion.exp_se3(motion.adjoint(T) @ xi).as_matrix(), atol=1e-12
    )


def test_the_tangent_is_rotation_first():
    T = motion.exp_se3(np.array([0, 0, np.pi / 2, 0, 0, 0]))
    np.testing.assert_allclose(T.apply([1.0, 0, 0]), [0, 1, 0], atol=1e-15)
    np.testing.assert_allclose(motion.exp_se3(np.array([0, 0, 0, 1, 2, 3.0])).translation, [1, 2, 3])


def test_relative_motion_takes_points_of_one_camera_to_the_other():
    T_n_prev, T_n_k = MOTIONS[:2]
    point_n = np.array([1.0, -2, 8])
    moved = motion.relative_motion(T_n_prev, T_n_k).apply(T_n_prev.inv().apply(point_n))
    np.testing.assert_allclose(moved, T_n_k.inv().apply(point_n), atol=1e-12)


def test_inverse_range_is_along_the_ray():
    pixels = np.array([[CAMERA.cx, CAMERA.cy], [CAMERA.cx + CAMERA.fx, CAMERA.cy]])
    rho = motion.inverse_range(CAMERA, pixels, np.array([2.0, 2.0]))
    np.testing.assert_allclose(rho, [1 / 2, 1 / (2 * np.sqrt(2))])
    assert motion.inverse_range(CAMERA, pixels, np.array([np.inf, 0.0])).tolist() == [0, np.inf]


def test_skew_is_the_cross_product():
    a, b = np.random.default_rng(5).standard_normal((2, 7, 3))
    np.testing.assert_allclose(np.einsum("nij,nj->ni", motion.skew(a), b), np.cross(a, b), atol=1e-15)
