"""Flow files as the field writes them, through the commands: the right coverage and the right model."""

import json

import numpy as np
import pytest

from flowlik.datasets import open_sequence
from flowlik.datasets.flow_files import write_flo
from flowlik.likelihood.model_file import load_likelihood
from tests.cli.call import refuse, succeed
from tests.cli.conftest import image_of

pytestmark = pytest.mark.usefixtures("undrawn")


def figures(*words):
    """Values of a run's records by metric, and its lines on standard error."""
    outcome = succeed(*words, "--json")
    return {row["metric"]: row["value"] for row in json.loads(outcome.out)}, outcome.err


def own_flow(flight, k):
    """Flow PNG that `flowlik simulate` wrote."""
    return flight / "flow_lcam_front" / f"{k:06d}_{k + 1:06d}_flow.png"


def test_the_simulations_own_flow_is_its_truth(flight, tmp_path):
    """TartanAir V2's coding; read as KITTI's the coverage was 0.001."""
    write_flo(tmp_path / "truth.flo", open_sequence(flight).flow(0))
    pair = ("flow", image_of(flight, 0), image_of(flight, 1), "--model", "lucas-kanade")
    exact, _ = figures(*pair, "--truth", tmp_path / "truth.flo", "--out", tmp_path / "exact")
    found, warnings = figures(*pair, "--truth", own_flow(flight, 0), "--out", tmp_path / "found")
    assert found["coverage_90"] == pytest.approx(exact["coverage_90"], abs=0.02)
    assert exact["coverage_90"] > 0.7
    assert not [line for line in warnings if line.startswith("warning")]


def test_a_model_of_the_simulations_own_flow_knows_that_it_is_exact(flight, tmp_path):
    """Its errors are those of rounding to 1/64 px; read as KITTI's they were 512 px."""
    method = f"flow-files:own={own_flow(flight, 0).parent}"
    succeed("calibrate", flight, "--method", method, "--schedule", "constant", "--out", tmp_path / "out")
    likelihood = load_likelihood(tmp_path / "out/models/own.json")
    assert likelihood.bound(np.array([1.0]), 0.9)[0] == pytest.approx(0.9 / 128, rel=0.1)


def test_what_png_files_hold_can_be_said(flight, tmp_path):
    refuse("flow", image_of(flight, 0), image_of(flight, 1), "--model", "lucas-kanade",
           "--truth", own_flow(flight, 0), "--flow-png", "kitti", out=tmp_path / "out",
           message="no kitti flow, whose first channel says valid or not")  # fmt: skip
    refuse("calibrate", flight, "--method", f"flow-files:own={own_flow(flight, 0).parent}", "--flow-png",
           "dsec", out=tmp_path / "out", message="no dsec flow")  # fmt: skip
    refuse("evaluate", "lucas-kanade", flight, "--flow-png", "hd1k", out=tmp_path / "out",
           message="unknown coding of flow PNGs 'hd1k'")  # fmt: skip
