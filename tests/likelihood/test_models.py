import json

import pytest

from flowlik.commands import models, summary
from flowlik.errors import ModelError
from flowlik.flow import PRESETS, describe
from flowlik.likelihood.model_file import find_model, load_likelihood
from flowlik.likelihood.shipped import shipped
from tests.cli.call import call, succeed


@pytest.mark.parametrize("name", shipped())
def test_every_shipped_model_is_whole(name):
    model = load_likelihood(name)
    method = name.removesuffix("-lcm").removesuffix("-epipolar")
    assert model.residual == ("epipolar" if name.endswith("-epipolar") else "depth")
    if name.endswith("-lcm"):  # on the paper's flow
        method = f"{method}-opencv" if f"{method}-opencv" in PRESETS else method
    assert model.method == describe(PRESETS[method])
    expected = ("lcm", "texture") if name.endswith("-lcm") else ("glc", "index")
    assert (model.family.name, model.schedule.name) == expected
    assert model.provenance["components"] > 1_000_000
    assert model.provenance["data"] and model.provenance["versions"]["flowlik"]
    assert abs(model.goodness["coverage_90"] - 0.9) < 0.03


def test_the_flows_of_the_paper_and_dis_have_both_models():
    for method in ("farneback", "lucas-kanade", "dis"):
        assert {method, f"{method}-lcm"} <= set(shipped())


def test_a_file_goes_before_a_name_and_an_unknown_name_lists_the_known(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "lucas-kanade").write_text("mine")
    with pytest.raises(ModelError, match="not a flowlik model file"):
        load_likelihood("lucas-kanade")
    with pytest.raises(ModelError, match=r"raft: neither a model file nor a shipped model.*farneback"):
        load_likelihood("raft")
    with pytest.raises(ModelError, match=r"none\.json: cannot read"):
        load_likelihood("none.json")


def test_without_depth_a_name_is_its_table_of_errors_across_epipolar_lines():
    assert load_likelihood("lucas-kanade-11", "epipolar").residual == "epipolar"
    assert load_likelihood("lucas-kanade-11", "depth").residual == "depth"
    # what has no such table, and a file, is what was asked for
    assert find_model("lucas-kanade-11-lcm", "epipolar").stem == "lucas-kanade-11-lcm"
    assert find_model("lucas-kanade-11-epipolar", "epipolar").stem == "lucas-kanade-11-epipolar"
    file = shipped()["lucas-kanade-11"]
    assert find_model(file, "epipolar") == file


@pytest.mark.parametrize("name", [name for name in shipped() if name.endswith("-epipolar")])
def test_tables_of_errors_across_lines_need_no_signals_of_their_own(name):
    # so that lengths which flow tells are read off the same measurements by the other table
    across, both = load_likelihood(name), load_likelihood(name.removesuffix("-epipolar"))
    assert set(across.signals) == set(both.signals)
    assert (across.method, across.texture) == (both.method, both.texture)


def test_models_are_listed_and_shown():
    assert [m.name for m in models()] == sorted(shipped())
    one = summary("lucas-kanade")
    assert one.covariates == (
        "texture [intensity²/px²]", "flow [px]", "discrepancy [px]", "residual [intensity]",
        "standard-error [px]",
    )  # fmt: skip
    assert one.signals == ("discrepancy", "residual", "standard-error")
    listed = json.loads(succeed("models", "--json").out)
    assert [m["name"] for m in listed] == sorted(shipped())
    assert "lucas-kanade" in succeed("models").out
    assert "provenance" in succeed("models", "lucas-kanade").out
    refused = call("models", "raft")
    assert refused.code == 2 and len(refused.err) == 1
