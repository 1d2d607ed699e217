import dataclasses

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

from flowlik.egomotion import KnownDepth, lcmsac, log_prob
from flowlik.egomotion.epipolar import five_point
from flowlik.egomotion.residual import Chosen, equations_of
from flowlik.errors import DataError, ModelError
from flowlik.geometry import motion
from flowlik.geometry.motion import exp_se3
from flowlik.likelihood.schedule import Index
from flowlik.support import threads
from tests.helpers import (
    CAMERA,
    finite_difference,
    lcm_likelihood,
    make_scene,
    normalised,
    random_motion,
    support_bounds,
)

MODEL = lcm_likelihood()
INDEX = Index()


@pytest.fixture(params=range(3))
def scene(request):
    rng = np.random.default_rng(request.param)
    return make_scene(random_motion(rng), rng, n=80, likelihood=MODEL)


@pytest.fixture
def near(scene):
    """A motion near the scene's, and its matrix (3, 4)."""
    T = random_motion(np.random.default_rng(9), 0.2, 0.02) * scene.T
    return T, T.as_matrix()[:3]


def rho_of(scene):
    return motion.inverse_range(CAMERA, scene.measurements.pixels, scene.depth)


def moved(residual, T, xi):
    return residual.at((motion.exp_se3(xi) * T).as_matrix()[:3], INDEX).z


def test_errors_of_known_depth_agree_with_the_theory(scene, near):
    T, matrix = near
    _, z, J, *_ = scene.known_depth.at(matrix, INDEX)
    m, rho = scene.measurements, rho_of(scene)
    expected = m.errors(motion.h(T, CAMERA, m.pixels, rho)).ravel()
    np.testing.assert_allclose(z, expected, atol=1e-9)
    by_flow = -np.einsum("nij,nik->njk", m.R_i_e, motion.h_jacobian(T, CAMERA, m.pixels, rho))
    np.testing.assert_allclose(J, by_flow.reshape(-1, 6), rtol=1e-9, atol=1e-9)
    x = scene.known_depth.at(matrix, INDEX).x
    np.testing.assert_allclose(x, np.log(m.t).ravel(), rtol=1e-12)
    numeric = finite_difference(lambda xi: moved(scene.known_depth, T, xi), np.zeros(6), 1e-6)
    np.testing.assert_allclose(J, numeric, rtol=1e-5, atol=1e-5)


def test_epipolar_errors_agree_with_the_theory(scene, near):
    T, matrix = near
    unit = normalised(scene.epipolar, matrix)
    _, z, J, *_ = scene.epipolar.at(unit, INDEX)
    m = scene.measurements
    expected, normal, jacobian = motion.epipolar_error(T, CAMERA, m.pixels, m.flow)
    np.testing.assert_allclose(z, expected, atol=1e-9)
    np.testing.assert_allclose(J, jacobian, rtol=1e-9, atol=1e-9)
    x = scene.epipolar.at(unit, INDEX).x
    np.testing.assert_allclose(x, INDEX.along(m, normal), atol=1e-9)
    T_unit = RigidTransform.from_matrix(np.vstack([unit, [0, 0, 0, 1]]))
    numeric = finite_difference(lambda xi: moved(scene.epipolar, T_unit, xi), np.zeros(6), 1e-6)
    np.testing.assert_allclose(J, numeric, rtol=1e-4, atol=1e-3)


def test_the_epipolar_basis_leaves_out_the_scale(scene, near):
    unit = normalised(scene.epipolar, near[1])
    assert np.linalg.norm(unit[:, 3]) == pytest.approx(1)
    basis = scene.epipolar.at(unit, INDEX).basis
    np.testing.assert_allclose(basis.T @ basis, np.eye(5), atol=1e-12)
    np.testing.assert_allclose(basis[3:].T @ unit[:, 3], 0, atol=1e-12)


def test_points_behind_the_camera_have_no_error(scene):
    turned = motion.exp_se3(np.array([0, np.pi, 0, 0, 0, 0])).as_matrix()[:3]
    _, z, J, *_ = scene.known_depth.at(turned, INDEX)
    assert np.isnan(z).all()
    np.testing.assert_array_equal(J, 0)


@pytest.fixture
def hypotheses(scene):
    rng = np.random.default_rng(11)
    return [random_motion(rng, 0.1 * k, 0.01 * k) * scene.T for k in range(8)]


@pytest.fixture
def kept(scene):
    return scene.measurements.t > 2.0


def test_scores_of_known_depth_count_inliers(scene, hypotheses, kept):
    residual = scene.known_depth
    matrices = np.array([T.as_matrix()[:3] for T in hypotheses])
    m, rho = scene.measurements, rho_of(scene)
    z = np.array([m.errors(motion.h(T, CAMERA, m.pixels, rho)) for T in hypotheses])
    x = np.log(m.t)

    bounds = support_bounds(residual, lambda x: MODEL.bound(x, 0.9), INDEX, kept)
    inliers = (np.abs(z) <= MODEL.bound(x, 0.9)) & kept
    np.testing.assert_array_equal(
        residual.sampling.support(matrices, bounds, False), inliers.sum(axis=(1, 2))
    )

    bounds = support_bounds(residual, lambda x: np.full(x.shape, 0.5), INDEX, kept)
    length = np.linalg.norm(np.where(kept, z, 0), axis=2)
    expected = ((length <= 0.5) & kept.any(axis=1)).sum(axis=1)
    np.testing.assert_array_equal(residual.sampling.support(matrices, bounds, True), expected)
    assert len(set(expected)) > 3


