"""KITTI raw: a synchronised and rectified drive, with poses from its OXTS (GPS and inertial) unit."""

from __future__ import annotations

from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform, Rotation

from flowlik.datasets._camera_model import matrix_lens
from flowlik.datasets._frames import Lacking, first_readable
from flowlik.datasets._images import read_grey
from flowlik.datasets._oxts import ACCURACY, OXTS_COLUMNS
from flowlik.datasets._raw_text import calibration_row, read_stamps
from flowlik.datasets.base import frame_index, lacks
from flowlik.datasets.kitti import images_in, numbered_images
from flowlik.errors import DataError
from flowlik.geometry.camera import Pinhole
from flowlik.geometry.times import check_times
from flowlik.geometry.trajectory import FRAME_RATE
from flowlik.support.files import printable, read_table

EARTH_RADIUS_M = 6378137.0
FOLDERS = {"image_00/data": "00", "image_02/data": "02"}
ODOMETRY_DRIVES = {
    "00": ("2011_10_03_drive_0027", 4541),
    "01": ("2011_10_03_drive_0042", 1101),
    "03": ("2011_09_26_drive_0067", 801),
}
"""Drives whose first frames are sequences of the odometry benchmark (by its devkit), and how many."""
RIGHT = {"00": "01", "02": "03"}


