from dataclasses import replace

import numpy as np
import pytest

from flowlik.calibration._correlation import ScoreProducts, fit_correlation
from flowlik.egomotion import KnownDepth, lcmsac, mle
from flowlik.egomotion.covariance import (
    SPACING,
    score_covariance,
    smoothed_products,
)
from flowlik.errors import ModelError
from flowlik.geometry.motion import h, inverse_range
from flowlik.likelihood.families import Gaussian
from flowlik.likelihood.likelihood import FlowLikelihood
from flowlik.likelihood.schedule import Index, Schedule
from flowlik.likelihood.shared_errors import SCALES_PX, ScoreCorrelation, SharedErrors, flow_directions
from tests.helpers import (
    CAMERA,
    each_of,
    lcm_likelihood,
    make_scene,
    normalised,
    random_motion,
    tangent_error,
)

MODEL = lcm_likelihood()
SCALES = np.array(SCALES_PX)


def weights(own, image, **gaussians):
    near = [gaussians.get(f"g{int(scale)}", 0.0) for scale in SCALES]
    return np.array([own, *near, image])


CORRELATION = ScoreCorrelation(
    SCALES,
    weights(0.5, 0.0, g8=0.3, g64=0.1),
    weights(0.0, 0.02, g16=0.3, g128=0.1),
    weights(0.0, 0.05, g32=0.03),
)


def scene_of(seed, n=400):
    rng = np.random.default_rng(seed)
    return make_scene(random_motion(rng), rng, n=n, likelihood=MODEL)


@pytest.mark.parametrize("scale", [8.0, 32.0, 128.0])
def test_splines_on_a_grid_stand_for_a_gaussian(scale):
    rng = np.random.default_rng(0)
    pixels = rng.uniform([0, 0], [640, 360], (500, 2))
    G = rng.standard_normal((500, 2, 6)) + np.array([1.0, 0.3])[:, None]
    w = np.array([0.7, 0.2])
    square = ((pixels[:, None] - pixels[None]) ** 2).sum(axis=-1)
    kernel = np.exp(-square / (2 * scale**2))
    expected = sum(a * G[:, b].T @ kernel @ G[:, b] for b, a in enumerate(w))
    found = smoothed_products(pixels, G, w, SPACING * scale)
    np.testing.assert_array_equal(found, found.T)
    assert np.linalg.eigvalsh(found)[0] > 0
    np.testing.assert_allclose(found, expected, atol=0.04 * np.abs(expected).max())


@pytest.mark.parametrize("kind", ["known_depth", "epipolar"])
def test_variability_is_the_sum_over_pairs_of_components(kind):
    residual = getattr(scene_of(1), kind)
    m, T = residual.measurements, normalised(residual, scene_of(1).T.as_matrix()[:3])
    _, _, J, x, *_ = residual.at(T, MODEL.schedule.index)
    fisher, e = MODEL.fisher(x), residual.at(T, Index()).directions
    of = np.repeat(np.arange(len(m)), each_of(residual))
    distance = np.linalg.norm(m.pixels[of][:, None] - m.pixels[of][None], axis=-1)
    rho, rho_flow, rho_v = CORRELATION.at(distance)
    along = np.einsum("ci,ci->c", flow_directions(m.flow)[of], e)
    pairs = rho * (e @ e.T) + rho_flow * np.outer(along, along) + rho_v * np.outer(e[:, 1], e[:, 1])
    root = np.sqrt(fisher)[:, None] * J
    expected = root.T @ pairs @ root
    found = score_covariance(m, e, J, fisher, CORRELATION)
    scale = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
    np.testing.assert_allclose(found / scale, expected / scale, atol=0.03)


INDEPENDENT = ScoreCorrelation(SCALES, weights(1, 0), *2 * [weights(0, 0)])


def test_uncorrelated_scores_vary_by_their_information():
    residual = scene_of(2).known_depth
    plain = mle(MODEL).estimate(residual)
    np.testing.assert_allclose(plain.covariance @ plain.information, np.eye(6), atol=1e-6)
    T = plain.T_k_prev.as_matrix()[:3]
    _, _, J, *_ = residual.at(T, Index())
    fisher = MODEL.fisher(residual.at(T, MODEL.schedule.index).x)
    B = score_covariance(residual.measurements, residual.at(T, Index()).directions, J, fisher, INDEPENDENT)
    np.testing.assert_allclose(B, plain.information, rtol=1e-9)


GAUSSIAN = FlowLikelihood.constant_gaussian(0.3)


