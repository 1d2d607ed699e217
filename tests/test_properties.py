"""Properties of geometry, families and schedules, over what hypothesis makes up."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import RigidTransform

from flowlik.geometry.camera import Distortion, Pinhole
from flowlik.geometry.motion import (
    adjoint,
    essential_matrix,
    exp_se3,
    g,
    inverse_range,
    relative_motion,
    right_covariance,
)
from flowlik.geometry.trajectory import chain
from flowlik.likelihood.families import FAMILIES
from flowlik.likelihood.schedule import Index, Schedule, hat_weights
from tests.likelihood.families.test_families import THETA

small = st.floats(-0.6, 0.6)
tangents = st.tuples(small, small, small, *(st.floats(-3, 3),) * 3).map(np.array)
cameras = st.builds(
    lambda w, h, f, a: Pinhole(w, h, f, a * f, (w - 1) / 2, (h - 1) / 2),
    st.integers(2, 2000), st.integers(2, 2000), st.floats(5, 3000), st.floats(0.5, 2),
)  # fmt: skip
quickly = settings(max_examples=40, deadline=None)


@quickly
@given(cameras, st.floats(0, 1), st.floats(0, 1), st.floats(0.01, 1e4))
def test_a_pixel_and_its_ray_belong_together(camera, a, b, depth):
    pixel = np.array([[a * (camera.width - 1), b * (camera.height - 1)]])
    np.testing.assert_allclose(camera.v2p(depth * camera.rays(pixel)), pixel, atol=1e-7)
    assert np.linalg.norm(camera.p2v(pixel)) == pytest.approx(1)
    assert camera.contains(pixel).all()


@quickly
@given(st.floats(-0.25, 0.25), st.floats(0, 0.1), st.floats(-0.7, 0.7), st.floats(-0.7, 0.7))
def test_distortion_is_undone(k1, k2, x, y):
    lens, point = Distortion(k1, k2), np.array([[x, y]])
    np.testing.assert_allclose(lens.undistort(lens.distort(point)), point, atol=2e-4)


@quickly
@given(tangents, tangents)
def test_the_adjoint_moves_a_perturbation_to_the_other_side(xi, eta):
    T, little = exp_se3(xi), 1e-2 * eta
    left, right = T * exp_se3(little) * T.inv(), exp_se3(adjoint(T) @ little)
    np.testing.assert_allclose(left.as_matrix(), right.as_matrix(), atol=1e-9)
    covariance = right_covariance(T, np.outer(eta, eta) + np.eye(6))
    assert np.linalg.eigvalsh(covariance)[0] > 0


@quickly
@given(st.lists(tangents, min_size=1, max_size=4))
def test_chained_motions_are_taken_apart_again(tangents):
    motions = [exp_se3(xi) for xi in tangents]
    poses = chain(motions)
    for k, motion in enumerate(motions):
        again = relative_motion(poses[k], poses[k + 1])
        np.testing.assert_allclose(again.as_matrix(), motion.as_matrix(), atol=1e-9)


@quickly
@given(tangents, st.floats(0.5, 50), st.floats(0, 1), st.floats(0, 1))
def test_a_moved_point_lies_on_its_epipolar_line(xi, depth, a, b):
    camera = Pinhole(320, 240, 200.0, 210.0, 159.5, 119.5)
    T = exp_se3(np.concatenate([xi[:3] / 3, 0.1 * xi[3:] + [0.05, 0, 0]]))
    if np.linalg.norm(T.translation) < 1e-3:
        return
    pixel = np.array([[a * 319, b * 239]])
    end = g(T, camera, pixel, inverse_range(camera, pixel, np.array([depth])))
    if not np.isfinite(end).all():
        return
    unit = RigidTransform.from_components(T.translation / np.linalg.norm(T.translation), T.rotation)
    error = camera.rays(end)[0] @ essential_matrix(unit) @ camera.rays(pixel)[0]
    assert abs(error) < 1e-9 * max(1.0, np.abs(end).max()) ** 2


families = st.sampled_from(sorted(FAMILIES)).flatmap(
    lambda name: st.tuples(st.just(FAMILIES[name]), st.sampled_from([np.array(t) for t in THETA[name]]))
)


@quickly
@given(families, st.floats(-50, 50), st.floats(0.001, 0.999))
def test_a_family_is_symmetric_and_its_quantile_inverts_its_distribution(case, z, p):
    family, theta = case
    assert family.logpdf(z, theta) == pytest.approx(family.logpdf(-z, theta))
    assert family.cdf(z, theta) + family.cdf(-z, theta) == pytest.approx(1, abs=1e-9)
    assert family.cdf(family.ppf(p, theta), theta) == pytest.approx(p, abs=1e-6)
    assert family.cdf(z, theta) <= family.cdf(z + 0.1, theta) + 1e-12


knots = (
    st.lists(st.floats(-5, 10), min_size=2, max_size=9, unique=True)
    .map(sorted)
    .filter(lambda k: np.diff(k).min() > 1e-3)
)


@quickly
@given(knots, st.floats(-20, 30))
def test_a_schedule_lies_between_its_knots_and_is_constant_beyond(knots, x):
    weights = hat_weights(np.array(knots), np.array([x]))[:, 0]
    assert weights.sum() == pytest.approx(1)
    assert (weights >= 0).all()
    assert (weights > 0).sum() <= 2
    values = np.linspace(1, 2, len(knots))[None]
    schedule = Schedule(Index(), np.array(knots), values)
    (theta,) = schedule.theta(x)
    assert 1 <= theta <= 2
    assert theta == pytest.approx(np.interp(x, knots, values[0]))
