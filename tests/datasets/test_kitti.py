import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from flowlik.datasets import FORMATS, guess_format, open_sequence, read_grey
from flowlik.datasets.kitti import KittiOdometry, read_calibration
from flowlik.errors import DataError
from flowlik.geometry.trajectory import Trajectory, write_kitti

WIDTH, HEIGHT = 40, 30
P0 = "P0: 50 0 20 0 0 50 15 0 0 0 1 0"
# Camera 2 sees a point of camera 0 shifted by (0.06, -0.02, 0.01) m: the last column is K t.
P2 = "P2: 60 0 21 3.81 0 60 16 -1.04 0 0 1 0.01"
T_2_0 = np.array([0.06, -0.02, 0.01])


def make_poses(count: int) -> RigidTransform:
    turns = Rotation.from_rotvec(np.outer(np.arange(count), [0.01, 0.2, -0.03]))
    return RigidTransform.from_components(np.outer(np.arange(count), [0.1, 0, 1.0]), turns)


def make_sequence(
    folder: Path, count: int = 4, images: str = "image_0", calibration: str = P0 + "\n" + P2
) -> Path:
    """A tiny sequence in KITTI's layout, without times and poses."""
    (folder / images).mkdir(parents=True)
    rng = np.random.default_rng(0)
    for k in range(count):
        cv2.imwrite(
            str(folder / images / f"{k:06d}.png"), rng.integers(0, 256, (HEIGHT, WIDTH), dtype=np.uint8)
        )
    (folder / "calib.txt").write_text(calibration + "\n")
    return folder


def write_poses(path: Path, count: int) -> None:
    write_kitti(path, Trajectory(np.arange(count), make_poses(count)))


def test_a_clip_with_its_own_poses(tmp_path):
    folder = make_sequence(tmp_path / "03")
    write_poses(folder / "poses.txt", 4)
    sequence = open_sequence(folder)
    assert sequence.name == "kitti/03"
    assert len(sequence) == 4
    camera = sequence.camera
    assert (camera.width, camera.height, camera.fx, camera.cy) == (WIDTH, HEIGHT, 50, 15)
    np.testing.assert_array_equal(sequence.image(2), read_grey(folder / "image_0" / "000002.png"))
    for k in range(4):
        np.testing.assert_allclose(sequence.T_n_c(k).as_matrix(), make_poses(4)[k].as_matrix(), atol=1e-12)


def test_official_layout(tmp_path):
    folder = make_sequence(tmp_path / "sequences" / "07")
    (tmp_path / "poses").mkdir()
    write_poses(tmp_path / "poses" / "07.txt", 4)
    assert KittiOdometry(folder).T_n_c(3).translation == pytest.approx([0.3, 0, 3])


def test_a_pose_file_may_be_named(tmp_path):
    folder = make_sequence(tmp_path / "a")
    write_poses(tmp_path / "elsewhere.txt", 4)
    assert KittiOdometry(folder, poses=tmp_path / "elsewhere.txt").T_n_c(1).translation[2] == 1


def test_times_come_from_the_file_or_from_the_frame_rate(tmp_path):
    folder = make_sequence(tmp_path / "a")
    plain = KittiOdometry(folder)
    assert (plain.timestamp(3), plain.times_source) == (0.3, "frame/10s")
    (folder / "times.txt").write_text("0\n0.11\n0.2\n0.35\n")
    timed = KittiOdometry(folder)
    assert (timed.timestamp(3), timed.times_source) == (0.35, "times.txt")


def test_poses_are_those_of_the_camera_whose_images_are_read(tmp_path):
    folder = make_sequence(tmp_path / "a", images="image_2")
    write_poses(folder / "poses.txt", 4)
    sequence = KittiOdometry(folder)
    assert (sequence.camera.fx, sequence.camera.cx) == (60, 21)
    in_camera_0 = np.array([1.0, 2.0, 10.0])
    for k in range(4):
        world = make_poses(4)[k].apply(in_camera_0)
        np.testing.assert_allclose(sequence.T_n_c(k).inv().apply(world), in_camera_0 + T_2_0, atol=1e-12)


def test_grey_is_preferred_over_colour(tmp_path):
    folder = make_sequence(tmp_path / "a", images="image_2")
    make_sequence(tmp_path / "b")
    (tmp_path / "b" / "image_0").rename(folder / "image_0")
    assert KittiOdometry(folder).camera.fx == 50


def test_without_poses_only_poses_are_missing(tmp_path):
    sequence = KittiOdometry(make_sequence(tmp_path / "05"))
    sequence.image(0)
    for field, read in [("poses", sequence.T_n_c), ("depth", sequence.depth), ("true flow", sequence.flow)]:
        with pytest.raises(DataError, match=f"kitti/05: this data set has no {field}"):
            read(0)


