import json

import numpy as np
import pytest

from flowlik.errors import ModelError
from flowlik.flow import Farneback, LucasKanade, describe
from flowlik.image.texture import TextureDefinition
from flowlik.likelihood.families import FAMILIES
from flowlik.likelihood.likelihood import FlowLikelihood
from flowlik.likelihood.model_file import load_likelihood, save_likelihood
from flowlik.likelihood.schedule import Index, Input, Schedule, Term
from tests.helpers import KNOTS, lcm_likelihood
from tests.likelihood.test_likelihood import VALUES

INDEX = Index(
    (Input("texture", 1e-2), Input("discrepancy", 0.1, 50.0)),
    (Term(("texture",), 0.7), Term(("discrepancy", "discrepancy"), -1 / 3)),
    offset=0.1,
)


@pytest.fixture
def path(tmp_path):
    save_likelihood(lcm_likelihood(method=describe(Farneback())), tmp_path / "model.json")
    return tmp_path / "model.json"


@pytest.mark.parametrize("name", FAMILIES)
def test_a_model_comes_back_as_it_was(tmp_path, name):
    model = FlowLikelihood(
        FAMILIES[name],
        Schedule(INDEX, KNOTS, VALUES[name]),
        TextureDefinition(window=7),
        describe(LucasKanade(window=15)),
        {"data": "synthetic", "pairs": 3},
        {"nll": 1 / 3},
    )
    save_likelihood(model, tmp_path / "folder" / "model.json")
    again = load_likelihood(tmp_path / "folder" / "model.json")
    for field in ("family", "texture", "method", "provenance", "goodness"):
        assert getattr(again, field) == getattr(model, field)
    assert again.schedule.index == model.schedule.index
    np.testing.assert_array_equal(again.schedule.knots, KNOTS)
    z, x = np.linspace(-5, 5, 31)[:, None], np.linspace(-5, 10, 17)
    np.testing.assert_array_equal(again.log_prob(z, x), model.log_prob(z, x))


def test_a_model_of_no_flow_method_is_not_saved(tmp_path):
    with pytest.raises(ModelError, match="flow method"):
        save_likelihood(lcm_likelihood(), tmp_path / "model.json")
    assert list(tmp_path.iterdir()) == []


def changed(**values):
    return lambda content: json.dumps({**content, **values})


def without(key):
    return lambda content: json.dumps({k: v for k, v in content.items() if k != key})


def table(name, row):
    return lambda content: json.dumps({**content, "table": {**content["table"], name: row}})


def index(**values):
    return lambda content: json.dumps({**content, "index": {**content["index"], **values}})


def test_a_model_of_epipolar_errors_comes_back_as_such(tmp_path, path):
    assert load_likelihood(path).residual == "depth"
    before = json.loads(path.read_text())
    del before["residual"]  # as files of before wrote it
    path.write_text(json.dumps(before))
    assert load_likelihood(path).residual == "depth"
    save_likelihood(lcm_likelihood(method=describe(Farneback()), residual="epipolar"), tmp_path / "own.json")
    assert load_likelihood(tmp_path / "own.json").residual == "epipolar"


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        (lambda content: "", "not a flowlik model file"),
        (lambda content: json.dumps(content)[:200], "not a flowlik model file"),
        (lambda content: "a text\n of two lines", "not a flowlik model file"),
        (lambda content: "[1, 2]", "not a flowlik model file"),
        (lambda content: '{"dataset": "planes"}', "family"),
        (changed(comment="mine"), "comment"),
        (changed(residual="both"), "residual"),
        (changed(schema_version=1), "schema_version"),
        (changed(interpolation="link"), "interpolation"),
        (changed(family="student"), "unknown error family 'student'"),
        (changed(family="gaussian"), "needs the parameters"),
        (changed(knots=[0.0, 2.0, 1.0, 3.0]), "increasing knots"),
        (changed(knots=[0.0, 1.0, 2.0]), "differ in number"),
        (changed(knots=[0.0, 1.0, 2.0, float("nan")]), "knots"),
        (changed(knots="0 1 2 3"), "knots"),
        (changed(flow={"name": "raft"}), "unknown flow method"),
        (changed(flow={"name": "farneback", "windows": 3}), "unknown flow method"),
        (changed(texture={"derivative": "scharr", "window": 4}), "window"),
        (changed(texture={"derivative": "scharr"}), "texture.window"),
        (changed(index={"inputs": [{"covariate": "texture", "low": 0.01}]}), "index.terms"),
        (index(inputs=[{"covariate": "colour", "low": 1.0, "high": None}]), "colour"),
        (index(high=-9.0), "increasing"),
        (index(offset="much"), "index.offset"),
        (table("gamma", [1.0, 1.0, -1.0, 1.0]), "gamma leaves its bounds"),
        (table("w_L", [0.5, 0.5, 1.5, 0.5]), "w_L leaves its bounds"),
        (table("gamma", [1.0, 1.0]), "differ in number"),
        (table("gamma", [1.0, 1.0, float("inf"), 1.0]), "gamma"),
        (table("delta", [1.0, 1.0, 1.0, 1.0]), "needs the parameters"),
        (changed(shared_errors={"composite_power": 4.0}), "composite power"),
        (changed(shared_errors={"correlation": {"scale_px": [8.0]}}), "a correlation needs"),
        (without("provenance"), "provenance"),
        (without("table"), "table"),
    ],
)
def test_a_bad_file_is_one_line_that_names_it(path, damage, message):
    path.write_text(damage(json.loads(path.read_text())))
    with pytest.raises(ModelError, match=message) as caught:
        load_likelihood(path)
    assert str(caught.value).startswith(f"{path}: ")
    assert "\n" not in str(caught.value)


def test_missing_and_binary_files_are_one_line(tmp_path):
    (tmp_path / "binary.json").write_bytes(bytes(range(256)))
    for name, message in (
        ("none.json", "cannot read"),
        (".", "cannot read"),
        ("binary.json", "not a flowlik"),
    ):
        with pytest.raises(ModelError, match=message) as caught:
            load_likelihood(tmp_path / name)
        assert "\n" not in str(caught.value)


@pytest.mark.parametrize("change", [{"terms": []}, {"inputs": [{"covariate": "texture", "low": 0.0}]}])
def test_an_index_that_gives_no_coordinate_is_refused(path, change):
    path.write_text(index(**change)(json.loads(path.read_text())))
    with pytest.raises(ModelError, match=r"index"):
        load_likelihood(path)


def test_a_file_of_version_2_is_read(path):
    content = json.loads(path.read_text())
    del content["shared_errors"]
    correlation = {"scale_px": [8.0], "isotropic": [0.5, 0.3, 0.2], "along": [0.0, 0.1, 0.0]}
    old = {**content, "schema_version": 2, "score_correlation": correlation, "emphasis": 0.4}
    path.write_text(json.dumps(old))
    shared = load_likelihood(path).shared_errors
    assert shared.composite_power == 0.4
    assert shared.correlation is not None
    np.testing.assert_array_equal(shared.correlation.isotropic, [0.5, 0.3, 0.2])
    np.testing.assert_array_equal(shared.correlation.vertical, 0.0)
