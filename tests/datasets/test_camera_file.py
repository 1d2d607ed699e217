"""Camera files as ROS, OpenCV and Kalibr write them."""

import cv2
import numpy as np
import pytest

from flowlik.datasets import open_sequence
from flowlik.datasets.camera_file import read_camera
from flowlik.datasets.lens import Lens
from flowlik.errors import DataError

D = (-0.28, 0.07, 0.0002, 1.8e-5)
LENS = Lens(458.5, 457.25, 367.0, 248.5, D, False, (752, 480))

ROS = """image_width: 752
image_height: 480
camera_name: narrow
camera_matrix:
  rows: 3
  cols: 3
  data: [458.5, 0., 367.0, 0.0, 457.25, 248.5, 0, 0, 1]
distortion_model: plumb_bob
distortion_coefficients: {rows: 1, cols: 5, data: [-0.28, 0.07, 0.0002, 1.8e-5, 0.0]}
rectification_matrix: {rows: 3, cols: 3, data: [1, 0, 0, 0, 1, 0, 0, 0, 1]}
projection_matrix:
  rows: 3
  cols: 4
  data: [400, 0, 360, 0, 0, 400, 240, 0, 0, 0, 1, 0]
"""

ROS_ECHO = """header:
  stamp: {sec: 1, nanosec: 0}
  frame_id: cam
height: 480
width: 752
distortion_model: plumb_bob
d:
- -0.28
- 0.07
- 0.0002
- 1.8e-05
- 0.0
k:
- 458.5
- 0.0
- 367.0
- 0.0
- 457.25
- 248.5
- 0.0
- 0.0
- 1.0
"""

KALIBR = """cam0:
  cam_overlaps: [1]
  camera_model: pinhole
  distortion_coeffs: [-0.28, 0.07, 0.0002, 1.8e-05]
  distortion_model: radtan
  intrinsics: [458.5, 457.25, 367.0, 248.5]
  resolution: [752, 480]
  rostopic: /cam0/image_raw
cam1:
  camera_model: pinhole
"""


def written_by_opencv(path):
    file = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    file.write("calibration_time", "Tue 1 Jan")
    file.write("image_width", 752)
    file.write("image_height", 480)
    file.write("camera_matrix", np.array([[458.5, 0, 367], [0, 457.25, 248.5], [0, 0, 1]]))
    file.write("distortion_coefficients", np.array([*D, 0.0]))
    file.release()


@pytest.mark.parametrize("text", [ROS, ROS_ECHO, KALIBR, "opencv"])
def test_all_formats_tell_the_same_camera(tmp_path, text):
    path = tmp_path / "camera.yaml"
    if text == "opencv":
        written_by_opencv(path)
    else:
        path.write_text(text)
    lens = read_camera(path)
    assert (lens.fx, lens.fy, lens.cx, lens.cy) == (458.5, 457.25, 367.0, 248.5)
    assert lens.size == (752, 480)
    assert not lens.fisheye
    np.testing.assert_allclose(lens.coefficients[:4], D)
    assert not any(lens.coefficients[4:])


def test_kalibrs_fisheye(tmp_path):
    path = tmp_path / "camera.yaml"
    path.write_text(KALIBR.replace("radtan", "equidistant"))
    assert read_camera(path).fisheye


WRONG = {
    "": "not a camera",
    "- 1\n- 2\n": "not a camera",
    "a: [1": "not readable YAML",
    "a: &x [1]\nb: *x\n": "not readable YAML",
    "!!python/object/apply:os.system ['true']": "not readable YAML",
    "a: " + 40 * "[" + 40 * "]": "not readable YAML",
    "image_width: 3": "neither camera_matrix nor intrinsics",
    ROS.replace("458.5", ".nan"): "camera matrix is not a list of finite numbers",
    ROS.replace("458.5", "-458.5"): "impossible camera",
    ROS.replace("[458.5, 0.,", "[458.5, 0.1,"): "3 x 3 without skew",
    ROS.replace("plumb_bob", "thin_prism"): "distortion model thin_prism",
    ROS.replace("752", "0"): "image size is not two positive whole numbers",
    ROS.replace("1.8e-5, 0.0]", "word, 0.0]"): "distortion coefficients is not a list of finite numbers",
    KALIBR.replace("pinhole", "omni"): "camera_model is omni",
    KALIBR.replace("[-0.28, 0.07,", "["): "2 distortion coefficients",
    KALIBR.replace("458.5, ", ""): "intrinsics hold 3 numbers",
}


