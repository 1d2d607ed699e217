"""Camera files as ROS, OpenCV, Kalibr, ORB-SLAM, Basalt, COLMAP, KITTI and nerfstudio write them."""

import json
import re

import numpy as np
import pytest

from flowlik.datasets import read_camera
from flowlik.datasets._lens_models import BrownConrady, DoubleSphere, KannalaBrandt
from flowlik.errors import DataError

from .camera_files import (
    ALPHA,
    COLMAP,
    CX,
    CY,
    EUROC,
    FISHEYE,
    FX,
    FY,
    KALIBR,
    KALIBR_DS,
    KITTI,
    KITTI_RAW,
    ORB_SLAM_2,
    ORB_SLAM_3,
    ORB_SLAM_STEREO,
    ROS,
    ROS_ECHO,
    SIZE,
    XI,
    D,
    basalt,
    transforms,
    written_by_opencv,
)

PERSPECTIVE = {
    "ros": ROS,
    "ros2 topic echo": ROS_ECHO,
    "its closing line": ROS_ECHO + "---\n",
    "several messages": ROS_ECHO + "---\n" + ROS_ECHO.replace("sec: 1,", "sec: 2,") + "---\n",
    "kalibr": KALIBR,
    "euroc": EUROC,
    "orb-slam 2": ORB_SLAM_2,
    "orb-slam 3": re.sub(r"Camera\.(?=[a-z]\w:)", "Camera1.", ORB_SLAM_2 + "Camera.type: 'PinHole'\n"),
    "colmap": COLMAP,
    "colmap full": COLMAP.replace("OPENCV", "FULL_OPENCV").replace("1.8e-05", "1.8e-05 0 0 0 0"),
    "nerfstudio": transforms(),
    "instant-ngp": transforms(camera_model=None, is_fisheye=False, camera_angle_x=1.3),
    "frames' own": transforms(fl_x=None, frames=[{"fl_x": FX, "file_path": "a"}, {"fl_x": FX}]),
    "basalt": basalt("pinhole-radtan8", k1=D[0], k2=D[1], p1=D[2], p2=D[3], k3=0, k4=0, k5=0, k6=0, rpmax=0),
}  # fmt: skip
ROWS = ("-0.28, 0.07, 0.0002, 1.8e-", "0.0034, 0.0007, -0.002, 2e-")
TERMS = {"k1": 0.0034, "k2": 0.0007, "k3": -0.002, "k4": 2e-5, "p1": 0, "p2": 0}
FISHEYES = {
    "ros": ROS.replace("plumb_bob", "equidistant").replace(*ROWS),
    "kalibr": KALIBR.replace("radtan", "equidistant").replace(*ROWS),
    "orb-slam": ORB_SLAM_3,
    "colmap": COLMAP.replace("OPENCV", "OPENCV_FISHEYE").replace(*(row.replace(",", "") for row in ROWS)),
    "nerfstudio": transforms(camera_model="OPENCV_FISHEYE", **TERMS),
    "instant-ngp": transforms(camera_model=None, is_fisheye=True, **TERMS),
    "basalt": basalt("kb4", **TERMS),
}  # fmt: skip


def save(tmp_path, text, name="camera.txt"):
    path = tmp_path / name
    path.write_text(text)
    return path


def check(lens, model, coefficients):
    np.testing.assert_allclose((lens.fx, lens.fy, lens.cx, lens.cy), (FX, FY, CX, CY), rtol=1e-12)
    assert lens.size == SIZE
    assert type(lens.model) is model
    assert len(lens.model.coefficients) >= len(coefficients)
    np.testing.assert_allclose(lens.model.coefficients[: len(coefficients)], coefficients)
    assert not any(lens.model.coefficients[len(coefficients) :])


@pytest.mark.parametrize("name", PERSPECTIVE)
def test_all_formats_tell_the_same_camera(tmp_path, name):
    check(read_camera(save(tmp_path, PERSPECTIVE[name])), BrownConrady, D)


@pytest.mark.parametrize("name", FISHEYES)
def test_all_formats_tell_the_same_fisheye(tmp_path, name):
    check(read_camera(save(tmp_path, FISHEYES[name])), KannalaBrandt, FISHEYE)