def test_pose_rows_must_be_there_for_all_images(tmp_path):
    folder = make_sequence(tmp_path / "a")
    write_poses(folder / "poses.txt", 3)
    with pytest.raises(DataError, match=r"poses\.txt: 3 poses for the 4 images numbered 0 to 3, expected 4"):
        KittiOdometry(folder).T_n_c(0)


def test_a_pose_file_of_another_layout(tmp_path):
    folder = make_sequence(tmp_path / "a")
    (folder / "poses.txt").write_text("0 0 0 0 0 0 0 1\n" * 4)
    with pytest.raises(DataError, match=r"poses\.txt, line 1: 8 columns, but expected 12"):
        KittiOdometry(folder).T_n_c(0)


@pytest.mark.parametrize("k", [-1, 4])
def test_frames_outside_the_sequence(tmp_path, k):
    folder = make_sequence(tmp_path / "a")
    write_poses(folder / "poses.txt", 4)
    sequence = KittiOdometry(folder)
    for read in (sequence.image, sequence.timestamp, sequence.T_n_c):
        with pytest.raises(DataError, match="there are 4 frames"):
            read(k)


OTHER_ROWS = [
    "R0_rect: 1 0 0 0 1 0 0 0 1",
    "R_rect_00: 1 0 0 0 1 0 0 0 1",
    "R_rect 1 0 0 0 1 0 0 0 1",  # of the tracking benchmark, without a colon
    "Tr_velo_cam 1 0 0 0 0 1 0 0 0 0 1 0",
    "Tr_velo_to_cam: 1 0 0 0 0 1 0 0 0 0 1 0",
    "Tr: 1 0 0 0 0 1 0 0 0 0 1 0",
    "calib_time: 09-Jan-2012 13:57:47",
]


def test_rows_of_other_benchmarks_are_passed_over(tmp_path):
    """They turn laser points and raw images; the images here are rectified."""
    plain = KittiOdometry(make_sequence(tmp_path / "a"))
    other = KittiOdometry(make_sequence(tmp_path / "b", calibration="\n".join([P0, *OTHER_ROWS, P2])))
    assert other.camera == plain.camera


@pytest.mark.parametrize(
    ("calibration", "message"),
    [
        ("", "empty"),
        ("R0_rect: 1 0 0 0 1 0 0 0 1", "no row P0.*rows: none of a camera"),
        (P0 + "\nR0_rect:", "line 2: not a KITTI calibration row"),
        (P0 + "\n" + P0, "line 2: P0 stands there twice"),
        (P0.replace("50 0 20", "50 0.3 20"), "row P0: not the projection matrix.*a skew of 0.3"),
        (P0.replace("20", "30").replace("15", "20"), "far from the middle"),  # of images of another size
        ("hello world", "line 1: not a KITTI calibration row"),
        (P0 + "\nP1: 1 2 3", "line 2: not a KITTI calibration row"),
        (P0.replace("50", "x", 1), "line 1: 'x' is not a finite number"),
        (P0.replace("50", "nan", 1), "line 1: 'nan'"),
        (P2, "no row P0.*rows: P2"),
        (P0.replace("50", "0", 1), "row P0: not the projection matrix"),
        (P0.replace("0 0 1 0", "0 0 0 1"), "row P0: not the projection matrix"),
    ],
)
def test_what_is_no_calibration_is_refused_at_once(tmp_path, calibration, message):
    folder = make_sequence(tmp_path / "a", calibration=calibration)
    with pytest.raises(DataError, match=r"calib\.txt.*" + message) as caught:
        KittiOdometry(folder)
    assert "\n" not in str(caught.value)


def no_calibration(folder):
    (folder / "calib.txt").unlink()
    return "calib.txt: no such file"


def binary_calibration(folder):
    (folder / "calib.txt").write_bytes(b"\x89PNG\xff\xfe")
    return "calib.txt: not a text file"


def a_gap(folder):
    (folder / "image_0" / "000002.png").unlink()
    return "missing between 000001.png and 000003.png"


def a_stray_name(folder):
    (folder / "image_0" / "000002.png").rename(folder / "image_0" / "left.png")
    return "left.png: images must be named by frame number"


def no_images(folder):
    for path in (folder / "image_0").iterdir():
        path.unlink()
    return "no images"


def no_image_folder(folder):
    (folder / "image_0").rename(folder / "image_1")
    return "no folder image_0 or image_2"


def times_back(folder):
    (folder / "times.txt").write_text("0\n2\n1\n3\n")
    return "times.txt: times must increase"


