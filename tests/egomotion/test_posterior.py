from dataclasses import replace

import numpy as np
import pytest

from flowlik.egomotion import GaussianPrior, KnownDepth, Status, lcmsac, log_prob, mle
from flowlik.egomotion.covariance import temperature
from flowlik.errors import DataError, ModelError
from flowlik.geometry.motion import exp_se3, inverse_left_jacobian, right_covariance, scaled
from flowlik.likelihood.likelihood import FlowLikelihood
from flowlik.likelihood.schedule import Index
from flowlik.likelihood.shared_errors import SCALES_PX, ScoreCorrelation, SharedErrors
from tests.helpers import (
    CAMERA,
    each_of,
    finite_difference,
    lcm_likelihood,
    make_scene,
    normalised,
    random_motion,
    tangent_error,
)

MODEL = lcm_likelihood()
GAUSSIAN = FlowLikelihood.constant_gaussian(0.3)
SIGMA = np.array([2e-3, 1e-3, 3e-3, 0.02, 0.05, 0.03])


def scene_of(seed, **options):
    rng = np.random.default_rng(seed)
    return make_scene(random_motion(rng), rng, **options)


def covariance(seed=0):
    root = SIGMA[:, None] * (np.eye(6) + 0.3 * np.random.default_rng(seed).standard_normal((6, 6)))
    return root @ root.T


@pytest.mark.parametrize("kind", ["known_depth", "epipolar"])
def test_gradient_is_that_of_the_value(kind):
    # a Gaussian has no cusp for the differences to step over
    scene = scene_of(1, n=200, likelihood=GAUSSIAN)
    residual, T = getattr(scene, kind), exp_se3(SIGMA) * scene.T
    found = log_prob(GAUSSIAN, residual, T)
    if kind == "epipolar":
        T = scaled(T, 1.0)
    numeric = finite_difference(
        lambda xi: log_prob(GAUSSIAN, residual, exp_se3(xi) * T).value, np.zeros(6), 1e-6
    )
    np.testing.assert_allclose(found.gradient, numeric, rtol=2e-4, atol=1e-4 * np.abs(numeric).max())
    x = np.zeros(len(residual) * each_of(residual))
    _, z, J, *_ = residual.at(normalised(residual, T.as_matrix()[:3]), Index())
    np.testing.assert_allclose(found.information, J.T @ J / 0.09, rtol=1e-3, atol=1e-6)
    assert found.value == pytest.approx(GAUSSIAN.log_prob(z, x).sum())


def test_values_are_the_models_own():
    scene = scene_of(2, n=100, likelihood=MODEL)
    residual = scene.known_depth
    _, z, *_ = residual.at(scene.T.as_matrix()[:3], Index())
    expected = MODEL.log_prob(z, np.log(scene.measurements.t).ravel()).sum()
    assert log_prob(MODEL, residual, scene.T).value == pytest.approx(expected)
    assert log_prob(MODEL, residual, exp_se3(SIGMA) * scene.T).value < expected
    with pytest.raises(ModelError, match="farneback"):
        log_prob(lcm_likelihood(method={"name": "farneback"}), residual, scene.T)


def test_the_priors_gradient_and_information():
    rng = np.random.default_rng(3)
    prior = GaussianPrior(random_motion(rng), covariance())
    T = exp_se3(np.array([0.3, -0.2, 0.1, 0.5, 0.2, -0.4])) * prior.mean
    numeric = finite_difference(lambda xi: prior.log_prob(exp_se3(xi) * T).value, np.zeros(6), 1e-6)
    np.testing.assert_allclose(prior.log_prob(T).gradient, numeric, rtol=1e-4)
    at_mean = prior.log_prob(prior.mean)
    assert at_mean.value == pytest.approx(0)
    np.testing.assert_allclose(at_mean.information @ covariance(), np.eye(6), atol=1e-9)


def test_the_inverse_left_jacobian_is_a_derivative():
    xi = np.array([0.2, -0.1, 0.3, 0.4, 0.1, -0.2])
    numeric = finite_difference(lambda d: (exp_se3(d) * exp_se3(xi)).as_exp_coords(), np.zeros(6), 1e-6)
    np.testing.assert_allclose(inverse_left_jacobian(xi), numeric, atol=1e-5)


