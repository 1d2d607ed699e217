import numpy as np
import pytest

from flowlik.calibration import (
    SCHEDULES,
    ErrorSketch,
    IndexForm,
    fit_likelihood,
    index_form,
    schedule_index,
)
from flowlik.calibration._learn import Rows, _fit_weights, learn_index
from flowlik.errors import CalibrationError
from flowlik.evaluation.likelihood import coverage, negative_log_likelihood
from flowlik.flow import Farneback, LucasKanade
from flowlik.likelihood.families import FAMILIES
from flowlik.likelihood.schedule import Index

NAMES = ("texture", "discrepancy", "residual")
FORM = IndexForm(NAMES, products=False)


def drawn(n: int, seed: int = 0, curved: float = 0.0):
    """Laplace errors whose scale is a product of powers of three covariates, or bends with the second."""
    rng = np.random.default_rng(seed)
    ln = rng.normal([3.0, -2.0, 1.0], [1.5, 1.0, 0.5], (n, 3))
    scale = np.exp(-0.4 * ln[:, 0] + 0.7 * ln[:, 1] + 0.2 * ln[:, 2] + curved * (ln[:, 1] + 2) ** 2)
    z = rng.laplace(scale=scale)
    return dict(zip(NAMES, np.exp(ln.T))), z, scale


def sketch(n: int, seed: int = 0, curved: float = 0.0) -> ErrorSketch:
    covariates, z, _ = drawn(n, seed, curved)
    return ErrorSketch.of(Index(), covariates, z, np.ones(n), np.random.default_rng(seed))


@pytest.fixture(scope="module")
def rows() -> Rows:
    covariates, z, _ = drawn(40_000)
    return Rows(covariates, z)


@pytest.mark.parametrize("family", ["laplace", "lcm"])
def test_known_weights_are_found(rows, family):
    index = learn_index(rows, FAMILIES[family], NAMES)
    weights = {term.covariates[0]: term.weight for term in index.terms}
    np.testing.assert_allclose([weights[name] for name in NAMES], [-0.4, 0.7, 0.2], atol=0.02)


def test_x_is_about_the_logarithm_of_the_error(rows):
    index = learn_index(rows, FAMILIES["laplace"], NAMES)
    x = index.combine(rows.covariates)
    slope, offset = np.polyfit(x, np.log(np.maximum(np.abs(rows.z), 1e-4)), 1)
    assert (slope, offset) == pytest.approx((1, 0), abs=1e-6)
    assert index.low < x.min() and x.max() < index.high


def test_products_find_what_bends(rows):
    covariates, z, scale = drawn(40_000, curved=0.15)
    curved = Rows(covariates, z)
    straight, bent = (learn_index(curved, FAMILIES["laplace"], NAMES, products) for products in (False, True))
    misfit = [np.std(index.combine(covariates) - np.log(scale)) for index in (straight, bent)]
    assert misfit[1] < 0.25 * misfit[0]
    assert len(bent.terms) == 3 + 6


def test_the_gradient_is_the_objectives_derivative(monkeypatch, rows):
    caught = {}

    def stop(objective, start, rows, **options):
        caught.update(objective=lambda flat: objective(flat, *rows), start=start)
        raise StopIteration

    monkeypatch.setattr("flowlik.calibration._learn.minimize", stop)
    phi = np.log(np.stack([rows.covariates[name] for name in NAMES], axis=1))[:3000]
    phi = (phi - phi.mean(axis=0)) / phi.std(axis=0)
    with pytest.raises(StopIteration):
        _fit_weights(phi, rows.z[:3000], FAMILIES["lcm"], 1e-5)
    at = caught["start"] + 0.03 * np.random.default_rng(0).standard_normal(len(caught["start"]))
    _, gradient = caught["objective"](at)
    for i in (0, 7, 25, 45, 59, len(at) - 3, len(at) - 1):
        step = 1e-5 * np.eye(len(at))[i]
        numeric = (caught["objective"](at + step)[0] - caught["objective"](at - step)[0]) / 2e-5
        assert gradient[i] == pytest.approx(numeric, abs=2e-6)


def test_a_learned_index_beats_texture_on_data_it_has_not_seen():
    mine, other = sketch(40_000, 0), sketch(40_000, 1)
    nll = {}
    for schedule in ("texture", "index"):
        index = schedule_index(schedule, [[mine]], FORM)
        model = fit_likelihood([mine.over(index)], FAMILIES["laplace"], LucasKanade())
        assert model.schedule.name == schedule
        nll[schedule] = negative_log_likelihood(other.over(index), model)
        assert coverage(other.over(index), model, 0.9) == pytest.approx(0.9, abs=0.02)
    # the scale's own entropy: what is left of ln scale once texture is known
    assert nll["texture"] - nll["index"] > 0.1


def test_what_lies_beyond_the_calibrated_range_is_clipped_to_it(rows):
    index = learn_index(rows, FAMILIES["laplace"], NAMES)
    extreme = {name: np.array([0.0, np.inf]) for name in NAMES}
    edges = {i.covariate: np.array([i.low, i.high]) for i in index.inputs}
    np.testing.assert_allclose(index.combine(extreme), index.combine(edges))
    assert np.isfinite(index.combine(extreme)).all()


def test_populations_count_alike():
    rows = Rows.of([sketch(30_000, 0), sketch(3_000, 1)], most=3_000)
    assert len(rows.z) == 6_000


def test_schedules_by_name():
    blocks = [[sketch(3_000)]]
    assert schedule_index("texture", blocks, FORM) == schedule_index("constant", blocks, FORM) == Index()
    assert schedule_index("flow", blocks, FORM).name == "flow"
    assert schedule_index("index", blocks, FORM).name == "index"
    with pytest.raises(CalibrationError, match="unknown schedule 'speed'"):
        schedule_index("speed", blocks, FORM)
    assert "spread" in index_form(Farneback()).covariates
    assert "spread" not in index_form(LucasKanade()).covariates
    assert set(SCHEDULES) == {"constant", "texture", "flow", "index"}


def test_a_constant_schedule_is_one_set_of_parameters():
    block = sketch(20_000)
    model = fit_likelihood([block], FAMILIES["laplace"], LucasKanade(), constant=True)
    assert model.schedule.name == "constant"
    _, z, _ = drawn(20_000)
    # the mean magnitude is the likeliest scale
    np.testing.assert_allclose(model.schedule.theta(2.0), np.abs(z).mean(), rtol=0.01)


@pytest.mark.parametrize("problem", ["few", "constant", "columns"])
def test_data_that_cannot_teach_is_refused(problem):
    if problem == "few":
        covariates, z, _ = drawn(999)
        message = "too few"
    elif problem == "constant":
        covariates, z, _ = drawn(2_000)
        covariates["residual"] = np.ones(2_000)
        message = "constant"
    else:
        texture = {"texture": np.ones(10)}
        other = ErrorSketch.of(Index(), texture, np.ones(10), np.ones(10), np.random.default_rng(0))
        with pytest.raises(CalibrationError, match="different covariates"):
            Rows.of([sketch(100), other])
        return
    with pytest.raises(CalibrationError, match=message):
        learn_index(Rows(covariates, z), FAMILIES["laplace"], NAMES)
