"""`flowlik calibrate --without-truth` as a function and as a command."""

import numpy as np

from flowlik.commands import _without_truth, calibrate_without_truth
from flowlik.commands.options import TruthlessOptions
from flowlik.likelihood.model_file import load_likelihood
from flowlik.report.verdict import verdict_of
from flowlik.results.records import select
from tests.self_supervision.scenes import seen_pair


class Frames:
    """Only the number of its frames matters: the pairs are synthetic."""

    name, isolated_pairs = "frames", False

    def __len__(self):
        return 26


def test_a_run_holds_the_model_and_what_was_found(tmp_path, monkeypatch):
    rng = np.random.default_rng(0)
    monkeypatch.setattr(_without_truth, "read_data", lambda *_: Frames())
    monkeypatch.setattr(_without_truth, "seen_pairs", lambda *a: (seen_pair(rng, 160) for _ in a[1]))
    monkeypatch.setattr("flowlik.self_supervision.learning.ROUNDS", 1)
    monkeypatch.setattr("flowlik.report.build", lambda run, **_: run / "report.html")
    options = TruthlessOptions(residual="epipolar", family="laplace")
    run = calibrate_without_truth([tmp_path], "lucas-kanade", tmp_path / "run", options)
    model = load_likelihood(run.path / "models" / "lucas-kanade-epipolar.json")
    assert (model.residual, model.provenance["camera"], model.provenance["start"]) == (
        "epipolar", "nominal", "lucas-kanade",
    )  # fmt: skip
    # the law of these errors is not that of the shipped model
    nll = {
        (key, fit): r.value
        for r in select(run.records, metric="nll")
        for key in ("before", "after") for fit in ("in fit", "out of fit")
        if f"model={key};" in r.protocol and f"motions={fit}" in r.protocol
    }  # fmt: skip
    assert len(nll) == 4
    assert nll["after", "out of fit"] < nll["before", "out of fit"]
    told = verdict_of(run.records)
    (after,) = (
        r.value for r in select(run.records, metric="coverage_90")
        if "model=after;" in r.protocol and "motions=out of fit" in r.protocol
    )  # fmt: skip
    assert f"{100 * after:.0f} %" in " ".join(told.sentences).replace("\u202f", " ")
    (unsolved,) = select(run.records, metric="unsolved_fraction")
    assert (unsolved.value, unsolved.count) == (0.0, 25)
    with np.load(run.path / "data" / "without-truth--lucas-kanade.npz") as figure:
        assert list(figure["names"]) == ["before", "after"]
        off = [np.abs(np.log(figure["found"] / figure["predicted"]))[i].mean() for i in (0, 1)]
    assert off[1] < off[0]