class KittiRaw(Lacking):
    """One drive of KITTI raw (``..._sync``), as a `ImageSequence`.

    Images are those of ``image_00``, else of ``image_02`` (as grey), rectified. `T_n_c` comes from OXTS: its
    position (Mercator's projection, as in KITTI's devkit), attitude, and the lever arm from the unit to the
    camera by ``calib_imu_to_velo.txt``, ``calib_velo_to_cam.txt`` and ``calib_cam_to_cam.txt``. {n} is the
    first camera. The number in an image's name says which file of OXTS, and which row of the times, is its
    own.

    Parameters
    ----------
    folder : Path or str
        The drive, with ``image_00/data`` or ``image_02/data`` and, for poses, ``oxts/data``; the calibration
        stands in the folder above (the day's), or in this one.
    lenient : bool
        Images may be missing between others, and times go back: what cannot be used is told when it is read.

    Raises
    ------
    DataError
        If images or calibration are missing or wrong, or an image has no row of OXTS or no time.
    """

    times_source = "frame/10s"

    def __init__(self, folder: Path | str, lenient: bool = False) -> None:
        self.folder = Path(folder)
        self.name = f"kitti-raw/{printable(self.folder.resolve().name)}"
        self._lenient = lenient
        images = images_in(self.folder, FOLDERS, "KITTI raw drive")
        self._number = FOLDERS[images]
        self._frames = numbered_images(self.folder / images, lenient)
        self._files = self._frames.files
        self._P = self._calibration("calib_cam_to_cam.txt", f"P_rect_{self._number}", 12).reshape(3, 4)
        _, shape = first_readable(self._files, lenient)
        self._camera = matrix_lens(self._P, f"{self.folder}, P_rect_{self._number}").pinhole(shape)
        self._timestamps = self._read_times((self.folder / images).parent / "timestamps.txt", lenient)

    @property
    def camera(self) -> Pinhole:
        """The camera of every frame."""
        return self._camera

    def __len__(self) -> int:
        """Return the number of frames."""
        return len(self._files)

    def image(self, k: int) -> NDArray[np.uint8]:
        """Grey image (H, W) of frame k.

        Raises
        ------
        DataError
            If there is no such frame, or its file is unreadable.
        """
        return read_grey(self._files[frame_index(self, k)])

    def right_image(self, k: int) -> NDArray[np.uint8]:
        """Grey image (H, W) of the camera to the right.

        Raises
        ------
        MissingFieldError
            If its file is not there.
        DataError
            If there is no such frame, or its file is unreadable.
        """
        path = self.folder / f"image_{RIGHT[self._number]}" / "data" / self._files[frame_index(self, k)].name
        if not path.is_file():
            raise lacks(self.name, f"right image {path.name}")
        return read_grey(path)

    @property
    def baseline_m(self) -> float:
        """Distance [m] of the camera to the right."""
        P = self._calibration("calib_cam_to_cam.txt", f"P_rect_{RIGHT[self._number]}", 12).reshape(3, 4)
        return float((self._P[0, 3] - P[0, 3]) / P[0, 0])

    def timestamp(self, k: int) -> float:
        """Time [s] of frame k, from the first.

        Raises
        ------
        DataError
            If there is no such frame.
        """
        return float(self._timestamps[frame_index(self, k)])

    def T_n_c(self, k: int) -> RigidTransform:
        """Return the pose of frame k by OXTS, which takes points in {c} to points in {n} [m].

        Raises
        ------
        MissingFieldError
            If there are no OXTS files.
        DataError
            If there is no such frame, OXTS or calibration are malformed, or OXTS lacks an image's number.
        """
        poses, known = self._poses
        if not known[frame_index(self, k)]:
            raise self._no_row(k)
        return poses[k]

    @property
    def gps_positions(self) -> NDArray[np.float64]:
        """Positions (N, 3) [m] of the camera by OXTS: of the unit, moved by the lever arm; NaN unknown."""
        poses, known = self._poses
        return np.where(known[:, None], poses.translation, np.nan)

    @cached_property
    def gps_accuracy_m(self) -> NDArray[np.float64]:
        """Standard deviation (N,) [m] of each position, as the OXTS unit itself states it; NaN unknown."""
        rows, known = self._oxts
        return np.where(known, rows[:, ACCURACY], np.nan)

    @cached_property
    def _poses(self) -> tuple[RigidTransform, NDArray[np.bool_]]:
        """Poses (N,) of the camera, and which frames (N,) have one: the others hold that of another."""
        rows, known = self._oxts
        poses = oxts_poses(rows) * self._T_imu_c()
        return poses[0].inv() * poses, known

    @cached_property
    def _oxts(self) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
        """Rows (N, 30) of OXTS, and which frames (N,) have one: the others hold that of another."""
        folder = self.folder / "oxts" / "data"
        files = {int(path.stem): path for path in folder.glob("*.txt") if path.stem.isdecimal()}
        known = np.array([number in files for number in self._frames.numbers])
        if not known.any():
            raise lacks(self.name, f"poses ({folder}/*.txt)")
        if not (self._lenient or known.all()):
            raise self._no_row(int(np.argmin(known)))
        layout = f"{OXTS_COLUMNS} numbers (KITTI OXTS: lat lon alt roll pitch yaw …)"
        mine = [files[number] for number in self._frames.numbers[known]]
        rows = np.array([read_table(path, OXTS_COLUMNS, layout)[0][0] for path in mine])
        return rows[np.maximum(np.cumsum(known) - 1, 0)], known

    def _no_row(self, k: int) -> DataError:
        number = int(self._frames.numbers[k])
        return DataError(f"{self.folder / 'oxts' / 'data'}: no file of frame {number} ({number:010d}.txt)")

    def _T_imu_c(self) -> RigidTransform:
        """Takes points in the rectified camera to points in the OXTS unit."""
        chain = RigidTransform.identity()
        for file in ("calib_imu_to_velo.txt", "calib_velo_to_cam.txt"):
            R, t = self._calibration(file, "R", 9), self._calibration(file, "T", 3)
            chain = RigidTransform.from_components(t, Rotation.from_matrix(R.reshape(3, 3))) * chain
        R = self._calibration("calib_cam_to_cam.txt", "R_rect_00", 9).reshape(3, 3)
        aside = RigidTransform.from_translation([self._P[0, 3] / self._P[0, 0], 0, 0])
        return (aside * RigidTransform.from_rotation(Rotation.from_matrix(R)) * chain).inv()

    def _calibration(self, file: str, row: str, count: int) -> NDArray[np.float64]:
        places = [self.folder.resolve().parent / file, self.folder / file]
        path = next((place for place in places if place.is_file()), None)
        if path is None:
            raise DataError(f"{places[0]}: no such file, but this KITTI raw drive needs it")
        return calibration_row(path, row, count)

    def _read_times(self, path: Path, lenient: bool) -> NDArray[np.float64]:
        if not path.is_file():
            return self._frames.numbers / FRAME_RATE
        stamps = read_stamps(path)
        stamps = stamps[self._frames.rows(len(stamps), "times", path)]
        seconds = (stamps - stamps[0]).astype(np.int64) / 1e9
        if not lenient:
            check_times(seconds, str(path))
        self.times_source = "timestamps.txt"
        return np.asarray(seconds, dtype=np.float64)


def oxts_poses(rows: NDArray[np.float64]) -> RigidTransform:
    """Poses (N,) of the OXTS unit from its rows (N, 30): latitude, longitude [deg], altitude, attitude [rad].

    The unit's axes are forward, left, up; the world's east, north, up. Source: KITTI raw devkit,
    ``convertOxtsToPose``.
    """
    scale = np.cos(np.deg2rad(rows[0, 0]))
    east = scale * EARTH_RADIUS_M * np.deg2rad(rows[:, 1])
    north = scale * EARTH_RADIUS_M * np.log(np.tan(np.pi / 4 + np.deg2rad(rows[:, 0]) / 2))
    positions = np.stack([east, north, rows[:, 2]], axis=-1)
    return RigidTransform.from_components(positions, Rotation.from_euler("xyz", rows[:, 3:6]))