def times_short(folder):
    (folder / "times.txt").write_text("0\n1\n")
    return "2 times for the 4 images"


def first_image_truncated(folder):
    path = folder / "image_0" / "000000.png"
    path.write_bytes(path.read_bytes()[:200])
    return "000000.png: not a readable image"


@pytest.mark.parametrize(
    "change",
    [
        no_calibration,
        binary_calibration,
        a_gap,
        a_stray_name,
        no_images,
        no_image_folder,
        times_back,
        times_short,
        first_image_truncated,
    ],
)
def test_a_damaged_sequence_is_refused_when_opened(tmp_path, change):
    folder = make_sequence(tmp_path / "a")
    message = change(folder)
    with pytest.raises(DataError, match=message):
        open_sequence(folder, "kitti")


def test_images_of_another_size_and_truncated_ones_are_refused_when_read(tmp_path):
    folder = make_sequence(tmp_path / "a")
    cv2.imwrite(str(folder / "image_0" / "000001.png"), np.zeros((HEIGHT + 1, WIDTH), np.uint8))
    path = folder / "image_0" / "000002.png"
    path.write_bytes(path.read_bytes()[:-20])
    sequence = KittiOdometry(folder)
    with pytest.raises(DataError, match=r"000001\.png: 40 x 31 pixels, but the first image has 40 x 30"):
        sequence.image(1)
    with pytest.raises(DataError, match=r"000002\.png: not a readable image"):
        sequence.image(2)


def test_formats_are_guessed_by_layout(tmp_path):
    assert guess_format(make_sequence(tmp_path / "a")) == "kitti"
    (tmp_path / "b" / "image_lcam_front").mkdir(parents=True)
    assert guess_format(tmp_path / "b") == "tartanair"
    (tmp_path / "c").mkdir()
    with pytest.raises(DataError, match="not the folder of a known data set"):
        guess_format(tmp_path / "c")
    with pytest.raises(DataError, match=r"holds data sets and is none; give one of them: .*a, .*b$"):
        guess_format(tmp_path)
    with pytest.raises(DataError, match="no such file or folder"):
        open_sequence(tmp_path / "none")
    with pytest.raises(DataError, match="no such folder"):
        open_sequence(tmp_path / "none", "kitti")
    with pytest.raises(DataError, match=f"unknown data set format 'x', known are {', '.join(FORMATS)}"):
        open_sequence(tmp_path / "a", "x")


def test_importing_the_registry_imports_no_reader():
    code = (
        "import sys, flowlik.datasets; print([m for m in sys.modules if m.startswith('flowlik.datasets.')])"
    )
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    assert "kitti" not in out
    assert "tartanair" not in out


@pytest.mark.parametrize(("clip", "frames"), [("00", 6), ("01", 51), ("02", 12), ("03", 300)])
def test_real_clips_open(shared_data, clip, frames):
    sequence = open_sequence(shared_data / "kitti_odometry" / clip)
    assert len(sequence) == frames
    assert sequence.image(frames - 1).shape == (sequence.camera.height, sequence.camera.width)
    assert sequence.times_source == ("times.txt" if clip in ("00", "02") else "frame/10s")


def test_the_real_colour_camera_is_six_centimetres_beside_the_grey_one(shared_data):
    _, t_2_0 = read_calibration(shared_data / "kitti_odometry/02/calib.txt", "P2")
    np.testing.assert_allclose(t_2_0, [0.06, 0, 0], atol=0.005)


@pytest.mark.parametrize(("clip", "k"), [("03", 150), ("02", 5), ("01", 40)])
def test_motion_of_real_images_agrees_with_calibration_and_poses(shared_data, clip, k):
    """Tracked points lie on the epipolar lines of the camera and poses read."""
    sequence = open_sequence(shared_data / "kitti_odometry" / clip)
    first, second = sequence.image(k), sequence.image(k + 1)
    corners = cv2.goodFeaturesToTrack(first, 500, 0.01, 10)
    tracked, found, _ = cv2.calcOpticalFlowPyrLK(first, second, corners, None)
    a, b = (sequence.camera.rays(p.reshape(-1, 2)[found.ravel() == 1]) for p in (corners, tracked))
    T_2_1 = sequence.T_n_c(k + 1).inv() * sequence.T_n_c(k)
    normals = np.cross(T_2_1.translation, T_2_1.rotation.apply(a))
    distance_px = (
        sequence.camera.fx * np.abs((normals * b).sum(axis=1)) / np.linalg.norm(normals[:, :2], axis=1)
    )
    assert np.median(distance_px) < 0.6