def test_scores_of_the_epipolar_residual_count_inliers(scene, hypotheses, kept):
    residual, m = scene.epipolar, scene.measurements
    essentials = np.array([motion.essential_matrix(T) for T in hypotheses])
    errors = [motion.epipolar_error(T, CAMERA, m.pixels, m.flow)[:2] for T in hypotheses]
    used = kept.any(axis=1)

    constant = support_bounds(residual, lambda x: np.full(x.shape, 0.5), INDEX, kept)
    expected = [((np.abs(z) <= 0.5) & used).sum() for z, _ in errors]
    np.testing.assert_array_equal(residual.sampling.support(essentials, constant, False), expected)
    assert len(set(expected)) > 3

    bounds = support_bounds(residual, lambda x: MODEL.bound(x, 0.9), INDEX, kept)
    exact = [((np.abs(z) <= MODEL.bound(INDEX.along(m, n), 0.9)) & used).sum() for z, n in errors]
    # bounds are interpolated between 17 directions of the normal
    np.testing.assert_allclose(residual.sampling.support(essentials, bounds, False), exact, atol=2)


@pytest.mark.parametrize("kind", ["known_depth", "epipolar"])
def test_scores_do_not_depend_on_the_number_of_threads(scene, monkeypatch, kind):
    rng = np.random.default_rng(12)
    motions = [random_motion(rng, 1.0, 0.1) * scene.T for _ in range(90)]
    form = motion.essential_matrix if kind == "epipolar" else (lambda T: T.as_matrix()[:3])
    hypotheses = np.array([form(T) for T in motions])
    residual = getattr(scene, kind)
    everything = np.ones((len(residual), 2), bool)
    bounds = support_bounds(residual, lambda x: MODEL.bound(x, 0.9), INDEX, everything)
    counts = []
    for number in (1, 2):
        monkeypatch.setattr(threads, "THREADS", number)
        counts.append(residual.sampling.support(hypotheses, bounds, False))
    one_by_one = [residual.sampling.support(h[None], bounds, False)[0] for h in hypotheses]
    np.testing.assert_array_equal(counts, [one_by_one] * 2)


@pytest.mark.parametrize("degrees", [0.0, 1.0, 5.0, 15.0])
def test_three_points_give_the_motion_exactly(degrees):
    rng = np.random.default_rng(3)
    T = random_motion(rng, degrees, 0.3)
    residual = make_scene(T, rng, n=300).known_depth
    samples = np.array([rng.choice(300, 3, replace=False) for _ in range(100)])
    solutions = [residual.sampling.propose(sample[None], np.eye(4)[:3]) for sample in samples]
    solved = [(sample, motions[0]) for sample, motions in zip(samples, solutions) if len(motions)]
    assert len(solved) >= (95 if degrees < 10 else 85)
    error = [np.abs(matrix - T.as_matrix()[:3]).max() for _, matrix in solved]
    assert np.median(error) < 1e-9
    for sample, matrix in solved:  # sometimes another motion explains the three points
        _, z, *_ = residual.at(matrix, INDEX)
        assert np.abs(z.reshape(-1, 2)[sample]).max() < 1.5e-6


def test_three_points_on_one_ray_have_no_solution():
    scene = make_scene(random_motion(np.random.default_rng(0)), np.random.default_rng(1), n=6)
    one = scene.measurements.select(np.zeros(6, int))
    residual = KnownDepth.of(one, CAMERA, np.full(6, 4.0))
    assert len(residual.sampling.propose(np.array([[0, 1, 2], [3, 4, 5]]), np.eye(4)[:3])) == 0


def test_five_points_give_the_essential_matrix_among_others():
    rng = np.random.default_rng(5)
    scene = make_scene(random_motion(rng, 3, 0.5), rng, n=50)
    truth = motion.essential_matrix(scene.T)
    found = 0
    for _ in range(20):
        sample = rng.choice(50, 5, replace=False)
        solutions = scene.epipolar.sampling.propose(sample[None], np.eye(4)[:3])
        scaled = solutions / np.linalg.norm(solutions, axis=(1, 2), keepdims=True) * np.sqrt(2)
        error = min(min(np.abs(E - truth).max(), np.abs(E + truth).max()) for E in scaled)
        found += error < 1e-5
    assert found >= 19


def test_five_points_without_a_solution_give_none():
    assert five_point(np.full((5, 2), np.nan), np.zeros((5, 2))).shape[1:] == (3, 3)


