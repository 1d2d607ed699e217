"""Real images with a model calibrated in simulation."""

import json

import pytest

from tests.cli.call import succeed


@pytest.mark.usefixtures("undrawn")
@pytest.mark.parametrize(("clip", "estimator"), [("03", "lcmsac"), ("03", "ransac"), ("01", "lcmsac")])
def test_odometry_of_real_frames(shared_data, models, tmp_path, clip, estimator):
    run = tmp_path / "run"
    outcome = succeed("odometry", shared_data / "kitti_odometry" / clip, "--format", "kitti", "--frames", 12,
                      "--model", models["lucas-kanade"], "--estimator", estimator, "--scale", "truth-norm",
                      "--out", run, "--json")  # fmt: skip
    rows = {row["metric"]: row for row in json.loads(outcome.out)}
    assert {row["dataset"] for row in rows.values()} == {f"kitti/{clip}"}
    assert rows["unsolved_fraction"]["value"] == 0
    if clip == "03":  # the other is a motorway, with few and repetitive corners
        assert rows["drift_percent"]["value"] < 5
    assert rows["rpe_rot_median_deg"]["value"] < 0.2
    assert "timestamps=frame/10s" in rows["drift_percent"]["protocol"]
    for metric in ("t_err_percent", "r_err_deg_per_100m", "t_err_offset_removed_percent"):
        assert rows[metric]["value"] is None
        assert "reason=" in rows[metric]["protocol"]
    assert len((run / "trajectory_kitti.txt").read_text().splitlines()) == 12
    assert len((run / "frames.csv").read_text().splitlines()) == 12


@pytest.mark.usefixtures("undrawn")
def test_flow_of_a_real_pair(shared_data, models, tmp_path):
    folder = shared_data / "flow" / "middlebury" / "RubberWhale"
    outcome = succeed("flow", folder / "frame10.png", folder / "frame11.png", "--method", "farneback",
                      "--model", models["farneback"], "--truth", folder / "flow10.flo",
                      "--out", tmp_path / "run", "--json")  # fmt: skip
    rows = {row["metric"]: row["value"] for row in json.loads(outcome.out)}
    levels = [rows[f"coverage_{level}"] for level in (50, 68, 90, 95)]
    assert 0 < levels[0] < levels[1] < levels[2] < levels[3] <= 1
