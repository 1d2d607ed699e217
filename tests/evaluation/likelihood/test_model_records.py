import pytest

from flowlik.errors import CalibrationError
from flowlik.evaluation.likelihood import _model_records as of_model
from flowlik.evaluation.likelihood._goodness import Counting, held_out_floor
from flowlik.report._figures import check
from tests.evaluation.population import INDEX, MODEL, OVER_INDEX, draw, sketch_of

MODELS = {"texture": MODEL, "index": OVER_INDEX}


@pytest.fixture(scope="module")
def kinds():
    drawn = [draw(n=20_000, seed=seed) for seed in range(3)]
    return [[sketch_of(values, z, index) for values, z in drawn] for index in (None, INDEX)]


def test_every_model_has_every_record(kinds):
    found = {}
    for schedule, model in MODELS.items():
        blocks = of_model.blocks_over(kinds, model)
        records = of_model.model_records(blocks, model, "drawn", 3, Counting(500, 2), split="test")
        found |= {(schedule, r.metric): r for r in records}
        assert len(records) == len({r.metric for r in records})
    metrics = {metric for _, metric in found}
    assert len(found) == 2 * len(metrics)
    assert {
        "nll",
        "ks_median",
        "coverage_90_worst_level",
        "pit_ks",
        "ause_mean",
        "rank_correlation",
    } <= metrics
    assert found["texture", "nll"].value < found["index", "nll"].value
    assert found["texture", "coverage_90_worst_level"].value == pytest.approx(0.9, abs=0.03)
    assert found["texture", "pit_ks"].value < 0.01 < found["index", "pit_ks"].value
    assert all(r.value is not None and r.protocol.startswith("split=test") for r in found.values())
    assert "rows=60000" in found["index", "coverage_90_worst_level"].protocol


def test_without_counted_levels_the_record_says_so(kinds):
    records = {r.metric: r for r in of_model.model_records(kinds[0][:1], MODEL, "drawn", 0)}
    worst = records["coverage_90_worst_level"]
    assert worst.value is None and "reason=no level counted" in worst.protocol


def test_figures_are_what_the_report_draws(kinds):
    models = {"lcm · index": OVER_INDEX, "lcm · texture": MODEL}
    floor = held_out_floor(kinds[0][0], kinds[0][1], Counting(100, 1))
    figures = of_model.figures(kinds, models, Counting(500, 2), floor)
    for kind, arrays in figures.items():
        check(kind, arrays)
    assert {"pit", "sparsification", "levels", "bias", "eigenbasis"} <= set(figures)
    assert len(figures["goodness"]["floor"]) == len(figures["goodness"]["texture"])
    median, largest = of_model.floor_records(floor, "drawn", "synthetic", 0, Counting(100, 1))
    assert (median.value, largest.value) == (floor.median, floor.maximum)


def test_a_model_without_a_sketch_of_its_index_is_refused(kinds):
    with pytest.raises(CalibrationError, match="no sketch over the index of the lcm model"):
        of_model.blocks_over(kinds[:1], OVER_INDEX)
