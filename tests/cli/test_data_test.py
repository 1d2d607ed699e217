"""The commands warn of data whose images do not move as the truth says, and only of these."""

import json

import numpy as np
import pytest

from flowlik.datasets import open_sequence
from tests.cli.call import succeed
from tests.cli.conftest import image_of

DOUBT = "the images do not move as"


def warnings_of(out):
    return [w for w in json.loads((out / "run.json").read_text())["warnings"] if DOUBT in w]


def shift_poses(folder):
    """Poses of the path taken the other way round."""
    rows = np.loadtxt(folder / "pose_lcam_front.txt")
    np.savetxt(folder / "pose_lcam_front.txt", rows[::-1])


@pytest.mark.parametrize("wrong", [False, True])
def test_evaluate(copy, models, out, undrawn, wrong):
    if wrong:
        shift_poses(copy)
    succeed("evaluate", models["lucas-kanade"], copy, "--out", out)
    assert len(warnings_of(out)) == wrong


@pytest.mark.parametrize("wrong", [False, True])
def test_calibrate(copy, out, undrawn, wrong):
    if wrong:
        shift_poses(copy)
    succeed("calibrate", copy, "--method", "lucas-kanade", "--schedule", "constant", "--out", out)
    assert len(warnings_of(out)) == wrong


@pytest.mark.parametrize("wrong", [False, True])
def test_odometry(copy, models, out, undrawn, wrong):
    if wrong:
        shift_poses(copy)
    succeed("odometry", copy, "--model", models["lucas-kanade"], "--out", out)
    assert ["its true flow says" in w for w in warnings_of(out)] == [True] * wrong  # and once only


@pytest.mark.parametrize("wrong", [False, True])
def test_true_flow_of_an_image_pair(flight, models, tmp_path, out, undrawn, wrong):
    flow = open_sequence(flight).flow(0)
    np.save(tmp_path / "flow.npy", flow[..., ::-1] if wrong else flow)
    succeed("flow", image_of(flight, 0), image_of(flight, 1), "--model", models["lucas-kanade"],
            "--truth", tmp_path / "flow.npy", "--out", out)  # fmt: skip
    assert [w.partition(":")[0] for w in warnings_of(out)] == ["true flow"] * wrong


@pytest.mark.parametrize("wrong", [False, True])
def test_flow_on_disk(flight, tmp_path, out, undrawn, wrong):
    sequence = open_sequence(flight)
    (tmp_path / "flow").mkdir()
    for k in range(len(sequence) - 1):
        flow = sequence.flow(k)
        np.save(tmp_path / f"flow/{k}.npy", -3 * flow if wrong else flow)
    succeed("calibrate", flight, "--method", f"flow-files:mine={tmp_path / 'flow'}", "--schedule", "constant",
            "--out", out)  # fmt: skip
    assert any("the flow on disk says" in w for w in warnings_of(out)) == wrong
