import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from flowlik.egomotion import EgoMotion, Epipolar, Status, covariance, mle
from flowlik.evaluation.motion.split_half import (
    difference_covariance,
    direction_noise_mrad,
    half_coverage,
    half_distances,
    rotation_noise_mdeg,
    truth_distances,
)
from flowlik.geometry.motion import exp_se3
from flowlik.likelihood.shared_errors import SCALES_PX, ScoreCorrelation, SharedErrors
from flowlik.measurement.halves import halves
from tests.helpers import CAMERA, lcm_likelihood, make_scene, random_motion


def test_halves_are_a_chessboard_of_64_pixels():
    pixels = np.array([[0, 0], [63.9, 63.9], [64, 0], [0, 64], [64, 64], [130, 70]], float)
    first, second = halves(pixels)
    np.testing.assert_array_equal(first, [True, True, False, False, True, False])
    np.testing.assert_array_equal(second, ~first)


def noisy(rng, count, sigma_direction, sigma_rotation):
    """Motions ahead with independent noise of direction [rad] and rotation [rad] in each axis."""
    moves = np.tile([0, 0, 1.0], (count, 1))
    moves[:, :2] += sigma_direction * rng.standard_normal((count, 2))
    moves /= np.linalg.norm(moves, axis=1, keepdims=True)
    turns = Rotation.from_rotvec(sigma_rotation * rng.standard_normal((count, 3)))
    return RigidTransform.from_rotation(turns) * RigidTransform.from_translation(moves).inv()


def test_the_noise_is_that_of_all_measurements_together():
    rng = np.random.default_rng(0)
    halves_of = [noisy(rng, 4000, 2e-3, 0.0) for _ in range(2)]
    # a half has sqrt 2 times the noise of the whole
    assert direction_noise_mrad(*halves_of) == pytest.approx(2.0 / np.sqrt(2), rel=0.05)
    turned = [noisy(rng, 4000, 0.0, np.deg2rad(0.01)) for _ in range(2)]
    assert rotation_noise_mdeg(*turned) == pytest.approx(10.0 / np.sqrt(2), rel=0.05)


def test_a_right_covariance_covers_the_differences():
    rng = np.random.default_rng(1)
    sigma, ahead = np.array([2e-3, 2e-3, 3e-3, 1e-3, 2e-3]), RigidTransform.from_translation([0, 0, 1.0])
    information = np.diag(np.append(1 / sigma**2, 0.0))

    def estimate():
        T = exp_se3(np.append(sigma * rng.standard_normal(5), 0.0)) * ahead
        T = RigidTransform.from_components(T.translation / np.linalg.norm(T.translation), T.rotation)
        return EgoMotion(T, information, np.linalg.pinv(information), Status.SOLVED)

    first, second = ([estimate() for _ in range(600)] for _ in range(2))
    from_truth = truth_distances(first, [ahead] * len(first))
    assert half_coverage(from_truth, 0.9) == pytest.approx(0.9, abs=0.04)
    distances = half_distances(first, second)
    assert distances.mean() == pytest.approx(5, rel=0.1)
    for confidence in (0.5, 0.9, 0.95):
        assert half_coverage(distances, confidence) == pytest.approx(confidence, abs=0.06)


def test_the_covariance_of_a_difference_knows_what_halves_share(monkeypatch):
    """Without correlation it is the halves' sum; what a whole image shares cancels between equal ones."""
    monkeypatch.setattr(covariance, "OTHER_SUBPIXEL_BIAS_PX", 0.0)
    rng = np.random.default_rng(2)
    m = make_scene(random_motion(rng, 1.0, 0.5), rng, n=400, likelihood=lcm_likelihood()).measurements
    apart, twice = [m.select(half) for half in halves(m.pixels)], [m, m]
    for parts, own in ((apart, 1.0), (twice, 1.0), (twice, 0.5)):
        weights = np.array([own, *np.zeros(7), 1 - own])
        correlation = ScoreCorrelation(np.array(SCALES_PX), weights, np.zeros(9), np.zeros(9))
        model = lcm_likelihood(shared_errors=SharedErrors(correlation))
        residuals = [Epipolar.of(part, CAMERA) for part in parts]
        estimator = mle(model)
        found = [estimator.estimate(residual, seed=0) for residual in residuals]
        total = found[0].covariance + found[1].covariance
        difference = difference_covariance(estimator, residuals, found)
        if own == 1:
            np.testing.assert_allclose(difference, total, rtol=1e-6, atol=1e-6 * np.abs(total).max())
        else:
            assert np.trace(difference[:3, :3]) < 0.1 * np.trace(total[:3, :3])


def test_a_bias_that_halves_share_cancels_between_equal_ones():
    rng = np.random.default_rng(3)
    m = make_scene(random_motion(rng, 1.0, 0.5), rng, n=400, likelihood=lcm_likelihood()).measurements
    weights = np.array([1.0, *np.zeros(8)])
    correlation = ScoreCorrelation(np.array(SCALES_PX), weights, np.zeros(9), np.zeros(9))
    estimator = mle(lcm_likelihood(shared_errors=SharedErrors(correlation)))
    residuals = [Epipolar.of(m, CAMERA)] * 2
    found = [estimator.estimate(residual, seed=0) for residual in residuals]
    difference = difference_covariance(estimator, residuals, found)
    total = found[0].covariance + found[1].covariance
    basis = np.linalg.svd(total)[0][:, :5]
    assert (np.linalg.eigvalsh(basis.T @ (total - difference) @ basis) > 0).all()
