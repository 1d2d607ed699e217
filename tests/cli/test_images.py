"""Cameras, masks and sizes of images on the command line."""

import json

import cv2
import numpy as np
import pytest

from tests.cli.call import refuse, succeed
from tests.cli.conftest import image_of
from tests.datasets.camera_files import ROS

pytestmark = pytest.mark.usefixtures("undrawn")

CAMERA = "48,47.5,31.5"
"""Near enough that of the flight: 96 x 64 pixels."""


def records(*words):
    return {row["metric"]: row for row in json.loads(succeed(*words, "--json").out)}


@pytest.mark.parametrize("size", ["0.75", "72x48"])
def test_errors_are_judged_in_resized_images(flight, tmp_path, size):
    """Flow, truth and camera shrink together: the intervals still hold, and the protocol says so."""
    found = records("evaluate", "lucas-kanade", flight, "--resize", size, "--out", tmp_path / "out")
    assert 0.8 < found["coverage_90"]["value"] < 1
    assert f"resize={size}" in found["coverage_90"]["protocol"]
    whole = records("evaluate", "lucas-kanade", flight, "--out", tmp_path / "whole")
    assert "resize" not in whole["coverage_90"]["protocol"]
    assert found["coverage_90"]["value"] == pytest.approx(whole["coverage_90"]["value"], abs=0.1)


def test_a_motion_is_the_same_in_resized_images(flight, tmp_path):
    drift = [
        records("odometry", flight, "--model", "lucas-kanade", *words, "--out", tmp_path / name)[
            "drift_percent"
        ]
        for name, words in (("whole", ()), ("large", ("--resize", "2")), ("small", ("--resize", "0.75")))
    ]
    # images so small drift by 2 to 10 %; at twice the size with the camera as it was, by 192 %
    assert all(row["value"] < 15 for row in drift)
    assert "resize=2" in drift[1]["protocol"]


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("--camera", "48,5,47,5,31,5"), "6 numbers, expected f,cx,cy or fx,fy,cx,cy [px]; decimals"),
        (("--camera", "48,52,47.5,31.5"), "focal lengths 48 and 52 differ"),
        (("--camera", "24,23.5,15.5"), "principal point (23.5, 15.5) far from the middle of the image"),
        (("--camera", "96,191,127"), "outside of the image"),
        (("--camera", "CAMERA"), "made for images of 752 x 480 pixels, these are 96 x 64"),
        (("--camera", CAMERA, "--resize", "0,5"), "--resize '0,5': expected WIDTHxHEIGHT [px]"),
        (("--camera", CAMERA, "--resize", "0.1"), "images of 96 x 64 pixels would become 10 x 6"),
        (("--camera", CAMERA, "--mask", "MASK"), "40 x 30 pixels, but the image has 96 x 64"),
        (("--camera", CAMERA, "--mask", "none.png"), "none.png: no such image file"),
    ],
)  # fmt: skip
def test_what_does_not_fit_the_images_is_refused(flight, out, tmp_path, words, message):
    (tmp_path / "CAMERA").write_text(ROS)
    cv2.imwrite(str(tmp_path / "mask.png"), np.full((30, 40), 255, np.uint8))
    paths = {"CAMERA": tmp_path / "CAMERA", "MASK": tmp_path / "mask.png"}
    words = [paths.get(word, word) for word in words]
    images = flight / "image_lcam_front"
    refuse("odometry", images, *words, "--model", "lucas-kanade", out=out, message=message)


def test_a_mask_keeps_flow_away_from_an_arm(flight, tmp_path):
    """Something that stands before both images: there the true flow is not that of what is seen."""
    arm = np.s_[16:48, 24:72]
    for k in (0, 1):
        image = cv2.imread(str(image_of(flight, k)), cv2.IMREAD_GRAYSCALE)
        image[arm] = np.random.default_rng(0).integers(0, 255, image[arm].shape)
        cv2.imwrite(str(tmp_path / f"{k}.png"), image)
    mask = np.full((64, 96), 255, np.uint8)
    mask[arm] = 0
    cv2.imwrite(str(tmp_path / "mask.png"), mask)
    truth = flight / "flow_lcam_front/000000_000001_flow.png"
    words = ("flow", tmp_path / "0.png", tmp_path / "1.png", "--model", "farneback", "--truth", truth)
    bare = records(*words, "--out", tmp_path / "bare")
    found = records(*words, "--mask", tmp_path / "mask.png", "--out", tmp_path / "masked")
    assert bare["coverage_90"]["value"] < 0.8
    assert found["coverage_90"]["value"] > 0.88
    assert "mask=given" in found["coverage_90"]["protocol"]
    assert "mask" not in bare["coverage_90"]["protocol"]
    column, row = np.rint(np.load(tmp_path / "masked/flow.npz")["pixels"]).astype(int).T
    assert mask[row, column].all()
    cv2.imwrite(str(tmp_path / "mask.png"), mask[1:])
    refuse(
        *words,
        "--mask",
        tmp_path / "mask.png",
        out=tmp_path / "out",
        message="96 x 63 pixels, but the image has 96 x 64",
    )
