"""Help, completion, versions and the doctor."""

import json
import os
import subprocess
import sys

import pytest

from flowlik.cli import _complete as complete
from flowlik.cli.app import app
from tests.cli.call import call, succeed

COMMANDS = [command.name for command in app.registered_commands]
HEAVY = {"numpy", "cv2", "scipy", "numba", "matplotlib"}


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_has_help_with_an_example(command):
    text = " ".join(succeed(command, "--help").out.split())
    assert "Example" in text
    assert f"flowlik {command}" in text.partition("Example")[2]
    assert "--json" in text
    assert "<bool>" not in text


def test_options_stand_in_groups():
    text = succeed("odometry", "--help").out
    places = [
        text.index(f"─ {group} ─") for group in ("Output", "Model", "Input", "Scale", "Camera", "Advanced")
    ]
    assert places == sorted(places)
    plain = text[text.index("─ Options ─") : places[0]]
    assert plain.count("--") == 1  # the help itself


def test_help_loads_nothing_heavy():
    code = """
import sys
from flowlik.cli import main
sys.argv = ["flowlik", "odometry", "--help"]
try: main()
except SystemExit: pass
import json; print(json.dumps(sorted(m for m in sys.modules if "." not in m)))
"""
    printed = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    assert not HEAVY & set(json.loads(printed.splitlines()[-1]))


def test_what_is_completed_is_what_is_known():
    from flowlik.calibration import SCHEDULES
    from flowlik.calibration.executors import EXECUTORS
    from flowlik.commands._odometry import ESTIMATORS
    from flowlik.datasets import FORMATS
    from flowlik.datasets.flow_png import PNG_CODINGS
    from flowlik.flow import METHODS, flow_method
    from flowlik.likelihood.families import FAMILIES
    from flowlik.likelihood.shipped import shipped
    from flowlik.odometry.scale import SCALES
    from flowlik.simulation import TRAJECTORIES, WORLDS

    known = {
        "EXECUTORS": EXECUTORS, "SCHEDULES": SCHEDULES, "ESTIMATORS": ESTIMATORS, "FORMATS": FORMATS,
        "FAMILIES": FAMILIES, "SCALES": SCALES, "WORLDS": WORLDS,
        "TRAJECTORIES": TRAJECTORIES, "FLOW_PNGS": PNG_CODINGS,
    }  # fmt: skip
    for name, values in known.items():
        assert set(getattr(complete, name)) == set(values), name
    assert set(METHODS) <= set(complete.METHODS)
    assert all(flow_method(name) for name in complete.METHODS)
    assert complete.one_of(complete.SCALES)("g") == ["gps-norm"]
    assert set(complete.models("lucas")) == {name for name in shipped() if name.startswith("lucas")}


@pytest.mark.parametrize("shell", ["bash", "zsh"])
def test_completion_is_offered(shell, monkeypatch):
    environment = {
        "_FLOWLIK_COMPLETE": f"complete_{shell}",
        "_TYPER_COMPLETE_ARGS": "flowlik odometry --scale g",
    }
    environment |= {"COMP_WORDS": "flowlik odometry x --scale g", "COMP_CWORD": "4"}
    code = "import sys; sys.argv[0] = 'flowlik'; from flowlik.cli.app import app; app(prog_name='flowlik')"
    offered = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, env={**os.environ, **environment}
    )
    assert "gps-norm" in offered.stdout, offered


def test_versions():
    printed = succeed("--version").out
    for name in ("flowlik", "python", "numpy", "scipy", "numba", "opencv"):
        assert name in printed


def test_the_doctor_finds_this_installation_healthy(monkeypatch):
    monkeypatch.setattr(
        "flowlik.support.extras.find_spec", lambda package: None if package == "gtsam" else object()
    )
    found = json.loads(succeed("doctor", "--json").out)
    assert found["healthy"]
    assert found["extras"]["fusion"] == ["gtsam"]
    assert found["extras"]["viz"] == []
    assert [check["name"] for check in found["checks"]] == [
        "shipped models", "flow and its likelihood", "ego-motion",
    ]  # fmt: skip
    printed = succeed("doctor").out
    assert "missing gtsam: pip install 'flowlik[fusion]'" in printed


def test_the_doctor_tells_of_a_failed_test(monkeypatch):
    from flowlik.commands import _doctor as doctor

    monkeypatch.setattr(doctor, "DEPTH_M", 4.0)
    monkeypatch.setattr(doctor, "lcmsac", lambda likelihood: doctor_that_fails())
    outcome = call("doctor")
    assert outcome.code == 2
    assert "FAILED" in outcome.out


def doctor_that_fails():
    from flowlik.errors import FlowlikError

    raise FlowlikError("no motion")
