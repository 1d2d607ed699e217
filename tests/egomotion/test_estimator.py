import numpy as np
import pytest
from scipy.optimize import least_squares, minimize

from flowlik.egomotion import Epipolar, Estimator, KnownDepth, Status, lcmsac, mle, ransac
from flowlik.egomotion.epipolar import FivePoint
from flowlik.egomotion.known_depth import ThreePoint
from flowlik.errors import ModelError
from flowlik.geometry import motion
from flowlik.likelihood.likelihood import FlowLikelihood
from flowlik.likelihood.schedule import Index
from flowlik.measurement.measurements import Measurements
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
INDEX = Index()
ESTIMATORS = [ransac(), lcmsac(MODEL), mle(MODEL)]
every_estimator = pytest.mark.parametrize("estimator", ESTIMATORS, ids=lambda e: e.name)
both_residuals = pytest.mark.parametrize("kind", ["known_depth", "epipolar"])


def scene_of(seed: int, **options):
    rng = np.random.default_rng(seed)
    return make_scene(random_motion(rng), rng, **options)


def truth_of(scene, residual):
    return normalised(residual, scene.T.as_matrix()[:3])


@every_estimator
@both_residuals
@pytest.mark.parametrize("outliers", [0.0, 0.4])
def test_exact_flow_gives_the_exact_motion(estimator, kind, outliers):
    scene = scene_of(1, n=500, outliers=outliers)
    residual = getattr(scene, kind)
    result = estimator.estimate(residual)
    assert result.status is Status.SOLVED
    assert result.scale_known is (kind == "known_depth")
    assert result.components == informative(estimator, residual, result).sum()
    # a cusped likelihood settles within its table's smallest error, 6e-5 px; outliers that happen to
    # lie near their epipolar lines have their say in least squares
    least_squares_error = 1e-3 if (kind, outliers) == ("epipolar", 0.4) else 1e-10
    tolerance = least_squares_error if estimator.name == "ransac" else 1e-5
    np.testing.assert_allclose(
        result.T_k_prev.as_matrix()[:3], truth_of(scene, residual), rtol=0, atol=tolerance
    )


def informative(estimator, residual, result):
    """Components that count: without depth only those that are known to 2 px."""
    x = residual.at(result.T_k_prev.as_matrix()[:3], INDEX).x
    everything = residual.metric or estimator.name == "ransac"
    return everything | (estimator.likelihood.bound(x, 0.9) <= 2)


@every_estimator
@both_residuals
def test_the_same_seed_gives_the_same_result(estimator, kind):
    residual = getattr(scene_of(2, likelihood=MODEL, outliers=0.2), kind)
    first, second = (estimator.estimate(residual, seed=5) for _ in range(2))
    np.testing.assert_array_equal(first.T_k_prev.as_matrix(), second.T_k_prev.as_matrix())
    np.testing.assert_array_equal(first.information, second.information)
    assert (first.inliers, first.hypotheses, first.log_prob) == (
        second.inliers,
        second.hypotheses,
        second.log_prob,
    )


def vector_errors(residual, T):
    return residual.at(T, INDEX).z.reshape(-1, each_of(residual))


@both_residuals
def test_ransac_is_least_squares_on_its_inliers(kind):
    scene = scene_of(3, n=600, likelihood=FlowLikelihood.constant_gaussian(0.15), outliers=0.3)
    residual = getattr(scene, kind)
    result = ransac().estimate(residual)
    T = result.T_k_prev.as_matrix()[:3]
    inliers = np.linalg.norm(vector_errors(residual, T), axis=1) <= 0.5
    assert result.inliers == inliers.sum()
    assert result.inlier_unit == "vector"

    def errors(xi):
        moved = normalised(residual, (motion.exp_se3(xi) * result.T_k_prev).as_matrix()[:3])
        return vector_errors(residual, moved)[inliers].ravel()

    best = least_squares(errors, np.zeros(6), x_scale=1e-3, xtol=1e-14, ftol=1e-14, gtol=1e-14)
    # refinement ends where a step would gain less than 1e-3 nat, or 0.04 standard deviations
    gain_nat = ((errors(np.zeros(6)) ** 2).sum() - 2 * best.cost) / (2 * 0.5**2)
    assert 0 <= gain_nat + 1e-9 < 1e-3
    away = residual.at(T, INDEX).basis.T @ best.x  # without the scale, which the epipolar errors do not fix
    sigma = np.sqrt(
        np.diag(
            np.linalg.inv(residual.at(T, INDEX).basis.T @ result.information @ residual.at(T, INDEX).basis)
        )
    )
    np.testing.assert_allclose(away / sigma, 0, atol=0.04)


