"""`flowlik fuse` on a small simulated flight, and what it refuses."""

import csv
import inspect
import json
import shutil
import sys
from dataclasses import fields

import numpy as np
import pytest

from flowlik.cli import _fuse
from flowlik.commands.fuse_options import FuseOptions
from flowlik.geometry.trajectory import read_tum
from tests.cli.call import call, refuse, succeed

pytest.importorskip("gtsam")
FRAMES = 24


@pytest.fixture(scope="module")
def sensed(tmp_path_factory):
    """A flight of 0.4 s with IMU and GPS that is carried off quickly, and its motions."""
    folder = tmp_path_factory.mktemp("sensed")
    data = folder / "flight"
    succeed(
        "simulate", "planes", "--trajectory", "training", "--frames", FRAMES, "--width", 128, "--height", 96,
        "--imu", "adis16448", "--gps", "white:rate_hz=30,white_horizontal_m=0.3,white_vertical_m=0.3",
        "--spoof", "ramp:onset_s=0.1,rate_mps=60", "--out", data,
    )  # fmt: skip
    succeed("odometry", data, "--model", "lucas-kanade", "--out", folder / "motions")
    return data


def words(data, *more):
    return ("fuse", data, "--imu", data, "--gps", data, "--camera-pose", "body", *more)


def records(run):
    return {r["metric"]: r["value"] for r in json.loads((run / "metrics.json").read_text())}


@pytest.fixture(scope="module")
def of_images(sensed):
    run = sensed.parent / "of-images"
    succeed(*words(sensed, "--model", "lucas-kanade", "--initial", "truth"), "--out", run)
    return run


