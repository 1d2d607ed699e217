"""A plane has two motions: both are found, points off the plane and the motion before decide."""

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from flowlik.egomotion import Status, lcmsac
from flowlik.egomotion._plane import better_of_two
from flowlik.egomotion.observability import determines
from flowlik.egomotion.problem import Explanation
from tests.helpers import make_scene

from .test_estimator import MODEL

# forward past an oblique wall, so that all of it is in front of both motions
SLIDE = [-0.06, 0.02, -0.3]


def plane(normal, distance_m, off=0.0, seed=0):
    """Depths of rays on a plane, a share of them instead on one half as far."""

    def depth(rays):
        z = distance_m / (rays @ (np.asarray(normal) / np.linalg.norm(normal)))
        nearer = np.random.default_rng(seed).random(len(rays)) < off
        return np.where(nearer, 0.5 * z, z)

    return depth


def moved(translation, degrees=(0.0, 0.0, 0.0)):
    return RigidTransform.from_components(translation, Rotation.from_euler("xyz", degrees, degrees=True))


def angle_deg(a, b):
    return np.degrees(np.arccos(np.clip(a @ b / np.linalg.norm(a) / np.linalg.norm(b), -1, 1)))


def wall(T, normal=(0.5, 0.1, 0.85), off=0.0, seed=0, n=600):
    rng = np.random.default_rng(seed)
    return make_scene(T, rng, n, MODEL, depth_of=plane(normal, 5.0, off, seed))


@pytest.mark.parametrize("seed", range(4))
def test_the_true_motion_is_one_of_two_that_a_wall_leaves_open(seed):
    T = moved(SLIDE, (0.2, -0.5, 0.1))
    result = lcmsac(MODEL).estimate(wall(T, seed=seed).epipolar, seed=seed)
    assert result.status is Status.AMBIGUOUS
    assert "plane" in result.reason
    both = [result, result.alternative]
    errors = [angle_deg(m.T_k_prev.translation, T.translation) for m in both]
    assert min(errors) < 2
    assert max(errors) > 10
    for m in both:
        assert np.isfinite(m.covariance).all()
        assert np.isclose(np.linalg.norm(m.T_k_prev.translation), 1)
    assert result.alternative.alternative is None


def test_both_motions_of_exact_flow_explain_it():
    T = moved(SLIDE, (0.2, -0.5, 0.1))
    rng = np.random.default_rng(3)
    scene = make_scene(T, rng, 400, depth_of=plane((0.5, 0.1, 0.85), 5.0))
    problem = lcmsac(MODEL).problem(scene.epipolar)
    true = np.hstack([T.rotation.as_matrix(), T.translation[:, None] / np.linalg.norm(T.translation)])
    best, twin = better_of_two(problem, Explanation(problem.at(true), 0.0))
    assert best.view.errors.T is true
    assert np.abs(twin.other.view.errors.z).max() < 1e-2
    assert twin.worse < 5.0
    assert angle_deg(twin.other.view.errors.T[:, 3], T.translation) > 10


@pytest.mark.parametrize("seed", range(3))
def test_points_off_the_plane_decide(seed):
    T = moved(SLIDE, (0.2, -0.5, 0.1))
    result = lcmsac(MODEL).estimate(wall(T, off=0.25, seed=seed).epipolar, seed=seed)
    assert result.status is Status.SOLVED
    assert angle_deg(result.T_k_prev.translation, T.translation) < 2


@pytest.mark.parametrize("seed", range(4))
def test_a_plane_approached_head_on_has_one_motion_of_a_wide_direction(seed):
    T = moved([0.0, 0.0, -0.25])
    result = lcmsac(MODEL).estimate(wall(T, (0.0, 0.0, 1.0), seed=seed).epipolar, seed=seed)
    assert result.status in (Status.SOLVED, Status.AMBIGUOUS)
    basis = np.linalg.svd(result.T_k_prev.translation[None])[2][1:].T
    e = basis.T @ -np.array([0.0, 0.0, 1.0])
    C = basis.T @ result.covariance[3:, 3:] @ basis
    assert e @ np.linalg.solve(C, e) < 4 * 13.8


def test_many_depths_are_no_plane():
    T = moved(SLIDE)
    result = lcmsac(MODEL).estimate(make_scene(T, np.random.default_rng(1), 600, MODEL).epipolar)
    assert (result.status, result.alternative) == (Status.SOLVED, None)
    assert determines(result.information, np.linalg.svd(result.information)[0][:, :5])