@pytest.mark.parametrize("number", range(len(WRONG)))
def test_a_malformed_file_is_one_clear_error(tmp_path, number):
    text, message = list(WRONG.items())[number]
    path = tmp_path / "camera.yaml"
    path.write_text(text)
    with pytest.raises(DataError, match=r"camera\.yaml: ") as caught:
        read_camera(path)
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_missing_or_huge_file(tmp_path):
    with pytest.raises(DataError, match="no such file"):
        read_camera(tmp_path / "none.yaml")
    (tmp_path / "huge.yaml").write_bytes(b"a" * 100_000)
    with pytest.raises(DataError, match="larger than a camera file"):
        read_camera(tmp_path / "huge.yaml")


@pytest.fixture
def lens():
    return Lens(60.0, 60.0, 47.5, 31.5, (-0.3, 0.1, 0.001, -0.002), False, (96, 64))


def test_a_straight_line_is_straight_again(lens):
    """A distorted image of a known one is undistorted to it, where both show it."""
    pinhole = lens.pinhole((64, 96))
    pattern = lambda p: 128 + 60 * np.sin(p[..., 0] / 7) * np.cos(p[..., 1] / 9)  # noqa: E731
    grid = pinhole.pixel_grid().reshape(64, 96, 2)
    seen = cv2.undistortPoints(grid.reshape(-1, 1, 2), pinhole.K, np.array(lens.coefficients), P=pinhole.K)
    distorted = pattern(seen.reshape(64, 96, 2)).round().astype(np.uint8)
    found = lens.undistort(distorted)[12:-12, 16:-16]
    assert np.abs(found - pattern(grid)[12:-12, 16:-16]).max() < 3


def test_a_folder_is_undistorted_as_it_is_read(tmp_path, lens):
    folder = tmp_path / "images"
    folder.mkdir()
    rng = np.random.default_rng(0)
    image = cv2.GaussianBlur(rng.integers(0, 255, (64, 96), np.uint8), (0, 0), 2)
    for k in range(3):
        cv2.imwrite(str(folder / f"{k}.png"), image)
    path = tmp_path / "camera.yaml"
    k1, k2, p1, p2 = lens.coefficients
    path.write_text(
        f"cam0:\n  camera_model: pinhole\n  distortion_model: radtan\n  resolution: [96, 64]\n"
        f"  intrinsics: [60, 60, 47.5, 31.5]\n  distortion_coeffs: [{k1}, {k2}, {p1}, {p2}]\n"
    )
    sequence = open_sequence(folder, camera=str(path), frames_per_second=10)
    assert sequence.camera == lens.pinhole((64, 96))
    np.testing.assert_array_equal(sequence.image(1), lens.undistort(image))
    assert (len(sequence), sequence.timestamp(2)) == (3, 0.2)
    with pytest.raises(DataError, match="no depth"):
        sequence.depth(0)
    path.write_text(path.read_text().replace("96, 64", "96, 65"))
    with pytest.raises(DataError, match="made for images of 96 x 65 pixels, these are 96 x 64"):
        open_sequence(folder, camera=path)
    with pytest.raises(DataError, match="no such file; expected f,cx,cy"):
        open_sequence(folder, camera="none.yaml")


def test_depth_is_undistorted_with_the_images(tmp_path, lens):
    """A frontal plane keeps its depth, and its flow is that of the pinhole camera."""
    from scipy.spatial.transform import RigidTransform

    from flowlik.datasets.frames import DepthFrames
    from flowlik.datasets.lens import Undistorted

    class Plane(DepthFrames):
        camera = lens.pinhole((64, 96))

        def depth(self, k):
            return np.full((64, 96), 2.0)

        def T_n_c(self, k):
            return RigidTransform.from_translation([0.1 * k, 0, 0])

    for k in range(2):
        cv2.imwrite(str(tmp_path / f"{k}.png"), np.zeros((64, 96), np.uint8))
    sequence = Undistorted(Plane("plane", sorted(tmp_path.iterdir())), lens)
    flow = sequence.flow(0)
    known = np.isfinite(flow).all(axis=-1)
    assert known[16:-16, 20:-20].all()
    np.testing.assert_allclose(flow[known], np.tile([-3.0, 0.0], (known.sum(), 1)), atol=1e-12)
    assert sequence.visible(0)[32, 48]
