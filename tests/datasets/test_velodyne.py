"""Sweeps and places of a LiDAR in KITTI's files, made here, and bad ones."""

from pathlib import Path

import numpy as np
import pytest

from flowlik.datasets import read_kitti_lidar_place, read_velodyne
from flowlik.errors import DataError

VELO = "R: 0 -1 0 0 0 -1 1 0 0\nT: 0.1 -0.2 0.3\n"
CAM = "R_rect_00: 1 0 0 0 1 0 0 0 1\nP_rect_02: 700 0 600 35 0 700 170 7 0 0 1 0.01\n"


def test_points_of_a_sweep(tmp_path):
    points = np.array([[10, 1, -1, 0.5], [20, -2, 0.5, 0.1]], "<f4")
    points.tofile(tmp_path / "0.bin")
    np.testing.assert_array_equal(read_velodyne(tmp_path / "0.bin"), points[:, :3])


def place(folder: Path, velo: str = VELO, cam: str = CAM) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "calib_velo_to_cam.txt").write_text(velo)
    (folder / "calib_cam_to_cam.txt").write_text(cam)
    return folder


def test_points_ahead_fall_where_the_projection_matrix_says(tmp_path):
    T_c_l = read_kitti_lidar_place(place(tmp_path))
    P = np.array([[700, 0, 600, 35], [0, 700, 170, 7], [0, 0, 1, 0.01]])
    point = np.array([12.0, 1.0, -0.5])
    # of unrectified camera 0: x right, y down, z forward
    seen = P @ np.array([-1.0 + 0.1, 0.5 - 0.2, 12.0 + 0.3, 1.0])
    K = P[:, :3]
    np.testing.assert_allclose(K @ T_c_l.apply(point), seen)


@pytest.mark.parametrize(
    ("raw", "message"),
    [
        (b"", "0 bytes, expected points of 16 bytes"),
        (b"123", "3 bytes, expected points of 16 bytes"),
        (np.full(4, np.nan, "<f4").tobytes(), "not finite or beyond 200 m"),
        (np.full(4, 1e6, "<f4").tobytes(), "not finite or beyond 200 m"),
    ],
)
def test_bad_sweeps(tmp_path, raw, message):
    (tmp_path / "0.bin").write_bytes(raw)
    with pytest.raises(DataError, match=message):
        read_velodyne(tmp_path / "0.bin")


@pytest.mark.parametrize(
    ("velo", "cam", "message"),
    [
        (VELO.replace("T:", "t:"), CAM, "no row T"),
        (VELO.replace("0.3", ""), CAM, "row T: 2 numbers, but expected 3"),
        (VELO.replace("0 -1 0 0", "0 -2 0 0"), CAM, "R and T: its upper left 3 x 3 is not a rotation"),
        (VELO, CAM.replace("P_rect_02", "P_rect_03"), "no row P_rect_02"),
    ],
)
def test_bad_places(tmp_path, velo, cam, message):
    with pytest.raises(DataError, match=message):
        read_kitti_lidar_place(place(tmp_path, velo, cam))


def test_no_sweep(tmp_path):
    with pytest.raises(DataError, match="cannot be read"):
        read_velodyne(tmp_path / "absent.bin")
