"""The commands one after another, on a small simulated flight."""

import csv
import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from flowlik.datasets import open_sequence
from flowlik.datasets.flow_files import read_flow, write_flo
from flowlik.datasets.uncertainty_file import read_uncertainty
from flowlik.geometry.trajectory import Trajectory, read_kitti, read_tum, write_kitti, write_tum
from flowlik.likelihood.model_file import load_likelihood
from flowlik.odometry.trajectory_covariance import read_covariance_csv
from flowlik.results.records import FILE_KEYS, read_records, select
from flowlik.simulation.flight._trajectories import curve
from tests.cli.call import call, succeed
from tests.cli.conftest import METHODS, image_of

GOODNESS = ["nll", "ks_median", "ks_max", "ks_signed_median", "ks_weighted_mean"]
GOODNESS += [f"coverage_{level}" for level in (50, 68, 90, 95, 99)] + ["outside_fraction"]
GOODNESS += ["coverage_90_worst_level", "pit_deviation", "pit_ks", "ause_mean", "ause_median", "ause_rmse"]
GOODNESS += ["ause_relative", "rank_correlation"]
ALIKE = ["ks_textures_alike", "ks_textures_apart", "nll_gain_of_pooling"]
BIAS = [
    name + where
    for where in ("", "_low_texture")
    for name in ("negative_share", "signed_median", "signed_mean")
]
COSTS = ["pairs_per_second", "components_per_second", "peak_memory_mb"]
MOTION = ["drift_percent", "t_err_percent", "r_err_deg_per_100m", "t_err_offset_removed_percent"]
MOTION += ["rpe_trans_median_m", "rpe_rot_median_deg", "frames_per_second", "unsolved_fraction"]
MOTION += ["outside_fraction"]


def check_run(folder: Path, name: str) -> dict:
    """What every run folder holds; returns its description."""
    description = json.loads((folder / "run.json").read_text())
    assert description["name"] == f"flowlik {name}"
    assert description["command"].startswith(f"flowlik {name} ")
    assert {"config", "seed", "versions", "warnings"} <= set(description)
    assert {"python", "flowlik", "numpy"} <= set(description["versions"])
    assert read_records(folder / "metrics.json")
    data = {path.stem for path in (folder / "data").glob("*.npz")}
    drawn = {path.stem for path in (folder / "figures").iterdir() if not path.name.startswith("front-")}
    assert drawn == data
    page = (folder / "report.html").read_text()
    assert all(f"figures/{stem}.png" in page for stem in data)
    return description


def metrics(text: str) -> list[str]:
    """Metrics of `--json`'s output, which must be nothing but JSON."""
    rows = json.loads(text)
    assert all(tuple(sorted(row)) == tuple(sorted(FILE_KEYS)) for row in rows)
    return [row["metric"] for row in rows]


@pytest.mark.parametrize("written", [write_kitti, write_tum])
def test_simulation_along_the_poses_of_a_file(tmp_path, written):
    times_s = 100 + np.arange(8) / 10
    trajectory = Trajectory(times_s, curve(8, speed_mps=20.0))
    written(tmp_path / "poses.txt", trajectory)
    succeed("simulate", "grid", "--trajectory", tmp_path / "poses.txt", "--start", 2, "--frames", 3,
            "--width", 64, "--height", 48, "--stereo-baseline", 0.3, "--no-sensor",
            "--out", tmp_path / "data")  # fmt: skip
    sequence = open_sequence(tmp_path / "data")
    assert len(sequence) == 3
    for k in range(3):
        np.testing.assert_allclose(
            sequence.T_n_c(k).as_matrix(), trajectory.poses[k + 2].as_matrix(), atol=1e-12
        )
        expected_s = times_s[k + 2] if written is write_tum else (k + 2) / 10
        assert sequence.timestamp(k) == pytest.approx(expected_s, abs=1e-12)
    description = json.loads((tmp_path / "data" / "camera.json").read_text())
    assert (description["width"], description["baseline_m"]) == (64, 0.3)
    assert description["provenance"]["sensor"]["full_well_e"] is None
    assert description["provenance"]["trajectory"] == "poses"
    assert len(list((tmp_path / "data" / "image_rcam_front").iterdir())) == 3


@pytest.mark.parametrize("method", METHODS)
def test_a_calibration_leaves_a_model_and_its_evidence(calibrations, models, method):
    check_run(calibrations[method], "calibrate")
    model = load_likelihood(models[method])
    assert (model.method["name"], model.family.name) == (method, "glc")
    records = read_records(calibrations[method] / "metrics.json")
    for family in ("lcm", "log-logistic", "gaussian"):
        assert [r.metric for r in select(records, family=family, flow=method)][: len(GOODNESS)] == GOODNESS
    assert [r.metric for r in select(records, family=None)] == COSTS + BIAS
    (nll,) = select(records, family="glc", metric="nll", schedule="index")
    assert nll.count == model.provenance["components"] > 1000
    assert "split=in sample" in nll.protocol
    assert "frames=8" in nll.protocol


