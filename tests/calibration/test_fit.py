import numpy as np
import pytest
from scipy.optimize import minimize

from flowlik.calibration import ErrorSketch, fit
from flowlik.calibration._fit import place_knots
from flowlik.errors import CalibrationError
from flowlik.evaluation.likelihood import Counting, kolmogorov_smirnov, negative_log_likelihood
from flowlik.likelihood.families import FAMILIES
from flowlik.likelihood.likelihood import FlowLikelihood
from flowlik.likelihood.schedule import Index, Schedule
from tests.helpers import KNOTS, finite_difference, lcm_likelihood
from tests.likelihood.test_likelihood import MODELS, every_model

INDEX = Index()


def draw(model, n: int, seed: int = 0):
    """Coordinates evenly over the knots, and errors drawn from a model."""
    rng = np.random.default_rng(seed)
    x = rng.uniform(KNOTS[0], KNOTS[-1], n)
    return x, model.sample(x, rng)


def sketch_of(x, z) -> ErrorSketch:
    return ErrorSketch.of(INDEX, {"texture": np.exp(x)}, z, np.ones(len(z)), np.random.default_rng(0))


@every_model
def test_a_known_table_is_recovered_from_its_own_samples(model):
    x, z = draw(model, 400_000)
    sketch = sketch_of(x, z)
    schedule, convergence = fit(sketch, model.family, KNOTS)
    fitted = FlowLikelihood(model.family, schedule)
    ks = kolmogorov_smirnov(sketch, fitted, Counting(5_000, 1))
    assert ks.counted.sum() >= 30
    # 2.2 / sqrt(n) is exceeded by one level in ten thousand
    assert (ks.statistic[ks.counted] < 2.2 / np.sqrt(ks.counts[ks.counted]) + 2e-3).all()
    excess = np.mean(model.log_prob(z, x) - fitted.log_prob(z, x))
    assert -1e-4 < excess < 1e-5
    assert convergence["nll"] == pytest.approx(negative_log_likelihood(sketch, fitted), abs=1e-9)
    np.testing.assert_allclose(schedule.theta(KNOTS[1:3]), model.schedule.theta(KNOTS[1:3]), rtol=0.1)


@every_model
def test_the_fit_ends_where_the_gradient_vanishes(model):
    family = model.family
    sketch = sketch_of(*draw(model, 50_000))
    schedule, convergence = fit(sketch, family, KNOTS, smoothing=0.0)

    def nll(flat):
        values = family.to_theta(flat.reshape(schedule.values.shape))
        return negative_log_likelihood(sketch, FlowLikelihood(family, Schedule(INDEX, KNOTS, values)))

    numeric = finite_difference(nll, family.to_free(schedule.values).ravel(), 1e-4)
    assert np.abs(numeric).max() < 2e-5
    assert convergence["gradient"] < 2e-5


@pytest.mark.parametrize("model", MODELS, ids=list(FAMILIES))
def test_the_sketch_loses_nothing_against_a_fit_of_raw_samples(model):
    family, knots = model.family, np.array([KNOTS[0], 3.0, KNOTS[-1]])
    x, z = draw(model, 20_000)

    def raw(flat):
        values = family.to_theta(flat.reshape(len(family.parameters), 3))
        theta = np.stack([np.interp(x, knots, row) for row in values])
        return -family.logpdf(z, theta).mean()

    schedule, _ = fit(sketch_of(x, z), family, knots)
    start = family.to_free(model.schedule.theta(knots)).ravel()
    best = minimize(raw, start, method="BFGS", options={"gtol": 1e-5}).fun
    assert raw(family.to_free(schedule.values).ravel()) - best == pytest.approx(0, abs=1e-3)


def test_knots_span_all_but_the_outermost_components():
    x = np.random.default_rng(0).normal(3, 1, 200_000)
    knots = place_knots(sketch_of(x, np.ones(len(x))), knots=7)
    width = np.log(10) / 32
    np.testing.assert_allclose(np.diff(knots), (knots[-1] - knots[0]) / 6)
    assert knots[0] <= np.quantile(x, 5e-4) <= knots[0] + 1.1 * width
    assert knots[-1] - 1.1 * width <= np.quantile(x, 1 - 5e-4) <= knots[-1]


def test_smoothing_keeps_knots_of_rare_data_close_to_their_neighbours():
    model = lcm_likelihood()
    rng = np.random.default_rng(0)
    x = np.concatenate([rng.uniform(2, 4, 50_000), rng.uniform(4, 7, 20)])
    sketch = sketch_of(x, model.sample(x, rng))
    jumps = []
    for smoothing in (1e-5, 0.0):
        schedule, _ = fit(sketch, model.family, np.linspace(2, 7, 6), smoothing)
        jumps.append(np.abs(np.diff(model.family.to_free(schedule.values), axis=1)).max())
    assert jumps[0] < 2 < jumps[1]


def test_too_few_components_are_refused():
    with pytest.raises(CalibrationError, match="999 error components are too few"):
        fit(sketch_of(*draw(MODELS[0], 999)), MODELS[0].family)


def test_a_constant_texture_is_refused():
    with pytest.raises(CalibrationError, match="one texture"):
        fit(sketch_of(np.full(5000, 2.0), np.random.default_rng(0).normal(size=5000)), MODELS[0].family)