def test_maximum_likelihood_is_a_maximum():
    scene = scene_of(4, n=1000, likelihood=MODEL)
    residual = scene.known_depth
    result = mle(MODEL).estimate(residual)
    x = residual.at(result.T_k_prev.as_matrix()[:3], INDEX).x
    root = np.linalg.cholesky(result.covariance)  # steps in units of the standard deviation

    def log_prob(T):
        _, z, *_ = residual.at(T.as_matrix()[:3], INDEX)
        return MODEL.log_prob(z, x).sum()

    def fall(step):
        return log_prob(result.T_k_prev) - log_prob(motion.exp_se3(root @ step) * result.T_k_prev)

    assert log_prob(result.T_k_prev) > log_prob(scene.T)
    assert result.log_prob == pytest.approx(log_prob(result.T_k_prev), abs=1e-3 * len(residual))
    _, z, J, *_ = residual.at(result.T_k_prev.as_matrix()[:3], INDEX)
    np.testing.assert_allclose(root.T @ J.T @ MODEL.score(z, x), 0, atol=0.6)
    # the weights' floor rounds the cusp off: a fifth of a nat, or some tenths of a standard deviation
    simplex = 0.1 * np.vstack([np.zeros(6), np.eye(6)])
    best = minimize(
        fall, np.zeros(6), method="Nelder-Mead", options={"initial_simplex": simplex, "maxiter": 2000}
    )
    assert best.fun > -0.25
    assert np.linalg.norm(best.x) < 0.6


@every_estimator
@both_residuals
def test_information_is_the_sum_over_components_in_use(estimator, kind):
    residual = getattr(scene_of(5, n=300, likelihood=MODEL, outliers=0.2), kind)
    result = estimator.estimate(residual)
    T = result.T_k_prev.as_matrix()[:3]
    _, z, J, x, *_ = residual.at(T, INDEX)
    likelihood = estimator.likelihood
    if estimator.name == "ransac":
        inliers = np.linalg.norm(z.reshape(len(residual), -1), axis=1) <= 0.5
        assert result.inliers == inliers.sum()
        used = np.repeat(inliers, each_of(residual))
    else:
        used = informative(estimator, residual, result) & (np.abs(z) <= likelihood.bound(x, 0.9))
        assert result.inliers == used.sum()
        assert result.informative == (used & (likelihood.bound(x, 0.9) <= 1)).sum()
    if estimator.name != "ransac":  # a cut likelihood's components all count, with what the cut leaves
        used = informative(estimator, residual, result)
    fisher = likelihood.fisher(x[used], 0.9 if estimator.name == "lcmsac" else None)
    expected = sum(i * np.outer(j, j) for i, j in zip(fisher, J[used]))
    np.testing.assert_allclose(result.information, expected, rtol=1e-6, atol=1e-6 * np.abs(expected).max())
    eigenvalues = np.linalg.eigvalsh(result.information)
    if kind == "epipolar":  # no information about the scale: rank 5
        direction = np.concatenate([np.zeros(3), result.T_k_prev.translation])
        assert direction @ result.information @ direction < 1e-9 * eigenvalues[-1]
        np.testing.assert_allclose(result.covariance @ direction, 0, atol=1e-9)
    else:
        np.testing.assert_allclose(result.covariance @ expected, np.eye(6), atol=1e-6)


