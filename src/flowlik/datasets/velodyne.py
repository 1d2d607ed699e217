"""KITTI's velodyne: sweeps of points, and where the LiDAR sits beside a rectified camera."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from flowlik.datasets._poses import rigid_transform
from flowlik.datasets._raw_text import calibration_row
from flowlik.errors import DataError
from flowlik.support.arrays import Array

MOST_RANGE_M = 200.0


def read_velodyne(path: Path | str) -> Array:
    """Points (N, 3) [m] of a sweep in the LiDAR's axes: x forward, y left, z up.

    Parameters
    ----------
    path : Path or str
        A ``.bin`` of KITTI: four float32 a point, of which the last is the reflectance.

    Raises
    ------
    DataError
        If the file is missing, empty or of another size, or points are not finite or beyond 200 m.
    """
    path = Path(path)
    try:
        raw = path.read_bytes()
    except OSError as error:
        raise DataError(f"{path}: cannot be read ({error.strerror})") from error
    if not raw or len(raw) % 16:
        raise DataError(f"{path}: {len(raw)} bytes, expected points of 16 bytes (x y z reflectance, float32)")
    points = np.frombuffer(raw, "<f4").reshape(-1, 4)[:, :3].astype(np.float64)
    if not np.isfinite(points).all() or np.abs(points).max() > MOST_RANGE_M:
        raise DataError(f"{path}: points that are not finite or beyond {MOST_RANGE_M:g} m: no velodyne's")
    return points


def read_kitti_lidar_place(folder: Path | str, camera: str = "02") -> RigidTransform:
    """Where the LiDAR sits: ``T_c_l`` takes points in its axes to those of a rectified camera [m].

    Parameters
    ----------
    folder : Path or str
        With the day's ``calib_velo_to_cam.txt`` and ``calib_cam_to_cam.txt`` of KITTI raw.
    camera : str
        ``00`` to ``03``.

    Raises
    ------
    DataError
        If a file or row is missing or malformed, or the place is no rigid transform.
    """
    folder = Path(folder)
    velo, cam = folder / "calib_velo_to_cam.txt", folder / "calib_cam_to_cam.txt"
    place = np.eye(4)
    place[:3, :3], place[:3, 3] = calibration_row(velo, "R", 9).reshape(3, 3), calibration_row(velo, "T", 3)
    rectified = np.eye(4)
    rectified[:3, :3] = calibration_row(cam, "R_rect_00", 9).reshape(3, 3)
    P = calibration_row(cam, f"P_rect_{camera}", 12).reshape(3, 4)
    aside = RigidTransform.from_translation(np.linalg.solve(P[:, :3], P[:, 3]))
    turn = RigidTransform.from_rotation(Rotation.from_matrix(rectified[:3, :3]))
    return aside * turn * rigid_transform(place, f"{velo}, R and T")
