"""Readers of IMU, GPS and LiDAR that are fuzzed, with a small whole example of each."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from tests.datasets import test_inertial, test_sensors, test_velodyne

from flowlik.datasets import read_gps, read_imu, read_imu_noise, read_kitti_lidar_place, read_velodyne
from flowlik.support.extras import missing
from fuzz_examples import file_of

Used = tuple[Callable[[Path], Path], Callable[[Path], object]]


def sensors() -> dict[str, Used]:
    """How an example of each is made below a folder, and how it is used."""
    found: dict[str, Used] = {
        "imu table": (file_of("i.csv", test_sensors.by_names), read_imu),
        "imu mat": (file_of("i.mat", test_sensors.mat), read_imu),
        "imu oxts": (test_sensors.oxts, read_imu),
        "imu euroc": (lambda root: test_inertial.euroc(_made(root)), read_imu),
        "imu tartanair": (lambda root: test_inertial.tartanair(_made(root)), read_imu),
        "imu noise": (file_of("n.yaml", lambda p: p.write_text(test_sensors.NOISE)), read_imu_noise),
        "gps table": (file_of("g.csv", lambda p: p.write_text(test_inertial.GPS)), read_gps),
        "gps geodetic": (file_of("g.csv", lambda p: p.write_text(test_sensors.GEODETIC)), read_gps),
        "gps oxts": (test_sensors.oxts, read_gps),
        "lidar sweep": (file_of("v.bin", lambda p: np.ones((9, 4), "<f4").tofile(p)), read_velodyne),
        "lidar place": (test_velodyne.place, read_kitti_lidar_place),
    }
    if not missing("ros"):
        bag = lambda root: test_sensors.sensor_bag(_made(root) / "bag")  # noqa: E731
        found |= {"imu ros": (bag, read_imu), "gps ros": (bag, read_gps)}
    return found


def _made(root: Path) -> Path:
    root.mkdir(parents=True, exist_ok=True)
    return root