@pytest.mark.parametrize("kind", ["known_depth", "epipolar"])
def test_observed_sensitivity_is_the_information_where_the_density_holds(kind):
    rng = np.random.default_rng(3)
    residual = getattr(make_scene(random_motion(rng), rng, n=500, likelihood=GAUSSIAN), kind)
    result = mle(replace(GAUSSIAN, shared_errors=SharedErrors(INDEPENDENT))).estimate(residual)
    basis = residual.at(result.T_k_prev.as_matrix()[:3], Index()).basis
    found = np.linalg.inv(basis.T @ result.covariance @ basis)
    expected = basis.T @ result.information @ basis
    scale = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
    np.testing.assert_allclose(found / scale, expected / scale, atol=0.05)


def test_a_frame_of_wider_errors_tells_so_itself():
    rng, plain, honest = np.random.default_rng(5), [], []
    model = mle(replace(MODEL, shared_errors=SharedErrors(INDEPENDENT)))
    for seed in range(30):
        scene = make_scene(random_motion(rng), rng, n=800, likelihood=MODEL)
        m = scene.measurements
        true = h(scene.T, CAMERA, m.pixels, inverse_range(CAMERA, m.pixels, scene.depth))
        wider = replace(m, flow=true + 3.0 * (m.flow - true))
        result = model.estimate(KnownDepth.of(wider, CAMERA, scene.depth), seed=seed)
        xi = tangent_error(result.T_k_prev, scene.T)
        plain.append(xi @ result.information @ xi)
        honest.append(xi @ np.linalg.solve(result.covariance, xi))
    assert np.mean(honest) < 0.5 * np.mean(plain)


def correlated_scene(rng, n=800):
    """Gaussian errors of which a third of the variance is a field that changes over 64 px."""
    T = random_motion(rng)
    scene = make_scene(T, rng, n=n)
    m = scene.measurements
    # waves whose frequencies make the field's correlation a Gaussian
    waves, phases = rng.standard_normal((2, 200, 2)) / 64.0, rng.uniform(0, 2 * np.pi, (2, 200))
    smooth = np.cos(np.einsum("ni,cwi->ncw", m.pixels, waves) + phases).sum(axis=-1) / 10.0
    error = 0.3 * (np.sqrt(2 / 3) * rng.standard_normal((n, 2)) + np.sqrt(1 / 3) * smooth)
    measured = replace(m, flow=m.flow + error)
    z = np.einsum("nij,ni->nj", m.R_i_e, error)
    return T, measured, z, KnownDepth.of(measured, CAMERA, scene.depth)


def test_correlated_errors_are_covered_by_the_calibrated_covariance():
    rng = np.random.default_rng(3)
    sums = ScoreProducts.empty()
    for _ in range(60):
        _, m, z, _ = correlated_scene(rng)
        sums = sums.merge(ScoreProducts.of(GAUSSIAN, m, z))
    correlation = fit_correlation(sums)
    d = np.array([0.0, 30.0, 64.0, 100.0, 300.0])
    expected = np.where(d == 0, 1.0, np.exp(-(d**2) / (2 * 64.0**2)) / 3)
    np.testing.assert_allclose(correlation.at(d), [expected, np.zeros(5), np.zeros(5)], atol=0.05)
    model = replace(GAUSSIAN, shared_errors=SharedErrors(correlation))
    for estimator in (mle(model), lcmsac(model)):
        plain, honest = [], []
        for seed in range(60):
            T, _, _, residual = correlated_scene(rng)
            result = estimator.estimate(residual, seed=seed)
            xi = tangent_error(result.T_k_prev, T)
            plain.append(xi @ result.information @ xi)
            honest.append(xi @ np.linalg.solve(result.covariance, xi))
        assert np.mean(plain) > 20
        # cut-off Gaussian scores go together less than whole ones, by which the correlation was measured
        assert (4.8 if estimator.refine_all else 3.0) < np.mean(honest) < 7.5


def leaning_scene(rng, n=400):
    """Gaussian errors of which a tenth of the variance is one shift of the whole image up or down."""
    T = random_motion(rng)
    scene = make_scene(T, rng, n=n)
    m = scene.measurements
    shift = np.array([0.0, np.sqrt(0.1) * rng.standard_normal()])
    error = 0.3 * (rng.standard_normal((n, 2)) * np.sqrt([1.0, 0.9]) + shift)
    measured = replace(m, flow=m.flow + error)
    z = np.einsum("nij,ni->nj", m.R_i_e, error)
    return T, measured, z, KnownDepth.of(measured, CAMERA, scene.depth)