def test_evaluation(flight, models, tmp_path):
    outcome = succeed("evaluate", models["lucas-kanade"], flight, "--out", tmp_path / "run", "--json")
    assert metrics(outcome.out) == COSTS + GOODNESS + ALIKE + BIAS
    warning, report = outcome.err
    assert "little data, " in warning and " error components from 8 image pairs" in warning
    assert report == f"report: {tmp_path / 'run' / 'report.html'}"
    check_run(tmp_path / "run", "evaluate")


def test_flow_with_truth(flight, models, tmp_path):
    truth = tmp_path / "truth.flo"
    write_flo(truth, open_sequence(flight).flow(0))
    outcome = succeed("flow", image_of(flight, 0), image_of(flight, 1), "--model", models["farneback"],
                      "--method", "farneback", "--truth", truth, "--out", tmp_path / "run",
                      "--json")  # fmt: skip
    check_run(tmp_path / "run", "flow")
    records = {row["metric"]: row["value"] for row in json.loads(outcome.out)}
    levels = [records[f"coverage_{level}"] for level in (50, 68, 90, 95)]
    assert levels == sorted(levels)
    np.testing.assert_allclose(levels, [0.5, 0.68, 0.9, 0.95], atol=0.15)
    arrays = np.load(tmp_path / "run" / "flow.npz")
    assert arrays["flow_px"].shape == arrays["half_width_px"].shape == (96 * 64, 2)
    assert records["coverage_ellipse_90"] == pytest.approx(0.9, abs=0.15)
    held = np.linalg.eigvalsh(arrays["covariance_px2"])[:, ::-1] ** 0.5 * np.sqrt(2 * np.log(10))
    widest = arrays["half_width_px"].max(axis=1)
    assert (held[:, 0] > widest).all()
    flow = arrays["flow_px"].reshape(64, 96, 2)
    np.testing.assert_allclose(read_flow(tmp_path / "run" / "flow.flo"), flow, atol=1e-5)
    np.testing.assert_allclose(read_flow(tmp_path / "run" / "flow.png"), flow, atol=0.5 / 64)
    uncertainty = read_uncertainty(tmp_path / "run" / "uncertainty.png")
    half_width = np.clip(arrays["half_width_px"].reshape(64, 96, 2), 1 / 256, 65535 / 256)
    np.testing.assert_allclose(uncertainty.half_width_px, half_width, atol=0.51 / 256)
    e1 = arrays["R_i_e"][:, :, 0].reshape(64, 96, 2)
    along = np.stack([np.cos(uncertainty.angle), np.sin(uncertainty.angle)], axis=-1)
    np.testing.assert_allclose(np.abs((e1 * along).sum(axis=-1)), 1, atol=1e-6)
    assert records["half_width_e2_median_px"] == pytest.approx(np.median(arrays["half_width_px"][:, 1]))


@pytest.mark.usefixtures("undrawn")
def test_flow_without_truth_says_nothing_of_coverage(flight, models, tmp_path):
    outcome = succeed("flow", image_of(flight, 0), image_of(flight, 1), "--model", models["lucas-kanade"],
                      "--out", tmp_path / "run", "--json")  # fmt: skip
    assert metrics(outcome.out) == [
        "half_width_e1_median_px", "half_width_e2_median_px", "within_half_px_fraction", "outside_fraction",
    ]  # fmt: skip


