"""KITTI folders that are damaged, and going on over frames that cannot be used."""

import csv
import json

import cv2
import pytest

from tests.cli.call import refuse, succeed
from tests.datasets.test_kitti import P0, make_sequence, write_poses
from tests.helpers import textured_image


def short_poses(folder):
    write_poses(folder / "poses.txt", 3)
    return "poses.txt: 3 poses for the 4 images"


def pose_columns(folder):
    (folder / "poses.txt").write_text("0 0 0 0 0 0 0 1\n" * 4)
    return "poses.txt, line 1: 8 columns, but expected 12"


def no_calibration(folder):
    (folder / "calib.txt").write_text("hello\n")
    return "calib.txt, line 1: not a KITTI calibration row"


def no_poses(folder):
    return "this data set has no poses"


def missing_frame(folder):
    (folder / "image_0" / "000002.png").unlink()
    return "images are missing between 000001.png and 000003.png"


def corrupt_frame(folder):
    write_poses(folder / "poses.txt", 4)
    path = folder / "image_0" / "000002.png"
    path.write_bytes(path.read_bytes()[:-20])
    return "000002.png: not a readable image"


def no_row(folder):
    (folder / "calib.txt").write_text(P0.replace("P0", "P1") + "\n")
    return "no row P0, the camera of the images here"


def times_back(folder):
    (folder / "times.txt").write_text("0\n2\n1\n3\n")
    return "times.txt: times must increase"


DAMAGE = (
    short_poses,
    pose_columns,
    no_calibration,
    no_poses,
    missing_frame,
    corrupt_frame,
    no_row,
    times_back,
)


@pytest.mark.parametrize("damage", DAMAGE)
def test_kitti_folders(models, tmp_path, out, damage):
    folder = make_sequence(tmp_path / "sequences" / "09", calibration=P0)
    message = damage(folder)
    options = ("--model", models["lucas-kanade"], "--scale", "truth-norm")
    refuse("odometry", folder, *options, out=out, message=message)
    assert not out.exists()


@pytest.fixture
def drive(tmp_path):
    """Seven frames of a sliding picture in KITTI's layout; frame 2 is missing and frame 4 is damaged."""
    folder = tmp_path / "04"
    (folder / "image_0").mkdir(parents=True)
    for k in range(7):
        cv2.imwrite(str(folder / "image_0" / f"{k:06d}.png"), textured_image((120, 160), 4, (2.0 * k, k)))
    (folder / "image_0" / "000002.png").unlink()
    damaged = folder / "image_0" / "000004.png"
    damaged.write_bytes(damaged.read_bytes()[:-20])
    (folder / "calib.txt").write_text("P0: 120 0 80 0 0 120 60 0 0 0 1 0\n")
    (folder / "poses.txt").write_text("".join(f"1 0 0 {0.5 * k} 0 1 0 0 0 0 1 {k}\n" for k in range(7)))
    return folder


@pytest.mark.usefixtures("undrawn")
def test_frames_that_cannot_be_used_are_skipped_where_asked_for(models, drive, out):
    words = ("odometry", drive, "--model", models["lucas-kanade"], "--scale", "truth-norm")
    refuse(*words, out=out, message="images are missing between 000001.png and 000003.png")
    outcome = succeed(*words, "--skip-bad-frames", "--self-calibrate", "--out", out, "--json")
    rows = {row["metric"]: row for row in json.loads(outcome.out)}
    assert rows["skipped_frames"]["value"] == 2
    told = "\n".join(outcome.err)
    assert "frame 2 skipped" in told and "frame 4 skipped" in told and "000004.png" in told
    for name, numbers in (("frames", "1356"), ("intrinsics", "01356")):
        table = csv.DictReader((out / f"{name}.csv").open())
        assert "".join(row["frame"] for row in table) == numbers
    assert len((out / "trajectory_kitti.txt").read_text().splitlines()) == 5


@pytest.mark.usefixtures("undrawn")
def test_a_range_of_frames(models, drive, out):
    words = ("odometry", drive, "--model", models["lucas-kanade"], "--skip-bad-frames", "--out", out)
    succeed(*words, "--start", 3, "--frames", 3)
    assert [row["frame"] for row in csv.DictReader((out / "frames.csv").open())] == ["5"]
    refuse("odometry", drive, "--model", models["lucas-kanade"], "--skip-bad-frames", "--start", 9,
           out=out.parent / "none", message="no frame 9 to start at, there are 7 frames")  # fmt: skip
