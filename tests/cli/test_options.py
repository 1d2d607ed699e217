"""Every option of a command reaches it, and stands in the run's configuration."""

import builtins
import json
import shutil
from contextlib import nullcontext
from dataclasses import fields
from functools import partial
from inspect import signature

import pytest

from flowlik import cli
from flowlik.commands import _calibrate
from flowlik.commands._shared_options import StandardFlights
from flowlik.commands.options import CalibrateOptions, EvaluateOptions, FlowOptions, OdometryOptions
from flowlik.datasets import open_sequence
from flowlik.report.viewer import _NoViewer
from tests.cli.call import succeed

OPTIONS = {"odometry": OdometryOptions, "calibrate": CalibrateOptions, "evaluate": EvaluateOptions}
EXECUTION = {"executor": "dask", "workers": 3, "scheduler": "tcp://a:1", "keep_sketches": True}
OTHER = {
    "odometry": {
        "model": "lucas-kanade", "method": "lucas-kanade", "flow_png": "dsec",
        "estimator": "mle", "residual": "epipolar",
        "scale": "camera-height", "camera_height_m": 1.5,
        "self_calibrate": True, "adapt": True, "boresight": "causal", "gate": 0.5,
        "truth": "truth.txt", "frames": 7, "start": 1, "stride": 2, "parallax": 0.001,
        "skip_bad_frames": True, "format": "tartanair", "camera": "50,48,32",
        "mask": "hood.png", "resize": "0.5",
        "frames_per_second": 20.0, "topic": "/camera/image_raw", "depth_topic": "/camera/depth",
        "bag": True, "bag_unscaled": True, "view": True, "record": True, "seed": 7,
    },
    "calibrate": {
        "family": "lcm", "schedule": "texture", "flow_png": "dsec", "format": "tartanair",
        "camera": "50,48,32", "skip_bad_frames": True, "mask": "hood.png", "resize": "0.5", "seed": 7,
        **EXECUTION,
    },
    "evaluate": {
        "method": "lucas-kanade", "flow_png": "dsec", "format": "tartanair",
        "camera": "50,48,32", "skip_bad_frames": True, "mask": "hood.png", "resize": "0.5", "seed": 7,
        **EXECUTION,
    },
}  # fmt: skip
"""A value of every option that is not its default. Who adds an option adds it here."""

FLAGS = {
    "camera_height_m": "--camera-height", "frames_per_second": "--fps", "gate": "--min-texture",
    "bag": "--save-bag", "bag_unscaled": "--save-bag-unscaled", "record": "--save-rerun",
}  # fmt: skip


def words_of(options):
    for name, value in options.items():
        yield FLAGS.get(name, "--" + name.replace("_", "-"))
        if value is not True:
            yield value


@pytest.fixture(scope="module")
def told(flight, tmp_path_factory):
    """What each command recorded, and what it told the outside, of a run with no option at its default."""
    pytest.importorskip("rosbags")
    told = {command: {} for command in OPTIONS}
    data = {
        "odometry": (flight,),
        "calibrate": (flight, "--method", "lucas-kanade"),
        "evaluate": ("lucas-kanade", flight),
    }

    def run(command):
        def opened(*args):
            told[command] |= signature(open_sequence).bind(*args).arguments
            return open_sequence(args[0])

        def changed(name):
            def change(sequence, value):
                told[command] |= {name: str(value)}
                return sequence

            return change

        def mapped(*args):
            told[command] |= dict(zip(("executor", "workers", "scheduler"), args))
            return nullcontext(builtins.map)

        def shown(view, path):
            told[command] |= {"view": view, "record": path is not None}
            return _NoViewer()

        with pytest.MonkeyPatch.context() as patch:
            patch.chdir(tmp_path_factory.mktemp("here"))
            shutil.copy(flight / "pose_lcam_front.txt", "truth.txt")
            reader = f"flowlik.commands._{'odometry' if command == 'odometry' else 'reading'}"
            patch.setattr(f"{reader}.open_sequence", opened)
            patch.setattr(f"{reader}.masked", changed("mask"))
            patch.setattr(f"{reader}.resized", changed("resize"))
            for module in ("sketching", "calibrate"):
                patch.setattr(f"flowlik.commands._{module}.executor", mapped)
            # one family is enough: what is fitted is tested elsewhere
            one = partial(_calibrate.fit_families, names=("lcm",))
            patch.setattr("flowlik.commands._calibrate.fit_families", one)
            patch.setattr("flowlik.commands._odometry.viewer", shown)
            patch.setattr("flowlik.report.build", lambda run, **_: run / "report.html")
            out = tmp_path_factory.mktemp("options") / command
            succeed(command, *data[command], *words_of(OTHER[command]), "--out", out)
        description = json.loads((out / "run.json").read_text())
        return description["config"], told[command]

    return {command: run(command) for command in OPTIONS}


STANDARD = {"standard", *(f.name for f in fields(StandardFlights))}
"""Options of a calibration without data, which tests/cli/test_standard.py has."""


@pytest.mark.parametrize(
    ("command", "name"),
    [(c, f.name) for c, kind in OPTIONS.items() for f in fields(kind) if f.name not in STANDARD],
)
def test_an_option_is_recorded(told, command, name):
    config, heard = told[command]
    value = OTHER[command][name]
    assert value != getattr(OPTIONS[command], name), "the default tells nothing"
    assert config[name] == value
    assert heard.get(name, value) == value


def test_a_configuration_makes_the_options_again(told):
    config, _ = told["odometry"]
    names = [f.name for f in fields(OdometryOptions)]
    assert OdometryOptions(**{name: config[name] for name in names}).asdict() == OTHER["odometry"]


@pytest.mark.parametrize("kind", [*OPTIONS.values(), FlowOptions])
def test_the_command_line_has_the_same_defaults(kind):
    command = kind.__name__.removesuffix("Options").lower()
    given = signature(getattr(cli.app, f"_{command}").run).parameters
    assert {f.name: given[f.name].default for f in fields(kind)} == {f.name: f.default for f in fields(kind)}
