"""A calibration that is killed goes on where it stopped, and ends as if nothing had happened."""

import os
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from flowlik.datasets.tartanair import TartanAir
from flowlik.likelihood.families import FAMILIES
from flowlik.results.records import read_records
from flowlik.support.files import read_json
from tests.cli.call import call, succeed

COSTS = ("pairs_per_second", "components_per_second", "peak_memory_mb")
FLOW = """
import os, signal
import cv2

calls = 0

def kills(previous, current):
    "Flow that kills the process at the 25th call, that of the 25th pair, if it shall."
    global calls
    calls += 1
    if calls == 25 and "KILL" in os.environ:
        os.kill(os.getpid(), signal.SIGKILL)
    return cv2.calcOpticalFlowFarneback(previous, current, None, 0.5, 2, 9, 2, 5, 1.1, 0)
"""


@pytest.fixture(autouse=True)
def one_fit(monkeypatch):
    """Fit one family with one prior: these tests are about what is fitted to."""
    monkeypatch.setattr("flowlik.commands._calibrate.FAMILIES", {"lcm": FAMILIES["lcm"]})
    monkeypatch.setattr("flowlik.calibration.run.choose_smoothing", lambda *_: 1e-5)


@pytest.fixture(scope="module")
def long_flight(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("long") / "flight"
    succeed("simulate", "planes", "--trajectory", "training", "--frames", 42, "--width", 48, "--height", 32,
            "--out", folder)  # fmt: skip
    assert len(TartanAir(folder)) == 42
    return folder


def test_a_killed_calibration_ends_as_one_that_was_not(long_flight, tmp_path, monkeypatch, undrawn):
    (tmp_path / "deadly_flow.py").write_text(FLOW)
    monkeypatch.syspath_prepend(tmp_path)
    out = tmp_path / "killed"
    words = ["calibrate", str(long_flight), "--method", "deadly_flow:kills", "--out"]
    program = "import sys; from flowlik.cli import main; sys.argv[0] = 'flowlik'; main()"
    paths = os.pathsep.join([str(tmp_path), *sys.path])
    killed = subprocess.run(
        [sys.executable, "-c", program, *words, str(out)],
        env={**os.environ, "KILL": "1", "PYTHONPATH": paths},
    )
    assert killed.returncode == -signal.SIGKILL
    assert (out / "unfinished.json").exists()
    assert len(list((out / "sketches-0").glob("block-*-00.npz"))) == 2

    # a half-written file of the killed process does no harm
    shutil.copy(out / "sketches-0" / "plan.json", out / "sketches-0" / ".block-000002-00.npz.abc.part")
    succeed(*words, out)
    whole = tmp_path / "whole"
    succeed(*words, whole, "--keep-sketches")
    assert not (out / "sketches-0").exists()
    assert len(list((whole / "sketches-0").glob("block-*-00.npz"))) == 5
    model = Path("models") / "deadly_flow.kills.json"
    assert read_json(out / model) == read_json(whole / model)
    records = {run: read_records(run / "metrics.json") for run in (out, whole)}
    plain = [[r for r in records[run] if r.metric not in COSTS] for run in (out, whole)]
    assert plain[0] == plain[1]
    costs = {r.metric: r for r in records[out] if r.metric in COSTS}
    assert set(costs) == set(COSTS)
    assert costs["pairs_per_second"].count == 21
    assert "resumed=2" in costs["pairs_per_second"].protocol
    assert all(r.value > 0 for r in costs.values())


@pytest.mark.parametrize("executor", ["processes", "dask"])
def test_an_executor_is_an_option(flight, tmp_path, undrawn, executor):
    pytest.importorskip("distributed")
    words = ("calibrate", flight, "--method", "lucas-kanade", "--out")
    succeed(*words, tmp_path / "serial")
    succeed(*words, tmp_path / executor, "--executor", executor, "--workers", 1)
    mine, theirs = (read_json(tmp_path / e / "models" / "lucas-kanade.json") for e in (executor, "serial"))
    assert mine == theirs


def test_options_of_executors_that_do_not_fit_are_one_line(flight, tmp_path):
    words = ("calibrate", flight, "--method", "dis", "--out", tmp_path / "run")
    for options, message in (
        (("--executor", "threads"), "known are serial, processes, dask"),
        (("--scheduler", "tcp://a:1"), "for the executor dask"),
        (("--workers", 2), "for local processes"),
    ):
        outcome = call(*words, *options)
        assert outcome.code == 2
        assert len(outcome.err) == 1
        assert message in outcome.err[0]
    assert not (tmp_path / "run").exists()
