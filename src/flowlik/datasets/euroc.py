"""EuRoC MAV: one camera of a flying robot, with poses."""

from __future__ import annotations

from functools import cached_property
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform

from flowlik.datasets.base import frame_index, lacks
from flowlik.datasets.euroc_files import SensorFile, read_sensor
from flowlik.datasets.frames import FrameFiles
from flowlik.datasets.poses import rigid_transform
from flowlik.errors import DataError
from flowlik.geometry.camera import Pinhole
from flowlik.geometry.pose_table import nanoseconds, read_euroc_poses
from flowlik.geometry.times import check_times, nearest
from flowlik.support.files import printable, read_csv

TOLERANCE_S = 0.003
"""Half the period of the poses (200 Hz), and a little more."""


class Euroc(FrameFiles):
    """The left camera of one EuRoC MAV sequence (Burri et al. 2016), a `ImageSequence`.

    ``mav0/cam0`` holds ``data.csv`` (times and files), ``data`` and ``sensor.yaml`` (intrinsics, distortion,
    place on the robot), ``mav0/state_groundtruth_estimate0/data.csv`` the robot's poses. Images are
    **undistorted when they are read** (bilinear, keeping the camera matrix), so that `camera` is a pinhole
    without distortion; that smooths the texture a little, and pixels outside the original image become black.
    Frames without a pose within 3 ms are left out where poses are there: before take-off and after landing.
    World axes are those of the ground truth (z up). There is neither depth nor flow.

    Parameters
    ----------
    folder : Path or str
        One sequence, e.g. ``MH_01_easy``, or its ``mav0``.

    Raises
    ------
    DataError
        If a file is missing or malformed, the camera model is not a pinhole with radial-tangential
        distortion, or no image has a pose.
    """

    def __init__(self, folder: Path | str) -> None:
        folder = Path(folder)
        if not folder.is_dir():
            raise DataError(f"{folder}: no such folder")
        mav = folder if (folder / "cam0").is_dir() else folder / "mav0"
        if not (mav / "cam0").is_dir():
            raise DataError(f"{folder}: no folder mav0/cam0, not a EuRoC sequence")
        self._sensor = read_sensor(mav / "cam0" / "sensor.yaml")
        times, files = _read_images(mav / "cam0")
        truth = mav / "state_groundtruth_estimate0" / "data.csv"
        self._poses: RigidTransform | None = None
        if truth.is_file():
            table = read_euroc_poses(truth)
            assert table.times_s is not None
            pose_of = nearest(times, table.times_s, TOLERANCE_S)
            kept = pose_of >= 0
            if not kept.any():
                raise DataError(f"{truth}: no pose within {TOLERANCE_S} s of an image")
            T_b_c = rigid_transform(self._sensor.T_b_c, f"{mav / 'cam0' / 'sensor.yaml'}, T_BS")
            self._poses = table.poses[pose_of[kept]] * T_b_c
            times, files = times[kept], [files[i] for i in np.flatnonzero(kept)]
        self._times = times
        scene = folder.resolve().parent.name if mav is folder else folder.resolve().name
        super().__init__(f"euroc/{printable(scene)}", files)
        height, width = self.shape
        if (width, height) != self._sensor.resolution:
            claimed = " x ".join(map(str, self._sensor.resolution))
            raise DataError(f"{self.files[0]}: {width} x {height} pixels, but sensor.yaml says {claimed}")
        self._camera = Pinhole(width, height, *self._sensor.intrinsics)

    @property
    def camera(self) -> Pinhole:
        """The camera of every undistorted image."""
        return self._camera

    def image(self, k: int) -> NDArray[np.uint8]:
        """Undistorted grey image (H, W) of frame k."""
        image = super().image(k)
        return np.asarray(cv2.remap(image, *self._undistortion, cv2.INTER_LINEAR), dtype=np.uint8)

    def timestamp(self, k: int) -> float:
        """Return the time [s] of frame k.

        Raises
        ------
        DataError
            If there is no such frame.
        """
        return float(self._times[frame_index(self, k)])

    def T_n_c(self, k: int) -> RigidTransform:
        """Return the true pose of the camera, nearest in time to frame k: takes {c} to {n} [m].

        Raises
        ------
        MissingFieldError
            If there are no poses.
        DataError
            If there is no such frame.
        """
        if self._poses is None:
            raise lacks(self.name, "poses (mav0/state_groundtruth_estimate0/data.csv)")
        return self._poses[frame_index(self, k)]

    @cached_property
    def _undistortion(self) -> tuple[NDArray, NDArray]:
        return undistortion_maps(self._camera, self._sensor)


def undistortion_maps(camera: Pinhole, sensor: SensorFile) -> tuple[NDArray, NDArray]:
    """Columns and rows (H, W), float32, of the pinhole camera's pixels in the distorted image."""
    K, size = camera.K, (camera.width, camera.height)
    maps = cv2.initUndistortRectifyMap(K, np.array(sensor.distortion), None, K, size, cv2.CV_32FC1)
    return maps[0], maps[1]


def _read_images(folder: Path) -> tuple[NDArray[np.float64], list[Path]]:
    """Times (N,) [s] and image files that ``data.csv`` lists."""
    path = folder / "data.csv"
    stamps, files = [], []
    for where, words in read_csv(path, 2, "a time [ns] and a file name"):
        stamps.append(nanoseconds(words[0], where))
        files.append(folder / "data" / words[1])
    times = np.array(stamps)
    check_times(times, str(path))
    return times, files
