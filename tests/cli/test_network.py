"""A network in an ONNX file through the commands."""

from functools import partial
from pathlib import Path

import pytest

from flowlik.commands._calibrate import fit_families
from flowlik.likelihood.model_file import load_likelihood
from flowlik.results.records import read_records, select
from tests.cli.call import refuse, succeed
from tests.cli.conftest import image_of
from tests.flow.networks import Form, matcher


@pytest.fixture(scope="module")
def network(tmp_path_factory) -> str:
    form = Form(size=(64, 96), part=2, reach=3, variance=True)
    path = matcher(tmp_path_factory.mktemp("network") / "matcher.onnx", form)
    return f"onnx:{path},uncertainty=variance,uncertainty_is=variance,range=0..1,threads=1"


def test_a_network_goes_all_the_way(network, flight, tmp_path, undrawn, monkeypatch):
    # one family is enough here
    monkeypatch.setattr("flowlik.commands._calibrate.fit_families", partial(fit_families, names=("lcm",)))
    run = tmp_path / "calibration"
    succeed("calibrate", flight, "--method", network, "--family", "lcm", "--out", run)
    file = run / "models" / "matcher.json"
    model = load_likelihood(file)
    assert model.method["label"] == "matcher"
    assert "own-uncertainty" in model.signals
    words = ("--method", network, "--out")
    succeed("evaluate", file, flight, *words, tmp_path / "evaluation")
    (coverage,) = select(read_records(tmp_path / "evaluation" / "metrics.json"), metric="coverage_90")
    assert coverage.flow == "matcher"
    assert 0.8 < coverage.value < 0.99  # in sample, of a fit of a few iterations
    pair = (image_of(flight, 3), image_of(flight, 4))
    succeed("flow", *pair, "--model", file, *words, tmp_path / "picture")
    assert (tmp_path / "picture" / "flow.flo").is_file()
    succeed("odometry", flight, "--model", file, *words, tmp_path / "odometry")
    (unsolved,) = select(read_records(tmp_path / "odometry" / "metrics.json"), metric="unsolved_fraction")
    assert unsolved.value < 0.5
    refuse("evaluate", file, flight, out=tmp_path / "no", message="give --method onnx:FILE of the network")


def test_bad_networks_are_one_line(network, flight, out):
    for words, message in (
        ("onnx:nowhere.onnx", "nowhere.onnx: no such file of a network"),
        (f"{network},axes=vu", "the self-test fails: a shift of 4, -2 px comes back as"),
    ):
        refuse("calibrate", flight, "--method", words, out=Path(out), message=message)