@pytest.mark.parametrize("make", [mle, lcmsac])
def test_a_prior_gives_the_maximum_posterior(make):
    scene = scene_of(4, n=300, likelihood=GAUSSIAN)
    residual = scene.known_depth
    prior = GaussianPrior(exp_se3(0.5 * SIGMA) * scene.T, covariance() / 100)
    result = make(GAUSSIAN).estimate(residual, prior=prior)
    used = np.ones(600, bool) if make is mle else None
    if used is not None:  # in the linear-Gaussian case everything is in closed form
        flow, before = log_prob(GAUSSIAN, residual, result.T_k_prev), prior.log_prob(result.T_k_prev)
        step = np.linalg.solve(flow.information + before.information, flow.gradient + before.gradient)
        sigma = np.sqrt(np.diag(result.covariance))
        np.testing.assert_allclose(step / sigma, 0, atol=0.05)
        expected = np.linalg.inv(flow.information + before.information)
        np.testing.assert_allclose(result.covariance, expected, rtol=0.02, atol=1e-3 * sigma.min() ** 2)
    alone = make(GAUSSIAN).estimate(residual)
    shrunk = alone.covariance - result.covariance
    assert np.linalg.eigvalsh(shrunk / np.sqrt(np.outer(*[np.diag(alone.covariance)] * 2)))[0] > -1e-6
    to_mean = np.linalg.norm(tangent_error(result.T_k_prev, prior.mean) / SIGMA)
    assert to_mean < np.linalg.norm(tangent_error(alone.T_k_prev, prior.mean) / SIGMA)


def test_a_strong_prior_wins_and_a_weak_one_does_not_matter():
    scene = scene_of(5, n=300, likelihood=MODEL)
    mean = exp_se3(SIGMA) * scene.T
    strong = mle(MODEL).estimate(scene.known_depth, prior=GaussianPrior(mean, 1e-8 * covariance()))
    np.testing.assert_allclose(tangent_error(strong.T_k_prev, mean) / SIGMA, 0, atol=0.01)
    weak = mle(MODEL).estimate(scene.known_depth, prior=GaussianPrior(mean, 1e6 * covariance()))
    alone = mle(MODEL).estimate(scene.known_depth)
    sigma = np.sqrt(np.diag(alone.covariance))
    np.testing.assert_allclose(tangent_error(weak.T_k_prev, alone.T_k_prev) / sigma, 0, atol=0.2)


def test_a_prior_determines_what_the_measurements_do_not():
    scene = scene_of(6, n=10)
    repeated = scene.measurements.select(np.repeat([0, 1], 25))
    residual = KnownDepth.of(repeated, CAMERA, np.repeat(scene.depth[:2], 25))
    assert mle(MODEL).estimate(residual).status is Status.DEGENERATE
    prior = GaussianPrior(scene.T, covariance())
    result = mle(MODEL).estimate(residual, prior=prior)
    assert result.status is Status.SOLVED
    assert np.linalg.eigvalsh(result.covariance)[0] > 0


def test_correlated_scores_are_weighed_by_what_they_know():
    A = np.diag([4.0, 9, 1, 2, 3, 5])
    assert temperature(A, A) == pytest.approx(1)
    assert temperature(A, 10 * A) == pytest.approx(0.1)
    assert temperature(np.diag([4.0, 9, 1, 2, 3, 0]), np.diag([8.0, 18, 2, 4, 6, 0])) == pytest.approx(0.5)
    scene = scene_of(7, n=300, likelihood=GAUSSIAN)
    own = np.array([1.0, *np.zeros(len(SCALES_PX)), 0.0])
    shared = own + np.array([0.0, *np.zeros(len(SCALES_PX)), 0.5])
    scales = np.array(SCALES_PX)
    correlated = replace(
        GAUSSIAN, shared_errors=SharedErrors(ScoreCorrelation(scales, shared, 0 * own, 0 * own))
    )
    prior = GaussianPrior(exp_se3(SIGMA) * scene.T, covariance() / 1e4)
    near = {}
    for name, model in (("plain", GAUSSIAN), ("correlated", correlated)):
        T = mle(model).estimate(scene.known_depth, prior=prior).T_k_prev
        near[name] = np.linalg.norm(tangent_error(T, prior.mean) / SIGMA)
    assert near["correlated"] < near["plain"]


def test_impossible_priors_are_refused():
    T = random_motion(np.random.default_rng(8))
    with pytest.raises(DataError, match="singular"):
        GaussianPrior(T, np.diag([1.0, 1, 1, 1, 1, 0]))
    rank_5 = np.ones((6, 6)) + np.diag([1.0, 1, 1, 1, 0, 0])
    with pytest.raises(DataError, match="singular"):
        GaussianPrior(T, rank_5)
    for bad in (np.eye(5), np.full((6, 6), np.nan), np.eye(6) + np.eye(6, k=1)):
        with pytest.raises(DataError, match="symmetric"):
            GaussianPrior(T, bad)
    with pytest.raises(DataError, match="needs depth"):
        mle(MODEL).estimate(scene_of(9, n=50).epipolar, prior=GaussianPrior(T, np.eye(6)))


def test_the_adjoint_turns_a_left_covariance_into_a_right_one():
    rng = np.random.default_rng(10)
    T, C = random_motion(rng, 40.0, 2.0), 1e-4 * covariance()
    draws = rng.multivariate_normal(np.zeros(6), C, 4000)
    right = np.array([(T.inv() * exp_se3(xi) * T).as_exp_coords() for xi in draws])
    expected = right_covariance(T, C)
    scale = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
    np.testing.assert_allclose(np.cov(right.T) / scale, expected / scale, atol=0.08)