def test_odometry_drift_and_report(flight, models, tmp_path):
    run = tmp_path / "run"
    words = ("odometry", flight, "--model", models["lucas-kanade"], "--out", run, "--json")
    outcome = succeed(*words)
    assert sorted(metrics(outcome.out)) == sorted(MOTION)
    assert check_run(run, "odometry")["config"]["residual"] == "depth"

    # the files hold the same trajectory, and `drift` says the same of it
    kitti, tum = read_kitti(run / "trajectory_kitti.txt"), read_tum(run / "trajectory_tum.txt")
    np.testing.assert_allclose(kitti.positions, tum.positions, atol=1e-12)
    covariance = read_covariance_csv(run / "covariance.csv")
    np.testing.assert_array_equal(covariance.timestamps, tum.timestamps)
    assert np.linalg.eigvalsh(covariance.poses[1:]).min() > 0
    np.testing.assert_array_equal(np.load(run / "trajectory.npz")["pose_covariance"], covariance.poses)
    rows = list(csv.DictReader((run / "frames.csv").open()))
    assert [row["status"] for row in rows] == ["solved"] * 8
    write = tmp_path / "truth.txt"
    sequence = open_sequence(flight)
    first = sequence.T_n_c(0).inv()
    poses = [(first * sequence.T_n_c(k)).as_matrix()[:3].ravel() for k in range(9)]
    np.savetxt(write, poses, fmt="%.17g")
    drift = json.loads(succeed("drift", run / "trajectory_kitti.txt", write, "--json").out)
    (reported,) = select(read_records(run / "metrics.json"), metric="drift_percent")
    assert drift[0]["metric"] == "drift_percent"
    assert drift[0]["value"] == pytest.approx(reported.value, rel=1e-9)

    # the report is rebuilt from data and metrics alone
    page = (run / "report.html").read_bytes()
    for path in [run / "report.html", *(run / "figures").iterdir()]:
        path.unlink()
    assert succeed("report", run).err == [f"report: {run / 'report.html'}"]
    assert (run / "report.html").read_bytes() == page

    # a run may be repeated into its own folder; the same seed gives the same figures
    before = (run / "trajectory_kitti.txt").read_bytes()
    again = json.loads(succeed(*words).out)
    assert (run / "trajectory_kitti.txt").read_bytes() == before
    timed = [r for r in json.loads(outcome.out) if r["metric"] != "frames_per_second"]
    assert [r for r in again if r["metric"] != "frames_per_second"] == timed


@pytest.mark.usefixtures("undrawn")
@pytest.mark.parametrize("estimator", ["ransac", "lcmsac", "mle"])
@pytest.mark.parametrize("options", [(), ("--residual", "epipolar", "--scale", "truth-norm")])
def test_every_estimator_flies(flight, models, tmp_path, estimator, options):
    outcome = succeed("odometry", flight, "--model", models["lucas-kanade"], "--estimator", estimator,
                      *options, "--out", tmp_path / "run", "--json")  # fmt: skip
    rows = {row["metric"]: row for row in json.loads(outcome.out)}
    assert sorted(rows) == sorted(MOTION)
    assert {row["estimator"] for row in rows.values()} == {estimator}
    assert rows["unsolved_fraction"]["value"] < 0.5
    assert rows["drift_percent"]["value"] < 60
    assert ("scale=truth-norm" if options else "scale=depth") in rows["drift_percent"]["protocol"]
    assert rows["t_err_percent"]["value"] is None
    assert "holds no segment of 100 m" in rows["t_err_percent"]["protocol"]


@pytest.mark.usefixtures("undrawn")
def test_without_a_scale_lengths_are_null(flight, models, tmp_path):
    outcome = succeed("odometry", flight, "--model", models["lucas-kanade"], "--residual", "epipolar",
                      "--frames", 4, "--out", tmp_path / "run", "--json")  # fmt: skip
    rows = {row["metric"]: row for row in json.loads(outcome.out)}
    assert rows["rpe_rot_median_deg"]["value"] is not None
    for metric in ("drift_percent", "rpe_trans_median_m"):
        assert rows[metric]["value"] is None
        assert "no unit of length" in rows[metric]["protocol"]


@pytest.mark.usefixtures("undrawn")
def test_ransac_needs_no_model(flight, tmp_path):
    outcome = succeed("odometry", flight, "--estimator", "ransac", "--out", tmp_path / "run")
    assert "The drift at the end is" in outcome.out


@pytest.mark.usefixtures("undrawn")
@pytest.mark.parametrize("command", ["odometry", "evaluate", "flow"])
def test_a_model_that_does_not_fit_the_images_is_warned_of(flight, edited, tmp_path, command):
    model = edited(lambda content: content.update(knots=[k + 30 for k in content["knots"]]))
    words = {
        "odometry": (flight, "--model", model),
        "evaluate": (model, flight),
        "flow": (image_of(flight, 0), image_of(flight, 1), "--model", model),
    }
    outcome = succeed(command, *words[command], "--out", tmp_path / "run")
    warnings = [line for line in outcome.err if line.startswith("warning: ")]
    assert json.loads((tmp_path / "run" / "run.json").read_text())["warnings"] == [w[9:] for w in warnings]
    (warning,) = (w for w in warnings if "range" in w)
    assert "100 %" in warning


def test_the_installed_command(tmp_path):
    """Through the entry point: help, and one line and code 2 for bad input."""
    script = Path(sys.executable).with_name("flowlik")
    if not script.exists():
        pytest.skip("the entry point is not installed beside this Python")
    missing = [script, "report", tmp_path / "missing"]
    refused = subprocess.run(missing, capture_output=True, text=True)
    assert (refused.returncode, refused.stdout, refused.stderr.count("\n")) == (2, "", 1)
    assert refused.stderr.startswith("flowlik: ")


def test_help_and_version():
    assert "odometry" in succeed("--help").out
    assert succeed("--version").out.startswith("python ")
    assert call("odometry").code == 2
