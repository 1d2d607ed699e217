import numpy as np
import pytest

from flowlik.calibration import ErrorSketch
from flowlik.errors import CalibrationError
from flowlik.evaluation.likelihood import _eigenbasis as eigenbasis
from flowlik.evaluation.likelihood._eigenbasis import eigenbasis_cost, kept_for_eigenbasis, own_table_gain
from flowlik.evaluation.likelihood._evidence import Recorder
from flowlik.evaluation.likelihood._reservoir import Reservoir
from flowlik.likelihood.schedule import Index, Input, Term
from tests.evaluation.population import INDEX, MODEL, OVER_INDEX, draw, sketch_of

WITH_FLOW = Index((Input("flow-along", 0.02),), (Term(("flow-along",)),))


def test_what_the_other_component_needs_is_kept():
    assert kept_for_eigenbasis(Index()) == ("texture-across",)
    assert kept_for_eigenbasis(INDEX) == ("discrepancy-across", "texture-across")
    assert kept_for_eigenbasis(WITH_FLOW) == ("flow", "texture-across")


@pytest.mark.parametrize("model", [MODEL, OVER_INDEX], ids=["texture", "index"])
def test_figures_are_those_of_raw_samples(model):
    values, z = draw(model, 15_000)
    index = model.schedule.index
    cost = eigenbasis_cost([sketch_of(values, z, index)], model, power=2.0, edges=np.array([0, 0.3, 1]))
    pair = np.stack([values["texture"], values["texture-across"]])
    ratio = pair.min(axis=0) / pair.max(axis=0)
    own = index.combine(values)
    swapped = {n.replace("-across", "") if "across" in n else n + "-across": v for n, v in values.items()}
    pooled = own + 0.5 * ratio**2 * (index.combine(swapped) - own)
    for i, inside in enumerate((ratio < 0.3, ratio >= 0.3)):
        assert cost.counts[i] == inside.sum()
        for found, x in ((cost.nll, own), (cost.nll_pooled, pooled)):
            assert found[i] == pytest.approx(-model.log_prob(z[inside], x[inside]).mean())
        grid = np.geomspace(1e-3, 100, 400)
        predicted = np.mean([2 * model.cdf(b, own[inside]) - 1 for b in grid], axis=1)
        below = np.searchsorted(np.sort(np.abs(z[inside])), grid, side="right") / inside.sum()
        assert cost.ks[i] == pytest.approx(np.abs(below - predicted).max(), abs=4e-3)
    records = eigenbasis.eigenbasis_records(cost, Recorder(model, "drawn", 0, 1), "split=test")
    assert [r.metric for r in records] == ["ks_textures_alike", "ks_textures_apart", "nll_gain_of_pooling"]
    assert records[1].value == pytest.approx(np.average(cost.ks, weights=cost.counts))
    assert records[0].value is None and "split=test; alike=t2/t1>0.7" in records[0].protocol


def test_flow_along_the_other_direction():
    rows = Reservoir({"flow": np.array([5.0]), "flow-along": np.array([3.0]), "texture": np.ones(1),
                      "texture-across": np.ones(1)}, np.zeros(1), np.ones(1))  # fmt: skip
    assert eigenbasis.of_other_component(rows, WITH_FLOW)["flow-along"] == pytest.approx([4.0])


def test_pooling_helps_where_both_components_share_one_distribution():
    values, _ = draw(n=20_000)
    values["texture-across"] = values["texture"] * np.exp(
        np.random.default_rng(1).uniform(-0.05, 0.05, 20_000)
    )
    x = [OVER_INDEX.schedule.index.combine(values)]
    x.append(x[0] + 0.5 * (np.log(values["discrepancy-across"]) - np.log(values["discrepancy"])) * 0.5)
    z = OVER_INDEX.sample(x[1], np.random.default_rng(2))
    cost = eigenbasis_cost([sketch_of(values, z, INDEX)], OVER_INDEX)
    assert cost.nll[-1] - cost.nll_pooled[-1] > 0.02


def test_a_table_of_its_own_gains_where_the_distribution_changes():
    values, z = draw(n=20_000)
    pair = np.stack([values["texture"], values["texture-across"]])
    alike = pair.min(axis=0) / pair.max(axis=0) > 0.3
    blocks = [sketch_of(values, np.where(alike, 4 * z, z))]
    gain = own_table_gain(blocks, MODEL, np.random.default_rng(0), np.array([0, 0.3, 1.0]))
    assert gain[1] > 0.2 > 0.1 > gain[0] > -0.02


def test_a_sketch_without_the_other_texture_is_refused():
    values, z = draw(n=2000)
    alone = {"texture": values["texture"]}
    with pytest.raises(CalibrationError, match="texture-across"):
        eigenbasis_cost([sketch_of(alone, z)], MODEL)
    assert not eigenbasis.tells_eigenbasis(sketch_of(alone, z), MODEL)
    assert not eigenbasis.tells_eigenbasis(ErrorSketch.empty(Index(), tuple(values)), MODEL)