def test_maximum_likelihood_is_consistent_with_its_covariance():
    nees, rng = [], np.random.default_rng(6)
    for trial in range(60):
        # with few vectors the cusps' information is not yet reached: 9 at 250
        scene = make_scene(random_motion(rng), rng, n=1500, likelihood=MODEL)
        result = mle(MODEL).estimate(scene.known_depth, seed=trial)
        xi = tangent_error(result.T_k_prev, scene.T)
        nees.append(xi @ result.information @ xi)
    assert 4.5 < np.mean(nees) < 8


def test_modelled_errors_are_estimated_better_by_their_own_likelihood():
    errors = {e.name: [] for e in ESTIMATORS}
    for seed in range(30):
        scene = scene_of(100 + seed, n=300, likelihood=MODEL)
        for estimator in ESTIMATORS:
            T = estimator.estimate(scene.known_depth, seed=seed).T_k_prev
            errors[estimator.name].append(np.linalg.norm(T.translation - scene.T.translation))
    medians = {name: np.median(e) for name, e in errors.items()}
    assert medians["lcmsac"] < medians["ransac"]
    assert medians["mle"] < medians["lcmsac"]


@every_estimator
@both_residuals
def test_too_few_vectors_are_no_exception(estimator, kind):
    minimal = (ThreePoint if kind == "known_depth" else FivePoint).minimal
    for n in (0, minimal - 1):
        result = estimator.estimate(getattr(scene_of(7, n=n), kind))
        assert (result.status, result.solved) == (Status.TOO_FEW, False)
        assert result.reason == f"{n} flow vectors, {minimal} needed"
        np.testing.assert_array_equal(result.information, 0)
    assert estimator.estimate(getattr(scene_of(7, n=minimal + 15), kind)).status is not Status.TOO_FEW


@every_estimator
def test_points_without_depth_leave_too_few(estimator):
    scene = scene_of(8, n=30)
    depth = np.where(np.arange(30) < 28, [np.nan, 0.0, np.inf] * 10, 5.0)
    result = estimator.estimate(KnownDepth.of(scene.measurements, CAMERA, depth))
    assert result.status is Status.TOO_FEW
    assert result.excluded["no depth"] == 28


@every_estimator
def test_one_pixel_repeated_is_degenerate(estimator):
    scene = scene_of(9, n=10)
    repeated = scene.measurements.select(np.zeros(50, int))
    result = estimator.estimate(KnownDepth.of(repeated, CAMERA, np.full(50, 3.0)))
    assert (result.status, result.solved) == (Status.DEGENERATE, False)
    assert result.reason


@every_estimator
def test_two_distinct_points_are_degenerate(estimator):
    scene = scene_of(9, n=10)
    repeated = scene.measurements.select(np.repeat([0, 1], 25))
    result = estimator.estimate(KnownDepth.of(repeated, CAMERA, np.repeat(scene.depth[:2], 25)))
    assert result.status is Status.DEGENERATE


@every_estimator
def test_a_pure_rotation_has_no_epipolar_direction(estimator):
    rng = np.random.default_rng(17)
    scene = make_scene(random_motion(rng, 3.0, 0.0), rng, n=400, likelihood=MODEL)
    result = estimator.estimate(scene.epipolar)
    assert result.status in (Status.AMBIGUOUS, Status.DEGENERATE)
    assert result.reason


def still(scene):
    m = scene.measurements
    flow = np.random.default_rng(0).normal(0, 0.03, m.flow.shape)
    return Measurements(m.pixels, flow, m.R_i_e, m.t, m.texture, m.method)


@every_estimator
def test_a_standstill_has_no_epipolar_direction(estimator):
    scene = scene_of(10)
    result = estimator.estimate(Epipolar.of(still(scene), CAMERA))
    assert (result.status, result.solved) == (Status.STILL, True)
    np.testing.assert_array_equal(result.T_k_prev.as_matrix(), np.eye(4))
    with_depth = estimator.estimate(KnownDepth.of(still(scene), CAMERA, scene.depth))
    assert with_depth.status is Status.SOLVED
    assert np.linalg.norm(with_depth.T_k_prev.translation) < 0.01


