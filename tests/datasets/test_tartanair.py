import json
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from flowlik.datasets.tartanair import TartanAir, encode_depth, encode_flow, encode_poses
from flowlik.datasets.tartanair._files import decode_poses
from flowlik.errors import DataError
from flowlik.geometry.camera import Pinhole

CAMERA = {"width": 12, "height": 8, "fx": 10, "fy": 10, "cx": 5.5, "cy": 3.5, "frames_per_second": 20}


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Three images, two depths and three poses of a camera that moves by 1 m towards a wall."""
    root = tmp_path / "P000"
    for kind in ("image", "depth"):
        (root / f"{kind}_lcam_front").mkdir(parents=True)
    for k in range(3):
        image = np.full((8, 12, 3), 50 * k, np.uint8)
        cv2.imwrite(str(root / f"image_lcam_front/{k:06d}_lcam_front.png"), image)
    for k in range(2):
        depth = encode_depth(np.full((8, 12), 10.0 - k))
        cv2.imwrite(str(root / f"depth_lcam_front/{k:06d}_lcam_front_depth.png"), depth)
    # NED: forward is x
    np.savetxt(root / "pose_lcam_front.txt", [[k, 0, 0, 0, 0, 0, 1] for k in range(3)])
    (root / "camera.json").write_text(json.dumps(CAMERA))
    return root


def test_depth_and_poses_give_the_data_sets_own_flow(shared_data: Path) -> None:
    root = shared_data / "tartanair_v2" / "abs_P000"
    sequence = TartanAir(root)
    assert len(sequence) == 6 and sequence.camera.fx == 320
    assert sequence.timestamp(3) == pytest.approx(0.3)
    for k in range(5):
        channels = cv2.imread(
            str(root / f"flow_lcam_front/{k:06d}_{k + 1:06d}_flow.png"), cv2.IMREAD_UNCHANGED
        )
        published = (channels[..., :2].astype(np.float64) - 32768) / 64
        difference = np.linalg.norm(sequence.flow(k) - published, axis=-1)
        assert np.median(difference[channels[..., 2] == 0]) < 0.06
    assert np.mean(sequence.visible(0)) > 0.8


def test_last_image_without_depth_is_one_clear_error(shared_data: Path) -> None:
    sequence = TartanAir(shared_data / "tartanair_v2" / "abs_P000")
    assert sequence.image(5).shape == (640, 640)
    for field in (sequence.depth, sequence.flow):
        with pytest.raises(DataError, match="abs_P000"):
            field(5)


def test_flow_of_a_camera_that_approaches_a_wall(folder: Path) -> None:
    sequence = TartanAir(folder)
    np.testing.assert_allclose(sequence.T_n_c(2).translation, [0, 0, 2], atol=1e-15)
    from_centre = sequence.camera.pixel_grid().reshape(8, 12, 2) - [5.5, 3.5]
    np.testing.assert_allclose(sequence.flow(0), from_centre / 9, atol=1e-12)
    assert sequence.visible(0)[3, 5] and not sequence.visible(0)[0, 0]
    assert sequence.image(2).max() == 100 and sequence.timestamp(2) == pytest.approx(0.1)


def test_poses_survive_the_change_of_axes() -> None:
    rng = np.random.default_rng(0)
    poses = RigidTransform.from_components(rng.normal(size=(5, 3)), Rotation.random(5, rng=rng))
    np.testing.assert_allclose(decode_poses(encode_poses(poses)).as_matrix(), poses.as_matrix(), atol=1e-14)


def test_a_turn_to_the_right_is_a_turn_about_neds_z() -> None:
    right = RigidTransform.from_components([[1.0, 2.0, 3.0]], Rotation.from_rotvec([[0, 0.2, 0]]))
    row = encode_poses(right)[0]
    np.testing.assert_allclose(row[:3], [3, 1, 2])
    np.testing.assert_allclose(Rotation.from_quat(row[3:]).as_rotvec(), [0, 0, 0.2], atol=1e-15)


def test_flow_that_the_format_cannot_hold_is_masked() -> None:
    flow = np.zeros((2, 3, 2))
    flow[0, 0], flow[0, 1] = np.nan, 600.0
    channels = encode_flow(flow, np.ones((2, 3), bool) & np.isfinite(flow[..., 0]), Pinhole(3, 2, 1, 1, 1, 1))
    assert channels[0, 0, 2] == 200
    assert (channels[1] == [32768, 32768, 0]).all()


def _truncate_image(root: Path) -> None:
    path = root / "image_lcam_front/000000_lcam_front.png"
    path.write_bytes(path.read_bytes()[:60])


def _grow_image(root: Path) -> None:
    cv2.imwrite(str(root / "image_lcam_front/000000_lcam_front.png"), np.zeros((9, 12), np.uint8))


def _grow_depth(root: Path) -> None:
    cv2.imwrite(str(root / "depth_lcam_front/000000_lcam_front_depth.png"), encode_depth(np.ones((4, 4))))


def _grey_depth(root: Path) -> None:
    cv2.imwrite(str(root / "depth_lcam_front/000000_lcam_front_depth.png"), np.ones((8, 12), np.uint8))


def _no_poses(root: Path) -> None:
    (root / "pose_lcam_front.txt").unlink()


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (_truncate_image, "not a readable image"),
        (_grow_image, "image is 12x9, the camera is 12x8"),
        (_grow_depth, "image is 4x4, the camera is 12x8"),
        (_grey_depth, "8-bit PNG of 4 channels"),
        (_no_poses, "P000: this data set has no poses"),
    ],
)
def test_bad_files_are_named_when_they_are_used(
    folder: Path, spoil: Callable[[Path], None], message: str
) -> None:
    spoil(folder)
    sequence = TartanAir(folder)
    with pytest.raises(DataError, match=message):
        sequence.image(0)
        sequence.flow(0)


@pytest.mark.parametrize(
    ("poses", "message"),
    [
        ("1 2 3 0 0 0\n" * 3, "6 columns, but expected 7 numbers"),
        ("1 2 3 0 0 0 1\n" * 2, "2 poses for the 3 images numbered 0 to 2, expected 3"),
        ("1 2 3 0 0 0 0\n" * 3, "unit quaternion"),
        ("1 2 3 0 0 0 x\n" * 3, "line 1: 'x' is not a finite number"),
        ("1 2 3 0 0 0 1\n1 2\n1 2\n", "line 2: 2 columns"),
        ("", "empty, but expected rows of 7 numbers"),
    ],
)
def test_bad_pose_files_are_refused(folder: Path, poses: str, message: str) -> None:
    (folder / "pose_lcam_front.txt").write_text(poses)
    with pytest.raises(DataError, match=message):
        TartanAir(folder)


@pytest.mark.parametrize("content", ["{}", "nonsense", "[1]", json.dumps({**CAMERA, "fx": None})])
def test_bad_camera_files_are_refused(folder: Path, content: str) -> None:
    (folder / "camera.json").write_text(content)
    with pytest.raises(DataError, match=r"camera.json: must be a JSON object"):
        TartanAir(folder)


def test_times_of_a_file_are_taken(folder: Path) -> None:
    (folder / "times.txt").write_text("5.0\n5.5\n7.25\n")
    assert [TartanAir(folder).timestamp(k) for k in range(3)] == [5.0, 5.5, 7.25]


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("0\n1\n", "2 times for the 3 images"),
        ("0\n2\n1\n", "times must increase"),
        ("0\nx\n1\n", "not a finite number"),
    ],
)
def test_bad_times_are_refused(folder: Path, content: str, message: str) -> None:
    (folder / "times.txt").write_text(content)
    with pytest.raises(DataError, match=f"times.txt.*{message}"):
        TartanAir(folder)


def write_movers(folder: Path, label: int = 1) -> None:
    """One object, seen in the left half, that moves 0.5 m to the right a frame (NED y)."""
    labels = np.zeros((8, 12), np.uint8)
    labels[:, :6] = label
    (folder / "seg_lcam_front").mkdir(exist_ok=True)
    for k in range(3):
        cv2.imwrite(str(folder / f"seg_lcam_front/{k:06d}_lcam_front_seg.png"), labels)
    (folder / "movers.txt").write_text("".join(f"{k} 0 9 {0.5 * k} 0 0 0 0 1\n" for k in range(3)))


def test_flow_follows_what_moves(folder: Path) -> None:
    write_movers(folder)
    flow = TartanAir(folder).flow(0)
    static = (TartanAir(folder).camera.pixel_grid().reshape(8, 12, 2) - [5.5, 3.5]) / 9
    # 0.5 m at a depth of 10 m that becomes 9 m, seen with f = 10 px
    np.testing.assert_allclose(flow[:, :6], static[:, :6] + [10 * 0.5 / 9, 0], atol=1e-12)
    np.testing.assert_allclose(flow[:, 6:], static[:, 6:], atol=1e-12)


def test_bad_movers_are_refused(folder: Path) -> None:
    write_movers(folder, label=2)
    with pytest.raises(DataError, match=r"seg.png: shows object 1, movers.txt has 1"):
        TartanAir(folder).flow(0)
    rows = (folder / "movers.txt").read_text()
    for content, message in [
        (rows[: rows.rindex("2 0 9")], "every object of every one of 3 frames"),
        (rows.replace("1 0 9", "7 0 9"), "every object of every one of 3 frames"),
        (rows.replace(" 0 0 0 1", " 0 0 0 0"), "unit quaternion"),
        ("1 2 3\n", "3 columns"),
    ]:
        (folder / "movers.txt").write_text(content)
        with pytest.raises(DataError, match=f"movers.txt.*{message}"):
            TartanAir(folder)


def test_a_missing_right_image_is_one_clear_error(folder: Path) -> None:
    with pytest.raises(DataError, match="P000: this data set has no right image for frame 1"):
        TartanAir(folder).right_image(1)


def test_missing_folder_and_missing_images(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="no such folder"):
        TartanAir(tmp_path / "absent")
    with pytest.raises(DataError, match="not a TartanAir folder"):
        TartanAir(tmp_path)


@pytest.mark.parametrize("k", [-1, 3])
def test_frames_out_of_range_are_refused(folder: Path, k: int) -> None:
    with pytest.raises(DataError, match=f"no frame {k}, there are 3 frames"):
        TartanAir(folder).image(k)
