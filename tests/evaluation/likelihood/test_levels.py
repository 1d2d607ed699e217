import numpy as np
import pytest

from flowlik.calibration import ErrorSketch
from flowlik.calibration.sketch import level_edges
from flowlik.evaluation.likelihood._goodness import Counting
from flowlik.evaluation.likelihood._levels import levels, levels_arrays
from flowlik.likelihood.schedule import Index
from tests.evaluation.population import MODEL, OVER_INDEX, draw, sketch_of


@pytest.mark.parametrize(
    ("model", "tolerance"), [(MODEL, 1e-2), (OVER_INDEX, 1e-9)], ids=["texture", "index"]
)
def test_levels_are_those_of_raw_samples(model, tolerance):
    # few enough for the reservoirs to keep all
    drawn = [draw(model, 15_000, seed) for seed in range(2)]
    # a reservoir holds errors to 1e-6 px
    drawn = [(values, np.round(1.5 * z, 6)) for values, z in drawn]
    blocks = [sketch_of(values, z, model.schedule.index) for values, z in drawn]
    values = {name: np.concatenate([v[name] for v, _ in drawn]) for name in drawn[0][0]}
    z = np.concatenate([z for _, z in drawn])
    x = model.schedule.index.combine(values)
    found = levels(blocks, model, Counting(500, 2))
    level = np.digitize(values["texture"], level_edges()) - 1
    for i in np.unique(level):
        own = level == i
        assert found.counts[i] == own.sum()
        inside = np.mean(np.abs(z[own]) <= model.bound(x[own], 0.9))
        assert found.coverage[i] == pytest.approx(inside, abs=tolerance)
        if own.sum() > 100:
            assert found.nll[i] == pytest.approx(-model.log_prob(z[own], x[own]).mean(), abs=3 * tolerance)
    counted = np.flatnonzero(found.counted)
    assert (found.counts[counted] >= 500).all() and len(counted)
    assert found.worst == counted[np.argmax(np.abs(found.coverage[counted] - 0.9))]
    assert found.rows == (None if model is MODEL else 30_000)


def test_reservoirs_stand_for_all_components_of_their_blocks():
    values, z = draw(OVER_INDEX, 40_000)
    many = sketch_of(values, z, INDEX := OVER_INDEX.schedule.index)
    few_values, few_z = draw(OVER_INDEX, 4000, 1)
    few = sketch_of(few_values, np.full(len(few_z), 1e3), INDEX)
    assert len(many.rows) == 20_000
    found = levels([many, few], OVER_INDEX, Counting(100, 1))
    # a share of 1/11 lies far outside
    counted = found.counted
    assert np.average(found.coverage[counted], weights=found.counts[counted]) == pytest.approx(
        0.9 * 10 / 11, abs=0.01
    )


def test_without_counted_levels_there_is_no_worst():
    found = levels([sketch_of(*draw(n=1000))], MODEL)
    assert found.worst is None and not found.counted.any()
    nothing = levels([ErrorSketch.empty(Index())], MODEL)
    assert np.isnan(nothing.coverage).all()
    assert len(levels_arrays({"a": found})["texture"]) == (found.counts > 0).sum()
