from itertools import pairwise

import numpy as np
import pytest
from scipy import stats
from scipy.integrate import quad

from flowlik.errors import ModelError
from flowlik.flow import Farneback, LucasKanade, describe
from flowlik.image.texture import TextureDefinition
from flowlik.likelihood.families import FAMILIES
from flowlik.likelihood.likelihood import FlowLikelihood
from flowlik.likelihood.schedule import Index, Schedule
from flowlik.measurement.measurements import attach_texture
from tests.helpers import KNOTS, LCM_VALUES, lcm_likelihood, textured_image

VALUES = {
    "lcm": LCM_VALUES,
    "log-logistic": np.array([[1.0, 0.3, 0.1, 0.03], [1.1, 1.5, 2.2, 1.4]]),
    "gaussian": np.array([[3.0, 1.0, 0.3, 0.05]]),
    "laplace": np.array([[3.0, 1.0, 0.3, 0.05]]),
    "student-t": np.array([[1.0, 0.3, 0.1, 0.03], [0.6, 1.0, 1.5, 2.5]]),
    "glc": np.array(
        [
            [0.4, 0.15, 0.05, 0.02],
            [1.0, 0.5, 0.15, 0.06],
            [3.0, 2.0, 0.8, 0.3],
            [0.1, 0.2, 0.3, 0.3],
            [0.4, 0.6, 0.7, 0.6],
        ]
    ),
}
MODELS = [FlowLikelihood(family, Schedule(Index(), KNOTS, VALUES[n])) for n, family in FAMILIES.items()]
every_model = pytest.mark.parametrize("model", MODELS, ids=list(FAMILIES))
LEVELS = np.array([-3.0, -1.0, 0.7, 3.3, 6.0, 9.0])  # between the knots, and beyond both ends


@every_model
def test_the_core_is_the_family_at_the_schedules_parameters(model):
    z, x = np.linspace(-4, 4, 41)[:, None], LEVELS
    theta = np.stack([np.interp(x, KNOTS, row) for row in model.schedule.values])
    np.testing.assert_allclose(model.log_prob(z, x), model.family.logpdf(z, theta), rtol=1e-12)
    np.testing.assert_allclose(model.cdf(z, x), model.family.cdf(z, theta), rtol=1e-12)
    np.testing.assert_allclose(model.score(z, x), model.family.gradient(z, theta)[0], rtol=1e-12)


@every_model
@pytest.mark.parametrize("confidence", [0.5, 0.9, 0.99])
def test_bounds_cover_their_share_of_samples_at_every_level(model, confidence):
    n = 20_000
    for x in LEVELS:
        z = model.sample(np.full(n, x), np.random.default_rng(3))
        inside = int((np.abs(z) <= model.bound(x, confidence)).sum())
        assert stats.binomtest(inside, n, confidence).pvalue > 1e-4


@every_model
def test_bounds_between_nodes_are_solved_not_interpolated_from_the_knots(model):
    x = np.random.default_rng(0).uniform(KNOTS[0], KNOTS[-1], 300)
    share = model.family.magnitude_cdf(model.bound(x, 0.9), model.schedule.theta(x))
    np.testing.assert_allclose(share, 0.9, atol=2e-4)


@pytest.mark.parametrize("confidence", [0.0, 1.0, -0.1, 90, np.nan])
def test_an_impossible_confidence_is_refused(confidence):
    with pytest.raises(ModelError, match="confidence"):
        MODELS[0].bound(0.0, confidence)


@every_model
def test_fisher_information_is_the_mean_square_of_the_score(model):
    pieces = np.log([1e-8, 1e-4, 1e-2, 0.1, 1, 10, 1e3, 1e6])
    for x in LEVELS:

        def square(s, x=x):
            z = np.exp(s)
            return 2 * z * model.score(z, x) ** 2 * np.exp(model.log_prob(z, x))

        expected = sum(quad(square, a, b)[0] for a, b in pairwise(pieces))
        assert model.fisher(x) == pytest.approx(expected, rel=2e-3)


@pytest.mark.parametrize("model", [MODELS[0], MODELS[2]], ids=["lcm", "gaussian"])
def test_fisher_information_agrees_with_monte_carlo(model):
    x = np.full(200_000, 2.5)
    square = model.score(model.sample(x, np.random.default_rng(5)), x) ** 2
    assert model.fisher(2.5) == pytest.approx(square.mean(), abs=4 * square.std() / np.sqrt(len(x)))


def test_the_gaussians_fisher_information_is_its_inverse_variance():
    assert FlowLikelihood.constant_gaussian(0.5).fisher(3.0) == pytest.approx(4, rel=1e-6)


@every_model
def test_weights_are_minus_score_over_error_and_never_negative(model):
    x = LEVELS[:, None]
    floor = 0.1 * model.family.magnitude_ppf(0.5, model.schedule.theta(x))
    z = floor * np.geomspace(1.01, 1e4, 200)
    z[:, ::2] *= -1
    np.testing.assert_allclose(model.weight(z, x), np.maximum(-model.score(z, x) / z, 0), rtol=1e-9)
    np.testing.assert_allclose(model.weight(0 * floor, x), model.weight(floor, x), rtol=1e-12)
    np.testing.assert_array_equal(model.weight(-z, x), model.weight(z, x))
    assert np.isfinite(model.weight(0 * floor, x)).all()


@every_model
def test_samples_follow_the_density_at_their_own_coordinates(model):
    x = np.random.default_rng(0).uniform(KNOTS[0] - 1, KNOTS[-1] + 1, 20_000)
    z = model.sample(x, np.random.default_rng(1))
    assert stats.kstest(model.cdf(z, x), "uniform").statistic < 1.63 / np.sqrt(len(x))


@pytest.fixture(scope="module")
def measured():
    image = textured_image((40, 50))
    pixels = np.array([[10.0, 10], [20, 30], [33, 21]])
    return attach_texture(image, pixels, np.zeros((3, 2)), Farneback())


def test_coordinates_of_measurements_are_of_their_texture(measured):
    model = lcm_likelihood(method=describe(Farneback()))
    np.testing.assert_allclose(model.coordinate(measured), np.log(measured.t), rtol=1e-12)


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"method": describe(LucasKanade())}, "lucas-kanade"),
        ({"method": describe(Farneback(window=15))}, "farneback"),
        ({"method": describe(Farneback()), "texture": TextureDefinition(window=7)}, "window=7"),
    ],
)
def test_a_model_of_another_flow_or_texture_is_refused(measured, fields, message):
    with pytest.raises(ModelError, match=message):
        lcm_likelihood(**fields).coordinate(measured)


def test_a_model_of_any_flow_fits_all_measurements(measured):
    FlowLikelihood.constant_gaussian(0.5).check(measured)


def test_parameters_out_of_bounds_make_no_model():
    with pytest.raises(ModelError, match="sigma leaves its bounds"):
        FlowLikelihood.constant_gaussian(-1.0)