@pytest.mark.parametrize(
    "make",
    [
        lambda gate: ransac(gate=gate),
        lambda gate: lcmsac(MODEL, gate=gate),
        lambda gate: mle(MODEL, gate=gate),
    ],
)
@both_residuals
def test_the_texture_gate_drops_components(make, kind):
    scene = scene_of(11, n=800, likelihood=MODEL)
    texture = scene.measurements.t
    result = make(50.0).estimate(getattr(scene, kind))
    assert result.excluded["texture gate"] == (texture < 50).sum()
    kept = (texture >= 50).ravel() if kind == "known_depth" else (texture >= 50).any(axis=1)
    assert result.components == (kept & informative(make(None), getattr(scene, kind), result)).sum()
    assert result.solved
    assert make(None).estimate(getattr(scene, kind)).excluded["texture gate"] == 0
    assert make(1e9).estimate(getattr(scene, kind)).status is Status.TOO_FEW


def test_gated_components_do_not_matter():
    scene = scene_of(12, n=400, likelihood=MODEL)
    m = scene.measurements
    z = m.errors(np.zeros_like(m.flow)) + np.where(m.t < 50, 30.0, 0.0)
    wrong = Measurements(m.pixels, np.einsum("nij,nj->ni", m.R_i_e, z), m.R_i_e, m.t, m.texture, m.method)
    estimator = mle(MODEL, gate=50.0)
    first = estimator.estimate(scene.known_depth)
    second = estimator.estimate(KnownDepth.of(wrong, CAMERA, scene.depth))
    np.testing.assert_allclose(first.T_k_prev.as_matrix(), second.T_k_prev.as_matrix(), atol=1e-12)
    assert not np.allclose(
        mle(MODEL).estimate(KnownDepth.of(wrong, CAMERA, scene.depth)).T_k_prev.as_matrix(),
        first.T_k_prev.as_matrix(),
        atol=1e-9,
    )


def test_the_share_outside_the_models_range_is_told():
    scene = scene_of(13, n=400)
    texture = scene.measurements.t
    result = lcmsac(MODEL).estimate(scene.known_depth)
    knots = np.exp(MODEL.schedule.knots)
    assert result.outside == np.mean((texture < knots[0]) | (texture > knots[-1]))


def test_a_start_brings_large_motions_within_reach():
    rng = np.random.default_rng(14)
    T = random_motion(rng, 12.0, 0.5)
    scene = make_scene(T, rng, n=300)
    result = ransac().estimate(scene.known_depth, start=random_motion(rng, 1.0, 0.1) * T)
    np.testing.assert_allclose(result.T_k_prev.as_matrix(), T.as_matrix(), atol=1e-5)


def test_few_hypotheses_suffice_when_all_agree():
    scene = scene_of(15, n=300)
    assert ransac().estimate(scene.known_depth).hypotheses <= 50  # one batch
    assert Estimator("short", MODEL, most_hypotheses=7).estimate(scene.known_depth).hypotheses <= 7
    noisy = scene_of(15, n=300, outliers=0.8)
    # ln 0.01 / ln(1 - 0.2^3) = 573 draws for one good sample, with probability 0.99
    assert 400 <= ransac().estimate(noisy.known_depth).hypotheses <= 800


def test_a_model_of_another_flow_is_refused():
    model = lcm_likelihood(method={"name": "farneback"})
    with pytest.raises(ModelError, match="farneback"):
        lcmsac(model).estimate(scene_of(16, n=20).known_depth)


@pytest.mark.parametrize("make", [lcmsac, mle])
def test_without_depth_wide_components_do_not_pull(make):
    """Lost tracks know that they are wide; all short alike, they would pull the direction together."""
    scene = scene_of(13, n=900, likelihood=MODEL)
    m = scene.measurements
    lost = MODEL.bound(INDEX.of(m), 0.9).min(axis=1) > 2
    assert 0.05 < lost.mean() < 0.6
    short = Measurements(
        m.pixels, m.flow * np.where(lost, 0.2, 1.0)[:, None], m.R_i_e, m.t, m.texture, m.method
    )
    first = make(MODEL).estimate(scene.epipolar)
    second = make(MODEL).estimate(Epipolar.of(short, CAMERA))
    np.testing.assert_allclose(first.T_k_prev.as_matrix(), second.T_k_prev.as_matrix(), atol=2e-5)
