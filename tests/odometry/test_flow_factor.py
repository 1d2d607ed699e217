"""A motion as a filter's measurement: derivatives by finite differences, covariances by drawn errors."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from flowlik.egomotion import EgoMotion, Status
from flowlik.egomotion.result import unsolved
from flowlik.errors import DataError, ModelError
from flowlik.geometry.motion import exp_se3
from flowlik.likelihood.model_file import load_likelihood
from flowlik.likelihood.over_time import OverTime, Persistence
from flowlik.likelihood.shared_errors import SharedErrors
from flowlik.odometry import flow_factor

INTERVAL_S = 1 / 60
NOTHING_STAYS = OverTime(Persistence(0.0, 1.0), Persistence(0.0, 1.0))


@pytest.fixture(scope="module")
def model():
    return replace(load_likelihood("lucas-kanade"), shared_errors=SharedErrors(over_time=NOTHING_STAYS))


@pytest.fixture(scope="module")
def motion():
    rng = np.random.default_rng(3)
    root = np.array([1e-3, 2e-3, 1e-3, 0.02, 0.01, 0.03])[:, None] * (
        np.eye(6) + 0.4 * rng.standard_normal((6, 6))
    )
    T = exp_se3(np.array([0.05, -0.1, 0.02, 0.3, -0.2, 1.0]))
    return EgoMotion(T, np.eye(6), root @ root.T, Status.SOLVED)


def true_motions(motion, count=20_000):
    """Motions that the measured one may stand for."""
    errors = np.random.default_rng(0).standard_normal((count, 6)) @ np.linalg.cholesky(motion.covariance).T
    return exp_se3(errors) * motion.T_k_prev


def test_the_translation_given_the_true_rotation_is_as_far_off_as_it_says(model, motion):
    factor = flow_factor(motion, model, INTERVAL_S)
    left = np.array([factor.residual(T) for T in true_motions(motion, 1500)])
    whitened = np.linalg.solve(np.linalg.cholesky(factor.covariance), left.T)
    np.testing.assert_allclose(whitened @ whitened.T / left.shape[0], np.eye(3), atol=0.15)
    # the rotation tells most of it
    assert np.trace(factor.covariance) < np.trace(motion.covariance[3:, 3:])


def test_its_derivative_is_that_of_the_likeliest_translation(model, motion):
    factor, step = flow_factor(motion, model, INTERVAL_S), 1e-5
    A = np.linalg.inv(motion.covariance)
    for j in range(3):
        w = step * np.eye(3)[j]
        # the translation part of the tangent that is likeliest at this rotation
        v = -np.linalg.solve(A[3:, 3:], A[3:, :3] @ w)
        T = exp_se3(np.concatenate([w, v])) * motion.T_k_prev
        np.testing.assert_allclose(factor.translation(T.rotation), T.translation, atol=1e-8)


def test_the_full_form_measures_the_motion(model, motion):
    factor = flow_factor(motion, model, INTERVAL_S, "full")
    np.testing.assert_allclose(factor.covariance, motion.covariance)
    xi = np.array([1e-3, 2e-3, -1e-3, 0.01, 0.02, 0.03])
    np.testing.assert_allclose(factor.residual(exp_se3(xi) * motion.T_k_prev), xi, atol=1e-12)


def test_what_stays_widens_both(model, motion):
    stays = OverTime(Persistence(0.8, 1.0), Persistence(0.3, 0.5))
    sure = {form: flow_factor(motion, model, INTERVAL_S, form) for form in ("full", "given-rotation")}
    model = replace(model, shared_errors=SharedErrors(over_time=stays))
    for form, persistence in (("full", stays.full), ("given-rotation", stays.given_rotation)):
        wide = flow_factor(motion, model, INTERVAL_S, form).covariance
        expected = persistence.filter_factor(INTERVAL_S) * sure[form].covariance
        np.testing.assert_allclose(wide, expected)


def test_a_frame_that_tells_nothing_is_no_factor(model, motion):
    assert flow_factor(unsolved(Status.TOO_FEW, "black"), model, INTERVAL_S) is None
    assert flow_factor(replace(motion, predicted=True), model, INTERVAL_S) is None
    assert flow_factor(replace(motion, alternative=motion), model, INTERVAL_S) is None


def test_what_cannot_be_a_factor_is_said(model, motion):
    unknown = replace(model, shared_errors=SharedErrors())
    with pytest.raises(ModelError, match="does not know how errors stay"):
        flow_factor(motion, unknown, INTERVAL_S)
    with pytest.raises(DataError, match="in metres"):
        flow_factor(replace(motion, scale_known=False), model, INTERVAL_S)
    with pytest.raises(DataError, match="a time between frames"):
        flow_factor(motion, model, 0.0)
    with pytest.raises(DataError, match="unknown form 'both'"):
        flow_factor(motion, model, INTERVAL_S, "both")


def test_a_turn_that_is_given_turns_the_translation(model):
    """Without cross-covariance the translation is carried by the rotation alone."""
    T = RigidTransform.from_translation([0.0, 0.0, 1.0])
    factor = flow_factor(EgoMotion(T, np.eye(6), 1e-4 * np.eye(6), Status.SOLVED), model, INTERVAL_S)
    turn = Rotation.from_rotvec([0.0, 1e-4, 0.0])
    np.testing.assert_allclose(factor.translation(turn), turn.apply([0.0, 0.0, 1.0]), atol=1e-8)