@pytest.mark.parametrize("suffix", ["yml", "xml", "json"])
def test_opencvs_own_files(tmp_path, suffix):
    """Its calibration program says fisheye_model beside four coefficients, and nothing otherwise."""
    for fisheye, model, coefficients in [(False, BrownConrady, D), (True, KannalaBrandt, FISHEYE)]:
        written_by_opencv(tmp_path / f"camera.{suffix}", fisheye)
        check(read_camera(tmp_path / f"camera.{suffix}"), model, coefficients)


@pytest.mark.parametrize("text", [KALIBR_DS, basalt("ds", xi=XI, alpha=ALPHA)])
def test_double_spheres(tmp_path, text):
    lens = read_camera(save(tmp_path, text))
    assert lens.model == DoubleSphere(XI, ALPHA)
    assert (lens.fx, lens.fy, lens.cx, lens.cy, lens.size) == (FX, FY, CX, CY, SIZE)


@pytest.mark.parametrize(
    ("row", "expected"),
    [
        ("SIMPLE_PINHOLE 752 480 450 376 240", ()),
        ("PINHOLE 752 480 450 450 376 240", ()),
        ("SIMPLE_RADIAL 752 480 450 376 240 -0.1", (-0.1, 0)),
        ("RADIAL 752 480 450 376 240 -0.1 0.02", (-0.1, 0.02)),
        ("SIMPLE_RADIAL_FISHEYE 752 480 450 376 240 -0.1", (-0.1, 0)),
        ("RADIAL_FISHEYE 752 480 450 376 240 -0.1 0.02", (-0.1, 0.02)),
    ],
)
def test_colmaps_smaller_models(tmp_path, row, expected):
    """The middle of 752 x 480 pixels is (376, 240) from the corner, (375.5, 239.5) from a pixel's centre."""
    lens = read_camera(save(tmp_path, f"7 {row}\n"))
    assert (lens.fx, lens.fy, lens.cx, lens.cy) == (450, 450, 375.5, 239.5)
    assert isinstance(lens.model, KannalaBrandt if "FISHEYE" in row else BrownConrady)
    assert lens.model.coefficients[:2] == (expected or (0, 0))
    assert lens.distorts == bool(expected)


def test_a_field_of_view_is_a_focal_length(tmp_path):
    """Blender's and the first NeRF's way: tan(angle / 2) = width / 2 f, and the middle of the image."""
    text = json.dumps({"camera_angle_x": 2 * np.arctan(376 / 450), "w": 752, "h": 480, "frames": []})
    lens = read_camera(save(tmp_path, text))
    np.testing.assert_allclose((lens.fx, lens.fy, lens.cx, lens.cy), (450, 450, 375.5, 239.5))
    assert not lens.distorts


@pytest.mark.parametrize("name", [None, "P0", "P2"])
def test_kittis_rectified_cameras_are_all_alike(tmp_path, name):
    lens = read_camera(save(tmp_path, KITTI), name)
    assert (lens.fx, lens.fy, lens.cx, lens.cy, lens.size) == (700, 700, 600, 180, None)
    assert not lens.distorts


def test_kitti_raw_tells_the_size_too(tmp_path):
    lens = read_camera(save(tmp_path, KITTI_RAW))
    assert (lens.fx, lens.cx, lens.size) == (700, 600, (1242, 375))


def test_a_row_of_four_numbers(tmp_path):
    lens = read_camera(save(tmp_path, "726.28741455078 726.28741455078 354.6496887207 186.46566772461\n"))
    assert (lens.fx, lens.cy, lens.size) == (726.28741455078, 186.46566772461, None)


CHAIN = KALIBR.rpartition("  camera_model")[0] + KALIBR_DS.partition("\n")[2]


