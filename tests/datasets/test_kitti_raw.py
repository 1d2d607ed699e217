import cv2
import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from flowlik.datasets import guess_format, open_sequence
from flowlik.datasets.kitti_raw import EARTH_RADIUS_M, KittiRaw, oxts_poses
from flowlik.errors import DataError, MissingFieldError
from flowlik.odometry.scale import scale_source

WIDTH, HEIGHT, LATITUDE = 40, 30, 49.0
# the unit looks along the car, the camera stands 1 m ahead of it, 0.3 m to the left, 0.5 m above
LEVER = np.array([1.0, 0.3, 0.5])
R_VELO_TO_CAM = "0 -1 0 0 0 -1 1 0 0"
IDENTITY = "1 0 0 0 1 0 0 0 1"


def oxts_row(east_m, north_m, up_m, yaw):
    """A row of 30 numbers, by the tangent plane at the latitude."""
    row = np.zeros(30)
    row[0] = LATITUDE + np.rad2deg(north_m / EARTH_RADIUS_M)
    row[1] = 8.0 + np.rad2deg(east_m / (EARTH_RADIUS_M * np.cos(np.deg2rad(LATITUDE))))
    row[2], row[5], row[23] = 110 + up_m, yaw, 0.05
    return row


def make_drive(tmp_path, count=4):
    """A tiny drive in KITTI raw's layout: a bend to the left."""
    day = tmp_path / "2011_09_26"
    drive = day / "2011_09_26_drive_0001_sync"
    for folder in ("image_00/data", "image_01/data", "oxts/data"):
        (drive / folder).mkdir(parents=True)
    rng = np.random.default_rng(0)
    for k in range(count):
        for folder in ("image_00", "image_01"):
            picture = rng.integers(0, 256, (HEIGHT, WIDTH), dtype=np.uint8)
            cv2.imwrite(str(drive / folder / "data" / f"{k:010d}.png"), picture)
        row = oxts_row(2.0 * k, 0.5 * k, 0.1 * k, 0.1 * k)
        (drive / "oxts" / "data" / f"{k:010d}.txt").write_text(" ".join(f"{v:.12f}" for v in row) + "\n")
    stamps = [f"2011-09-26 13:02:{25 + k / 10:012.9f}" for k in range(count)]
    (drive / "image_00" / "timestamps.txt").write_text("\n".join(stamps) + "\n")
    (day / "calib_imu_to_velo.txt").write_text(f"calib_time: x\nR: {IDENTITY}\nT: 0 0 0\n")
    # a point of the laser frame, seen from the camera: the lever arm in the camera's axes, taken away
    t = -np.array([[0, -1, 0], [0, 0, -1], [1, 0, 0]]) @ LEVER
    (day / "calib_velo_to_cam.txt").write_text(f"R: {R_VELO_TO_CAM}\nT: {t[0]} {t[1]} {t[2]}\n")
    rows = [f"R_rect_00: {IDENTITY}", "P_rect_00: 50 0 20 0 0 50 15 0 0 0 1 0"]
    rows += ["P_rect_01: 50 0 20 -25 0 50 15 0 0 0 1 0"]
    (day / "calib_cam_to_cam.txt").write_text("\n".join(rows) + "\n")
    return drive


def camera_position(k):
    turn = Rotation.from_euler("z", 0.1 * k)
    return np.array([2.0 * k, 0.5 * k, 0.1 * k]) + turn.apply(LEVER)


def test_poses_are_those_of_the_camera_not_of_the_unit(tmp_path):
    sequence = open_sequence(make_drive(tmp_path))
    assert guess_format(sequence.folder) == "kitti-raw"
    np.testing.assert_allclose(sequence.T_n_c(0).as_matrix(), np.eye(4), atol=1e-9)
    for k in range(1, 4):
        away = camera_position(k) - camera_position(k - 1)
        step = sequence.T_n_c(k - 1).inv() * sequence.T_n_c(k)
        assert np.linalg.norm(step.translation) == pytest.approx(np.linalg.norm(away), rel=1e-4)
        ahead = Rotation.from_euler("z", 0.1 * (k - 1)).inv().apply(away)  # forward, left, up
        np.testing.assert_allclose(step.translation, [-ahead[1], -ahead[2], ahead[0]], atol=1e-3)
        np.testing.assert_allclose(step.rotation.as_rotvec(), [0, -0.1, 0], atol=1e-6)
    np.testing.assert_array_equal(sequence.gps_accuracy_m, 0.05)
    gps = scale_source("gps-norm", sequence)
    assert gps.sigma_m(2) == pytest.approx(0.05 * np.sqrt(2))
    assert gps.distance_m(2) == pytest.approx(
        np.linalg.norm(camera_position(2) - camera_position(1)), rel=1e-4
    )


def test_camera_times_and_right_images(tmp_path):
    sequence = KittiRaw(make_drive(tmp_path))
    assert (sequence.camera.fx, sequence.camera.cx, sequence.camera.width) == (50, 20, WIDTH)
    assert sequence.timestamp(3) == pytest.approx(0.3)
    assert sequence.times_source == "timestamps.txt"
    assert sequence.baseline_m == 0.5
    assert sequence.right_image(1).shape == sequence.image(1).shape == (HEIGHT, WIDTH)
    with pytest.raises(MissingFieldError, match="depth"):
        sequence.depth(0)


def test_what_is_wrong_is_said(tmp_path):
    drive = make_drive(tmp_path)
    (drive / "oxts" / "data" / "0000000003.txt").unlink()
    with pytest.raises(DataError, match=r"no file of frame 3 \(0000000003\.txt\)"):
        KittiRaw(drive).T_n_c(0)
    stamps = drive / "image_00" / "timestamps.txt"
    stamps.write_text("\n".join(reversed(stamps.read_text().split("\n"))))
    with pytest.raises(DataError, match="times must increase"):
        KittiRaw(drive)
    stamps.write_text("yesterday\n" * 4)
    with pytest.raises(DataError, match="not times"):
        KittiRaw(drive)
    (drive.parent / "calib_cam_to_cam.txt").write_text("P_rect_02: 1 2 3\n")
    with pytest.raises(DataError, match="no row P_rect_00"):
        KittiRaw(drive)


def test_oxts_turns_about_up():
    poses = oxts_poses(np.array([oxts_row(0, 0, 0, 0.3), oxts_row(3, 4, 0, 0.3)]))
    assert isinstance(poses, RigidTransform)
    np.testing.assert_allclose(poses.rotation.as_rotvec(), [[0, 0, 0.3]] * 2, atol=1e-12)
    np.testing.assert_allclose(poses[1].translation - poses[0].translation, [3, 4, 0], atol=1e-5)