def test_errors_shared_down_the_image_are_covered():
    rng = np.random.default_rng(7)
    sums = ScoreProducts.empty()
    for _ in range(200):
        _, m, z, _ = leaning_scene(rng)
        sums = sums.merge(ScoreProducts.of(GAUSSIAN, m, z))
    assert sums.norm[0] == pytest.approx(200)  # every image pair alike
    correlation = fit_correlation(sums)
    np.testing.assert_allclose(correlation.at(np.array([100.0, 300.0]))[2], 0.1, atol=0.03)
    model = mle(replace(GAUSSIAN, shared_errors=SharedErrors(correlation)))
    plain, honest = [], []
    for _ in range(60):
        T, _, _, residual = leaning_scene(rng)
        result = model.estimate(residual)
        xi = tangent_error(result.T_k_prev, T)
        plain.append(xi @ result.information @ xi)
        honest.append(xi @ np.linalg.solve(result.covariance, xi))
    assert np.mean(plain) > 12
    assert 4.5 < np.mean(honest) < 7.5


def test_the_cut_information_is_a_sensitivity_and_a_variance():
    x = np.array([0.0, 3.0, 6.0])
    b = MODEL.bound(x, 0.9)
    rng = np.random.default_rng(4)
    z = MODEL.sample(np.repeat(x[:, None], 200_000, axis=1), rng)
    cut = np.where(np.abs(z) <= b[:, None], MODEL.score(z, x[:, None]), 0.0)
    found = MODEL.fisher(x, 0.9)
    np.testing.assert_allclose((cut**2).mean(axis=1), found, rtol=0.02)
    # a shift of the density moves the mean of the cut score at the same rate
    step = 0.02 * b[:, None]
    moved = [
        np.where(np.abs(z + s) <= b[:, None], MODEL.score(z + s, x[:, None]), 0.0).mean(axis=1)
        for s in (step, -step)
    ]
    np.testing.assert_allclose((moved[1] - moved[0]) / (2 * step[:, 0]), found, rtol=0.08)
    assert (found < MODEL.fisher(x)).all()


def test_products_merge_by_addition():
    a, b = (ScoreProducts.of(MODEL, scene.measurements, z) for scene, z in map(scored, (5, 6)))
    both = a.merge(b)
    np.testing.assert_array_equal(both.along, a.along + b.along)
    scene, _ = scored(5)
    pixels = scene.measurements.pixels
    pairs = np.linalg.norm(pixels[:, None] - pixels[None], axis=-1)[np.tril_indices(len(pixels), -1)]
    assert (a.norm[1:] > 0).sum() == len(np.unique(np.digitize(pairs, edges())))


def edges():
    from flowlik.calibration._correlation import EDGES_PX

    return EDGES_PX


def scored(seed):
    scene = scene_of(seed)
    m = scene.measurements
    return scene, m.errors(h(scene.T, CAMERA, m.pixels, inverse_range(CAMERA, m.pixels, scene.depth)))


def test_an_impossible_correlation_is_refused():
    with pytest.raises(ModelError, match="at least 0"):
        ScoreCorrelation(SCALES, weights(1, -0.1), weights(1, 0), weights(0, 0))
    with pytest.raises(ModelError, match="9 weights"):
        ScoreCorrelation(SCALES, np.ones(3), weights(1, 0), weights(0, 0))
    with pytest.raises(ModelError, match="scale_px, isotropic, along, vertical"):
        ScoreCorrelation.of_values({"scale_px": [1.0]})
    again = ScoreCorrelation.of_values(CORRELATION.values())
    np.testing.assert_array_equal(again.at(np.arange(50.0)), CORRELATION.at(np.arange(50.0)))


def test_emphasis_weighs_components_and_its_covariance_knows():
    """Against Gauss and Newton's weighted least squares: the motion, and how it scatters."""
    index = MODEL.schedule.index
    knots = MODEL.schedule.knots[[0, -1]]
    wide = FlowLikelihood(Gaussian(), Schedule(index, knots, np.array([[1.0, 0.1]])))
    model = mle(replace(wide, shared_errors=SharedErrors(INDEPENDENT, 0.5)))
    rng, distances = np.random.default_rng(9), []
    for seed in range(60):
        scene = make_scene(random_motion(rng), rng, n=300, likelihood=wide)
        residual = scene.known_depth
        result = model.estimate(residual, seed=seed)
        xi = tangent_error(result.T_k_prev, scene.T)
        distances.append(xi @ np.linalg.solve(result.covariance, xi))
        if seed == 0:
            T = result.T_k_prev.as_matrix()[:3]
            _, z, J, *_ = residual.at(T, Index())
            f = wide.fisher(residual.at(T, index).x)
            weight = f * np.sqrt(f)
            step = np.linalg.solve(J.T @ (weight[:, None] * J), J.T @ (weight * z))
            assert step @ result.information @ step < 1e-4
    # 6 if honest, of standard deviation 3.5 / sqrt(60)
    assert 4.6 < np.mean(distances) < 7.4