def test_one_of_several_cameras_is_chosen(tmp_path):
    """Without a choice it is Kalibr's cam0 and ORB-SLAM's Camera1; elsewhere one must be chosen."""
    chain = save(tmp_path, CHAIN)
    assert isinstance(read_camera(chain).model, BrownConrady)
    assert read_camera(chain, "cam1").model == DoubleSphere(XI, ALPHA)
    assert read_camera(save(tmp_path, ORB_SLAM_3), "Camera2").fx == 450
    stereo = save(tmp_path, ORB_SLAM_STEREO)
    check(read_camera(stereo, "LEFT"), BrownConrady, D)
    assert read_camera(stereo, "Camera").fx == 435.2
    two = save(tmp_path, COLMAP + "2 PINHOLE 752 480 450 450 376 240\n", "cameras.txt")
    assert read_camera(two, "2").fx == 450
    for path, names in [(stereo, "Camera, LEFT"), (two, "1, 2")]:
        path = save(tmp_path, ORB_SLAM_STEREO) if path is stereo else path
        with pytest.raises(DataError, match=f"several cameras, choose one as FILE:NAME of {names}"):
            read_camera(path)
    with pytest.raises(DataError, match="no camera 3, there are 1, 2"):
        read_camera(two, "3")
    same = save(tmp_path, COLMAP + COLMAP.splitlines()[-1].replace("1", "2", 1) + "\n")
    check(read_camera(same), BrownConrady, D)


@pytest.mark.parametrize("model", ["none", "None", ""])
def test_without_a_model_there_is_no_distortion(tmp_path, model):
    text = KALIBR.replace("radtan", f"'{model}'").replace("-0.28, 0.07, 0.0002, 1.8e-05", "0, 0, 0, 0")
    assert not read_camera(save(tmp_path, text)).distorts


def test_zeros_beyond_a_fisheyes_coefficients(tmp_path):
    """Drivers publish five of an equidistant lens, the last 0."""
    check(read_camera(save(tmp_path, FISHEYES["ros"])), KannalaBrandt, FISHEYE)


