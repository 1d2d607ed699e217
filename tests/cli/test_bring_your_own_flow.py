"""The worked example of docs/bring-your-own-flow.md, at tiny size, and what can go wrong with it."""

import re
import shlex
import sys
from pathlib import Path

import numpy as np
import pytest

from flowlik.flow._callable_flow import find
from flowlik.likelihood.model_file import load_likelihood
from flowlik.results.records import read_records, select
from tests.cli.call import call, succeed

PAGE = Path(__file__).parents[2] / "docs" / "bring-your-own-flow.md"
TINY = ("--frames", 7, "--width", 96, "--height", 64)
MODEL = "calibration/models/my_flow.fast.json"


def blocks(heading: str) -> list[tuple[str, str]]:
    """Languages and contents of the code blocks under a heading of the page."""
    (section,) = re.findall(rf"^## {re.escape(heading)}$(.*?)(?=^## |\Z)", PAGE.read_text(), re.M | re.S)
    return re.findall(r"```(\w+)\n(.*?)```", section, re.S)


def follow(heading: str) -> dict:
    """Do what a section of the page says, with small flights; returns the names its Python leaves."""
    names: dict = {}
    for language, content in blocks(heading):
        if content.startswith("# my_flow.py"):
            Path("my_flow.py").write_text(content)
        elif language == "python":
            exec(content, names)
        else:
            for line in content.replace("\\\n", " ").splitlines():
                program, command, *words = shlex.split(line)
                assert program == "flowlik"
                succeed(command, *words, *(TINY if command == "simulate" else ()))
    return names


@pytest.fixture(scope="module")
def workshop(quick, tmp_path_factory):
    """Folder in which the example has come as far as its calibration; the current one meanwhile."""
    folder, path, modules = tmp_path_factory.mktemp("workshop"), list(sys.path), set(sys.modules)
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        patch.setattr("flowlik.report.build", lambda run, **_: run / "report.html")
        find.cache_clear()
        follow("1. A function of two images")
        follow("2. Calibrate it")
        yield folder
    find.cache_clear()
    sys.path[:] = path
    for name in {"my_flow", "their_flow"} & (set(sys.modules) - modules):
        del sys.modules[name]


def test_the_model_names_the_object(workshop):
    model = load_likelihood(MODEL)
    assert model.method == {"name": "callable", "object": "my_flow:fast"}
    records = read_records(Path("calibration/metrics.json"))
    (nll,) = select(records, family="glc", metric="nll", schedule="index")
    assert nll.flow == "my_flow.fast"
    assert nll.count > 10_000
    assert model.goodness["nll"] == nll.value


def test_the_model_is_checked_and_used(workshop):
    follow("3. Check it on other data")
    names = follow("4. Use it")
    assert names["half_width_px"].shape == (96 * 64, 2)
    records = read_records(Path("evaluation/metrics.json"))
    (coverage,) = select(records, metric="coverage_90")
    # an index learned from six small pairs
    assert 0.6 < coverage.value < 0.98
    for run in ("picture", "odometry"):
        assert {record.flow for record in read_records(Path(run) / "metrics.json")} == {"my_flow.fast"}
    np.testing.assert_array_equal(np.load("picture/flow.npz")["half_width_px"], names["half_width_px"])


def test_flow_on_disk_is_the_same_flow(workshop):
    follow("Flow that is already on disk")
    model = load_likelihood("calibration-disk/models/fast.json")
    assert model.method == {"name": "flow-files", "label": "fast"}
    words = ("--method", "my_flow:fast", "--out")
    succeed("calibrate", "flight-1", *words, "calibration-live")
    live_model = "calibration-live/models/my_flow.fast.json"
    np.testing.assert_array_equal(model.schedule.values, load_likelihood(live_model).schedule.values)
    succeed("odometry", "flight-2", "--model", live_model, *words, "odometry-live")
    images = (f"flight-2/image_lcam_front/{k:06d}_lcam_front.png" for k in (3, 4))
    succeed("flow", *images, "--model", live_model, *words, "picture")
    trajectories = [Path(run, "trajectory_tum.txt").read_text() for run in ("odometry-disk", "odometry-live")]
    assert trajectories[0] == trajectories[1]
    live, disk = np.load("picture/flow.npz"), np.load("picture-disk/flow.npz")
    np.testing.assert_array_equal(live["flow_px"], disk["flow_px"])


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ((), "is not flowlik's own: give --method my_flow:fast if you trust that code"),
        (("--method", "dis"), "not for 'dis': give --method my_flow:fast if you trust that code"),
        (("--method", "their_flow:zero"), "not for 'their_flow:zero': give --method my_flow:fast"),
        (("--method", "my_flow:slow"), "my_flow:slow: cannot be imported (AttributeError"),
        (("--method", "your_flow:fast"), "your_flow:fast: cannot be imported (ModuleNotFoundError"),
    ],
)
@pytest.mark.parametrize("command", ["evaluate", "flow", "odometry"])
def test_a_model_is_refused_unless_its_object_is_confirmed(workshop, command, given, message):
    Path("their_flow.py").write_text("def zero(previous, current): pass")
    images = [f"flight-2/image_lcam_front/{k:06d}_lcam_front.png" for k in (0, 1)]
    words = {
        "evaluate": (MODEL, "flight-2"),
        "flow": (*images, "--model", MODEL),
        "odometry": ("flight-2", "--model", MODEL),
    }
    outcome = call(command, *words[command], *given, "--out", "refused")
    assert (outcome.code, len(outcome.err)) == (2, 1)
    assert message in outcome.err[0]
    assert not Path("refused").exists()


def test_an_object_that_fails_is_one_line(workshop):
    Path("their_flow.py").write_text("def zero(previous, current): pass")
    outcome = call("calibrate", "flight-1", "--method", "their_flow:zero", "--out", "refused")
    assert (outcome.code, len(outcome.err)) == (2, 1)
    assert "their_flow:zero: must return a floating array (64, 96, 2), not" in outcome.err[0]