@pytest.mark.parametrize("as_map", [False, True])
def test_points_without_depth_are_left_out_and_counted(as_map):
    scene = make_scene(random_motion(np.random.default_rng(0)), np.random.default_rng(1), n=40)
    depth = scene.depth.copy()
    depth[:5] = [np.nan, 0, -1, np.inf, -np.inf]
    if as_map:
        grid = np.full((CAMERA.height, CAMERA.width), np.nan)
        column, row = np.rint(scene.measurements.pixels).astype(int).T
        grid[row, column] = depth
        depth = grid
    residual = KnownDepth.of(scene.measurements, CAMERA, depth)
    assert residual.excluded == {"no depth": 5, "no flow": 0}
    assert len(residual) == 35
    np.testing.assert_array_equal(residual.measurements.pixels, scene.measurements.pixels[5:])
    np.testing.assert_allclose(residual.rho, rho_of(scene)[5:], rtol=1e-12)


@pytest.mark.parametrize(
    ("shape", "message"),
    [
        ((480, 641), "641x480 for a camera of 640x480"),
        ((480, 640, 1), "40 measurements"),
        ((39,), "40 measurements"),
    ],
)
def test_depth_of_a_wrong_size_is_refused(shape, message):
    scene = make_scene(random_motion(np.random.default_rng(0)), np.random.default_rng(1), n=40)
    with pytest.raises(DataError, match=message):
        KnownDepth.of(scene.measurements, CAMERA, np.ones(shape))


def test_the_motion_of_an_essential_matrix_has_its_points_in_front(scene):
    E = motion.essential_matrix(scene.T)
    everything = np.ones(len(scene.epipolar), bool)
    for signed in (E, -E):
        T = scene.epipolar.sampling.resolve(signed, lambda T: everything)
        np.testing.assert_allclose(T, normalised(scene.epipolar, scene.T.as_matrix()[:3]), atol=1e-9)


@pytest.mark.parametrize("widened", [1.0, 3.0])
def test_one_pass_gives_the_equations_of_the_linearised_errors(widened):
    model, rng = lcm_likelihood(), np.random.default_rng(20)
    scene = make_scene(random_motion(rng), rng, n=200, likelihood=model)
    residual = scene.known_depth
    # a motion that puts some points behind the camera
    T = exp_se3(np.array([0.0, 0.0, 0.0, 0.1, 0.0, -4.0])).as_matrix()[:3]
    x, tables = residual.at(T, model.schedule.index).x, model.compiled
    used = rng.random(400) < 0.8
    chosen = Chosen(used, tables.rows(x), model.fisher(x), tables)
    errors = residual.at(T, INDEX)
    found = residual.equations(T, chosen, widened)
    expected = equations_of(errors.z, errors.J, errors.basis, chosen, widened)
    assert found.lost == expected.lost > 0
    for a, b in zip(found[:3], expected[:3]):
        np.testing.assert_allclose(a, b, rtol=1e-9, atol=1e-9 * np.abs(b).max())


@pytest.mark.parametrize("as_map", [False, True])
@pytest.mark.parametrize("shift", [CAMERA.width, -CAMERA.width, np.nan])
def test_measurements_outside_the_image_are_refused(as_map, shift):
    scene = make_scene(random_motion(np.random.default_rng(21)), np.random.default_rng(21), n=20)
    m = scene.measurements
    beside = dataclasses.replace(m, pixels=m.pixels + np.array([shift, 0]))
    depth = np.full((CAMERA.height, CAMERA.width) if as_map else 20, 3.0)
    with pytest.raises(DataError, match="20 measurements lie outside the image of 640x480"):
        KnownDepth.of(beside, CAMERA, depth)


@pytest.mark.parametrize("kind", ["known_depth", "epipolar"])
def test_the_total_score_is_the_gradient_within_bounds(scene, near, kind):
    residual = getattr(scene, kind)
    T = normalised(residual, near[1])
    likelihood = lcm_likelihood()
    x, tables = residual.at(T, likelihood.schedule.index).x, likelihood.compiled
    bounds = likelihood.bound(x, 0.9)
    used = np.arange(len(x)) % 3 > 0
    held = Chosen(used, tables.rows(x), likelihood.fisher(x), tables)
    other = residual.retract(T, np.array([1e-3, -2e-3, 1e-3, 0.01, 0.02, -0.01]))
    found = residual.total_scores(np.array([T, other]), held, bounds)
    for moved, score in zip((T, other), found):
        z = residual.at(moved, INDEX).z
        within = held._replace(used=used & (np.abs(z) <= bounds))
        expected = residual.equations(moved, within).b
        np.testing.assert_allclose(score, expected, rtol=1e-9, atol=1e-9 * np.abs(expected).max())


def test_a_model_of_errors_across_lines_serves_these_alone():
    rng = np.random.default_rng(9)
    scene = make_scene(random_motion(rng, 1.0, 0.5), rng, likelihood=lcm_likelihood())
    model = lcm_likelihood(residual="epipolar")
    assert lcmsac(model).estimate(scene.epipolar).solved
    for use in (lcmsac(model).estimate, lambda residual: log_prob(model, residual, scene.T)):
        with pytest.raises(ModelError, match="across epipolar lines alone"):
            use(scene.known_depth)
    assert np.isfinite(log_prob(model, scene.epipolar, scene.T).value)