WRONG = {
    "": "not a mapping",
    "- 1\n- 2\n": "not a mapping.*expected a camera file: ROS camera_info, OpenCV .*transforms.json",
    "a: [1": "not readable YAML",
    "a: &x [1]\nb: *x\n": "not readable YAML",
    "!!python/object/apply:os.system ['true']": "not readable YAML",
    "a: " + 40 * "[" + 40 * "]": "not readable YAML",
    "{1": "not readable",
    "<a>": "not readable XML",
    "<opencv_storage><!DOCTYPE a></opencv_storage>": "not readable XML",
    "<opencv_storage></opencv_storage>": "neither camera_matrix nor intrinsics",
    "<Calibration/>": "not readable XML",
    "image_width: 3": "neither camera_matrix nor intrinsics",
    ROS.replace("458.5", ".nan"): "camera matrix is not a list of finite numbers",
    ROS.replace("458.5", "-458.5"): "impossible camera",
    ROS.replace("[458.5, 0.,", "[458.5, 0.31,"): "a skew of 0.31: only cameras without skew",
    ROS.replace("[458.5, 0., 367.0, 0.0", "[458.5, 0., 0., 367.0"): "not the matrix of a camera",
    ROS.replace("367.0, 0.0", "0.0"): "8 numbers are no camera matrix",
    ROS.replace("plumb_bob", "thin_prism_fisheye"): "distortion model 'thin_prism_fisheye' is not known, "
    "known are none, plumb_bob, radtan, radial-tangential, rational_polynomial, brown_conrady, equidistant, ",
    ROS.replace("plumb_bob", "''"): "distortion coefficients, but no distortion model",
    ROS.replace("plumb_bob", "none"): "distortion coefficients, but model 'none'",
    ROS.replace("plumb_bob", "equidistant").replace("e-5, 0.0", "e-5, 0.1"): "5 distortion coefficients",
    ROS.replace("752", "0"): "image size is not two positive whole numbers",
    ROS.replace("752", "752.5"): "image size is not two positive whole numbers",
    ROS.replace("1.8e-5, 0.0]", "word, 0.0]"): "distortion coefficients is not a list of finite numbers",
    ROS_ECHO + "---\n" + ROS_ECHO.replace("458.5", "459"): "holds several cameras, choose one .*message 1",
    KALIBR.replace("pinhole", "omni"): "camera_model omni is not known, known are pinhole and ds",
    KALIBR.replace("radtan", "fov"): "distortion model 'fov' is not known",
    KALIBR.replace("[-0.28, 0.07,", "["): "2 distortion coefficients",
    KALIBR.replace("458.5, ", ""): "intrinsics hold 3 numbers, expected fx",
    KALIBR.replace("  distortion_model: radtan\n", ""): "distortion coefficients, but no distortion model",
    KALIBR_DS.replace("-0.17, ", ""): "intrinsics hold 5 numbers, expected xi",
    KALIBR_DS.replace("0.59", "1.59"): "double sphere with xi -0.17 and alpha 1.59",
    KALIBR_DS.replace("coeffs: []", "coeffs: [0.1, 0, 0, 0]"): "double sphere with distortion coefficients",
    ORB_SLAM_2.replace("Camera.fy", "Camera.f_y"): "no Camera.fy",
    ORB_SLAM_2.replace("Camera.k2", "Camera.k_2"): "no Camera.k2",
    ORB_SLAM_2.replace("367.0", "wide"): "Camera.cx is 'wide', not a finite number",
    ORB_SLAM_2.replace("Camera.p2", "Camera.k4"): "Camera.k4 of a PinHole camera is not known",
    ORB_SLAM_2 + "Camera.bFishEye: 1\n": "Camera.bFishEye beside the type PinHole",
    ORB_SLAM_3.replace("KannalaBrandt8", "Omni"): "Camera.type Omni is not known, known are PinHole, Kannala",
    ORB_SLAM_3.replace("Camera1.k3: -0.002\n", ""): "no Camera1.k3",
    ORB_SLAM_3.replace('"KannalaBrandt8"', '"Rectified"'): "Camera1.k1 of a Rectified camera is not known",
    COLMAP.replace("OPENCV", "FOV"): "line 4: camera model FOV is not known, known are SIMPLE_PINHOLE",
    COLMAP.replace(" 1.8e-05", ""): "line 4: 7 parameters of OPENCV, expected fx fy cx cy k1 k2 p1 p2",
    COLMAP.replace("458.5", "nan"): "line 4: 'nan' is not a finite number",
    COLMAP + COLMAP.splitlines()[-1]: "stands there twice",
    KITTI.replace("P1: 7.0e+02", "P1: 7.1e+02"): "several cameras, choose one as FILE:NAME of P0, P1, P2",
    KITTI.replace("P0: 7.0e+02", "P0:"): "line 1: not a KITTI calibration row",
    KITTI.replace("P0: 7.0e+02 0", "P0: 7.0e+02 1"): "a skew of 1",
    KITTI + "what is this\n": "line 8: not a KITTI calibration row",
    KITTI + "P0: 1 0 0 0 0 1 0 0 0 0 1 0\n": "line 8: P0 stands there twice",
    transforms(camera_model="EQUIRECTANGULAR"): "camera_model EQUIRECTANGULAR is not known, known are OPENCV",
    transforms(camera_model="OPENCV", is_fisheye=True): "camera_model OPENCV with is_fisheye",
    transforms(camera_model="A\nB"): r"camera_model A\\nB is not known",
    transforms(k4=0.1): "camera_model OPENCV with k4",
    transforms(camera_model="OPENCV_FISHEYE"): "camera_model OPENCV_FISHEYE with p1 and p2",
    transforms(fl_x=None): "no fl_x",
    transforms(w=None): "no w",
    transforms(fl_x="wide"): "fl_x is 'wide', not a finite number",
    transforms(frames=[{"fl_x": 1.0}, {"fl_x": 2.0}]): "frames have cameras of their own, which differ",
    basalt("eucm", alpha=0.5, beta=1): "camera_type eucm is not known, known are pinhole, kb4, ",
    basalt("ds", xi=0.1): "no intrinsics alpha",
}  # fmt: skip


@pytest.mark.parametrize("number", range(len(WRONG)))
def test_a_malformed_file_is_one_clear_error(tmp_path, number):
    text, message = list(WRONG.items())[number]
    with pytest.raises(DataError, match=rf"camera\.txt: .*{message}") as caught:
        read_camera(save(tmp_path, text))
    assert "\n" not in str(caught.value)


def test_a_missing_or_huge_file(tmp_path):
    with pytest.raises(DataError, match="no such file"):
        read_camera(tmp_path / "none.yaml")
    (tmp_path / "huge.yaml").write_bytes(b"a" * 100_000)
    with pytest.raises(DataError, match="larger than a camera file"):
        read_camera(tmp_path / "huge.yaml")