def test_it_writes_what_it_found(sensed, of_images):
    trajectory = read_tum(of_images / "trajectory_tum.txt")
    assert len(trajectory) == FRAMES
    states = np.load(of_images / "states.npz")
    assert states["covariance"].shape == (FRAMES, 15, 15)
    with (of_images / "biases.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == FRAMES and 0 < float(rows[-1]["sigma_gyro_x_radps"]) < 0.01
    found = records(of_images)
    assert found["flow_factor_fraction"] > 0.9
    assert found["position_rms_m"] < 3
    assert 0 < found["information_share_flow_velocity"] < 1
    page = (of_images / "report.html").read_text()
    for title in ("Does GPS agree with the rest?", "Biases of the IMU", "What each sensor contributed"):
        assert title in page


def test_gps_that_is_carried_off_is_found_and_left_out(of_images):
    assert records(of_images)["gps_alarms"] == 1
    with (of_images / "monitor.csv").open() as file:
        rows = list(csv.DictReader(file))
    alarmed = [row for row in rows if row["alarm"] == "1"]
    assert alarmed and float(alarmed[0]["timestamp_s"]) > 0.1
    assert float(alarmed[0]["ramp_x_mps"]) == pytest.approx(60, abs=25)
    (warning,) = (w for w in json.loads((of_images / "run.json").read_text())["warnings"] if "alarm" in w)
    assert "GPS does not agree with IMU and flow" in warning
    # the shift of 60 m/s is not followed
    states = np.load(of_images / "states.npz")
    steps = np.diff(states["T_n_b"][:, :3, 3], axis=0)
    assert np.linalg.norm(steps[-3:], axis=1).max() < 0.3


def test_motions_of_an_earlier_run_give_the_same(sensed, of_images, tmp_path):
    run = tmp_path / "run"
    motions = sensed.parent / "motions"
    succeed(*words(sensed, "--motions", motions, "--initial", "truth"), "--out", run)
    a, b = (np.load(folder / "states.npz") for folder in (of_images, run))
    np.testing.assert_allclose(b["T_n_b"], a["T_n_b"], atol=1e-6)
    np.testing.assert_allclose(b["covariance"], a["covariance"], atol=1e-8)


def test_a_start_in_a_file_and_coloured_gps(sensed, tmp_path):
    start = tmp_path / "start.yaml"
    start.write_text(
        "T_n_b: [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]\nvelocity_n_mps: [0, 0, 6]\n"
        "attitude_sd_rad: 0.1\nvelocity_sd_mps: 3\nposition_sd_m: 20\n"
    )
    run, motions = tmp_path / "run", sensed.parent / "motions"
    more = ("--motions", motions, "--initial", start, "--gps-coloured", "0.5,60", "--antenna", "0,0,0")
    succeed(*words(sensed, *more), "--out", run)
    assert np.isfinite(records(run)["position_sigma_median_m"])


def test_directions_are_fused_where_their_factor_is_stated(sensed, tmp_path):
    run = tmp_path / "run"
    more = ("--model", "lucas-kanade", "--residual", "epipolar", "--long-run-factor", 20)
    succeed(*words(sensed, *more, "--initial", "truth", "--frames", 8), "--out", run)
    found = records(run)
    assert found["flow_factor_fraction"] > 0.5
    assert 0 <= found["information_share_flow_attitude"] < 1
    given = ("fuse", sensed, "--imu", sensed, "--camera-pose", "body", *more)
    refuse(*given, out=tmp_path / "no", message="without depth the start cannot be found")


@pytest.mark.parametrize(
    ("less", "more", "message"),
    [
        ("--imu", (), "--imu is missing"),
        ("--camera-pose", (), "it is not known where the camera sits"),
        ("--initial", (), "tell a motion, but an alignment needs 10"),
        ("--initial", ("--align", 0.3), "tell the heading to"),
        ("", ("--up", "w"), "--up 'w' is no axis"),
        ("--motions", ("--residual", "epipolar"), "without depth a motion is a direction"),
        ("", ("--antenna", "1,2"), "expected 3 numbers with commas between"),
        ("", ("--form", "half"), "unknown --form 'half'"),
        ("", ("--lag", 0), "a smoother needs a lag above 0 s"),
        ("", ("--gps-coloured", "1,60"), "coloured GPS needs a share between 0 and 1"),
        ("", ("--initial", "none.yaml"), "none.yaml"),
        ("", ("--motions", "none"), "not a run of `flowlik odometry` with known depth"),
        ("", ("--model", "dis"), "its model is lucas-kanade, not dis"),
        ("--motions", ("--model", "farneback"), "by --long-run-factor how much larger"),
    ],
)
def test_bad_input_is_one_line(sensed, tmp_path, less, more, message):
    options = {"--imu": sensed, "--gps": sensed, "--camera-pose": "body", "--initial": "truth",
               "--motions": sensed.parent / "motions"}  # fmt: skip
    options.pop(less, None)
    options |= dict(zip(more[::2], more[1::2]))
    given = [word for pair in options.items() for word in pair]
    if less == "--motions" and "--model" not in options:
        given += ["--model", "lucas-kanade"]
    # too few motions: an alignment of 10 s has only these
    if message.startswith("tell a motion"):
        given += ["--frames", "5"]
        given = [w for w in given if w not in ("--motions", options["--motions"])] + [
            "--model",
            "lucas-kanade",
        ]
    refuse("fuse", sensed, *given, out=tmp_path / "run", message=message)


def test_times_that_do_not_overlap_and_missing_densities(sensed, tmp_path):
    data = tmp_path / "flight"
    shutil.copytree(sensed / "imu0", data / "imu0")
    lines = (data / "imu0" / "data.csv").read_text().splitlines()
    later = [f"{int(line.partition(',')[0]) + 10**12},{line.partition(',')[2]}" for line in lines[1:]]
    (data / "imu0" / "data.csv").write_text("\n".join([lines[0], *later, ""]))
    motions = sensed.parent / "motions"
    given = ("fuse", sensed, "--gps", sensed, "--camera-pose", "body", "--motions", motions, "--imu", data)
    refuse(*given, out=tmp_path / "run", message="IMU and images do not overlap: IMU from 1000 to")
    sensor = data / "imu0" / "sensor.yaml"
    text = sensor.read_text()
    sensor.write_text(text.replace("gyroscope_noise_density", "something"))
    refuse(*given, out=tmp_path / "run", message="gyroscope_noise_density is missing")
    sensor.write_text(text.replace("gyroscope_turn_on_sd", "something"))
    refuse(*given, out=tmp_path / "run", message="gyroscope_turn_on_sd is missing")


def test_without_gtsam_the_extra_is_named(sensed, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "gtsam", None)
    message = "flowlik fuse needs gtsam: pip install 'flowlik[fusion]'"
    refuse(*words(sensed, "--model", "lucas-kanade"), out=tmp_path / "run", message=message)


def test_every_option_reaches_the_command(monkeypatch, tmp_path):
    """Each is a parameter of the command line, under its own name or a shorter one, and is handed on."""
    shorter = {"align": "align_s", "lag": "lag_s", "antenna": "antenna_m", "imu_offset": "imu_offset_s"}
    parameters = set(inspect.signature(_fuse.run).parameters) - {"data", "out", "verbose", "json"}
    assert {shorter.get(name, name) for name in parameters} == {f.name for f in fields(FuseOptions)}
    seen = []
    monkeypatch.setattr("flowlik.commands._fuse.fuse", lambda data, out, options, **_: seen.append(options))
    monkeypatch.setattr(_fuse, "show_run", lambda *args: None)
    monkeypatch.setattr(
        "flowlik.commands.fuse", lambda data, out, options, **_: seen.append(options), raising=False
    )
    given = ("--antenna", "1,2,3", "--lag", 2, "--imu-offset", 0.01)
    assert call("fuse", tmp_path, *given, "--out", tmp_path / "o").code == 0
    assert (seen[0].antenna_m, seen[0].lag_s, seen[0].align_s) == ((1.0, 2.0, 3.0), 2.0, 10.0)
    assert seen[0].imu_offset_s == 0.01
