import numpy as np
import pytest
from scipy import stats
from scipy.integrate import trapezoid

from flowlik.evaluation.likelihood._sparsification import (
    CAP_PX,
    REMOVED,
    sparsification,
    sparsification_arrays,
)
from flowlik.likelihood.families import Gaussian, LaplaceCauchy
from flowlik.likelihood.likelihood import FlowLikelihood
from flowlik.likelihood.schedule import Index, Schedule
from tests.evaluation.population import MODEL, OVER_INDEX, draw, sketch_of

STATISTICS = {
    "mean": lambda m: np.minimum(m, CAP_PX).mean(),
    "median": np.median,
    "rmse": lambda m: np.sqrt((np.minimum(m, CAP_PX) ** 2).mean()),
}


def raw_curve(magnitude, key, statistic, removed):
    """Error of what stays of raw samples, those of largest key removed first."""
    ordered = magnitude[np.argsort(key)]
    kept = np.maximum(np.rint((1 - removed) * len(ordered)).astype(int), 1)
    curve = np.array([statistic(ordered[:n]) for n in kept])
    return curve / curve[0]


@pytest.mark.parametrize("model", [MODEL, OVER_INDEX], ids=["texture", "index"])
@pytest.mark.parametrize("name", STATISTICS)
def test_a_sketch_tells_the_curves_of_raw_samples(model, name):
    values, z = draw(model)
    x = model.schedule.index.combine(values)
    found = sparsification(sketch_of(values, z, model.schedule.index), model)
    magnitude, spread = np.abs(z), model.bound(x, 0.9)
    curves = [raw_curve(magnitude, key, STATISTICS[name], REMOVED) for key in (spread, magnitude)]
    near = REMOVED <= 0.9
    # which of a bin's components goes first is chance, and a root mean square hangs on a few
    tolerance = 0.08 if name == "rmse" else 0.03
    np.testing.assert_allclose(found.by_spread[name][near], curves[0][near], atol=tolerance)
    np.testing.assert_allclose(found.oracle[name], curves[1], atol=0.02)
    area = trapezoid(curves[0] - curves[1], REMOVED)
    assert found.ause(name) == pytest.approx(area, abs=0.01)
    expected = stats.spearmanr(spread, magnitude).statistic
    assert found.rank_correlation == pytest.approx(expected, abs=5e-3)


def test_a_perfect_ranking_has_no_area():
    values, _ = draw()
    spread = Schedule(Index(), np.array([-3.0, 10.0]), np.array([[100.0, 1e-2]]))
    model = FlowLikelihood(Gaussian(), spread)
    z = model.bound(np.log(values["texture"]), 0.9)
    found = sparsification(sketch_of(values, z), model)
    for name in STATISTICS:
        assert found.ause(name) == pytest.approx(0, abs=0.01)
    assert found.ause_relative() == pytest.approx(0, abs=0.01)
    assert found.rank_correlation == pytest.approx(1, abs=1e-3)


def test_one_spread_for_all_is_removal_at_random():
    constant = FlowLikelihood(LaplaceCauchy(), Schedule.constant(np.array([0.9, 0.5, 0.6])))
    found = sparsification(sketch_of(*draw()), constant)
    for name in STATISTICS:
        np.testing.assert_allclose(found.by_spread[name], 1)
        assert found.ause_relative(name) == pytest.approx(1)
    assert np.isnan(found.rank_correlation)


def test_a_reversed_ranking_is_worse_than_chance():
    values, z = draw()
    backwards = {**values, "texture": 1e3 / values["texture"]}
    found = sparsification(sketch_of(backwards, z), MODEL)
    assert found.ause_relative() > 1 and found.rank_correlation < 0


def test_arrays_hold_every_model():
    pair = (sketch_of(*draw(n=5000)), MODEL)
    arrays = sparsification_arrays({"a": pair, "b": pair})
    assert arrays["curves"].shape == arrays["oracle"].shape == (2, 2, len(REMOVED))
    assert arrays["ause"].shape == (2, 2)
