from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

from flowlik.egomotion import EgoMotion, Status
from flowlik.geometry.motion import exp_se3, scaled
from flowlik.odometry._lengths import LengthModel, rescaled, with_length
from flowlik.odometry.scale import Length

UNIT = scaled(exp_se3(np.array([0.002, 0.01, -0.001, 0.03, 0.01, -0.9])), 1.0)
A = np.random.default_rng(0).standard_normal((6, 5)) * 1e-3
A[3:] -= np.outer(UNIT.translation, UNIT.translation @ A[3:])  # none along the translation
MOTION = EgoMotion(UNIT, np.eye(6), A @ A.T, Status.SOLVED, scale_known=False)


def after(lengths, sigma=0.02):
    model = LengthModel()
    for metres in lengths:
        _, model = with_length(MOTION, Length(metres, sigma), model, "a source")
    return model


def test_a_length_told_is_the_motions():
    motion, model = with_length(MOTION, Length(0.9, 0.02), LengthModel(), "a source")
    assert (motion.scale_known, motion.length_predicted, motion.reason) == (True, False, "")
    np.testing.assert_allclose(motion.T_k_prev.translation, 0.9 * UNIT.translation)
    assert model.predict()[0] == pytest.approx(0.9)


def test_the_lengths_error_enters_the_covariance_with_that_of_the_motion():
    """Drawn anew: motions and the lengths that depend on them."""
    rng, by_motion, sigma = np.random.default_rng(1), np.array([5.0, -9.0, 2.0, 0, 0, 0]), 0.02
    motion = rescaled(MOTION, Length(0.9, sigma, by_motion))
    xi = rng.standard_normal((4000, 5)) @ A.T
    metres = 0.9 * (1 + xi @ by_motion) + sigma * rng.standard_normal(4000)
    moved = RigidTransform.from_exp_coords(xi) * UNIT
    t = moved.translation / np.linalg.norm(moved.translation, axis=1, keepdims=True)
    drawn = RigidTransform.from_components(metres[:, None] * t, moved.rotation)
    errors = (drawn * motion.T_k_prev.inv()).as_exp_coords()
    root = np.sqrt(np.diag(motion.covariance))
    found, stated = (C / np.outer(root, root) for C in (np.cov(errors.T), motion.covariance))
    np.testing.assert_allclose(found, stated, atol=0.08)
    t = UNIT.translation
    along = t @ motion.covariance[3:, 3:] @ t
    assert np.sqrt(along) == pytest.approx(Length(0.9, sigma, by_motion).sigma_with(MOTION.covariance))
    assert np.sqrt(along) > sigma


def test_an_exact_length_scales_the_covariance():
    factor = np.repeat([1.0, 2.0], 3)
    motion = rescaled(MOTION, Length(2.0))
    np.testing.assert_array_equal(motion.covariance, MOTION.covariance * np.outer(factor, factor))


@pytest.mark.parametrize("told", [None, Length(99.0, 4e-5), Length(0.1, 0.01)])
def test_where_no_length_is_told_or_believed_it_is_the_expected_one_and_wide(told):
    model = after([0.9, 0.91, 0.92, 0.93])
    motion, later = with_length(MOTION, told, model, "a source")
    assert motion.status is Status.SOLVED
    assert (motion.scale_known, motion.length_predicted) == (False, True)
    assert ("not expected" if told else "tells no length") in motion.reason
    length = np.linalg.norm(motion.T_k_prev.translation)
    assert length == pytest.approx(0.93, abs=0.03)
    t = UNIT.translation
    sigma = np.sqrt(t @ motion.covariance[3:, 3:] @ t)
    assert 0.04 < sigma < 0.2
    for _ in range(20):
        motion, later = with_length(MOTION, None, later, "a source")
    assert np.sqrt(t @ motion.covariance[3:, 3:] @ t) > 3 * sigma


def test_before_the_first_length_none_is_claimed():
    motion, _ = with_length(MOTION, None, LengthModel(), "a source")
    assert not (motion.scale_known or motion.length_predicted)
    assert np.isnan(motion.covariance[3:, 3:]).all() and np.isfinite(motion.covariance[:3, :3]).all()
    assert "length unknown" in motion.reason


def test_several_unexpected_lengths_that_agree_are_believed():
    model = after([0.9] * 5)
    believed = []
    for metres in (0.3, 0.31, 0.3, 0.31):
        motion, model = with_length(MOTION, Length(metres, 0.01), model, "a source")
        believed.append(motion.scale_known)
    assert believed == [False, False, True, True]
    assert model.predict()[0] == pytest.approx(0.31, abs=0.01)


def test_unexpected_lengths_that_do_not_agree_never_are():
    model = after([0.9] * 5)
    for metres in (0.1, 5.0, 40.0, 0.2, 9.0):
        motion, model = with_length(MOTION, Length(metres, 0.01), model, "a source")
        assert not motion.scale_known


def test_a_car_that_starts_is_followed():
    """From a standstill at 2.5 m/s^2, ten images a second."""
    model = after([0.9, 0.5, 0.1])
    for _ in range(50):
        model = model.skipped()
    for k in range(1, 30):
        metres = 0.025 * k
        motion, model = with_length(MOTION, Length(metres, 0.02 * metres), model, "a source")
        assert motion.scale_known, k


def test_the_model_is_right_as_often_as_it_says():
    rng = np.random.default_rng(2)
    metres, model, within = 1.0, LengthModel(), []
    for _ in range(500):
        metres = max(metres + 0.03 * rng.standard_normal(), 0.5)
        told = metres + 0.02 * rng.standard_normal()
        expected = model.predict()
        if expected is not None:
            within.append(abs(metres - expected[0]) < 1.96 * expected[1])
        _, model = with_length(MOTION, Length(told, 0.02), model, "a source")
    assert np.mean(within) > 0.9


def test_motions_that_were_not_refined_keep_their_information():
    still = replace(MOTION, T_k_prev=RigidTransform.from_translation(UNIT.translation))
    np.testing.assert_array_equal(rescaled(still, Length(0.0)).information, MOTION.information)
