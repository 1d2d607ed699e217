"""KITTI odometry: grey or colour images, calibration, and poses where they are."""

from __future__ import annotations

from collections.abc import Iterable
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform

from flowlik.datasets._camera_model import matrix_lens
from flowlik.datasets._camera_text import read_projection
from flowlik.datasets._frames import Lacking, first_readable
from flowlik.datasets._images import of_size, read_grey
from flowlik.datasets._numbering import Numbered, numbered
from flowlik.datasets.base import frame_index, lacks
from flowlik.errors import DataError
from flowlik.geometry.camera import Pinhole
from flowlik.geometry.pose_table import read_pose_table
from flowlik.geometry.times import read_times
from flowlik.geometry.trajectory import FRAME_RATE, KITTI_COLUMNS
from flowlik.support.files import printable

IMAGE_FOLDERS = {"image_0": "P0", "image_2": "P2"}
"""Image folders in the order of preference, each with the row of ``calib.txt`` of its camera."""

IMAGE_KINDS = frozenset({".png", ".jpg", ".jpeg"})

RIGHT_FOLDERS = {"image_0": "image_1", "image_2": "image_3"}
IMAGE_FOLDERS_RIGHT = {"image_0": "P1", "image_2": "P3"}


def find_sequences(root: Path | str) -> dict[str, Path]:
    """Folders of KITTI odometry sequences by name, below a root of the official layout or of plain clips.

    ``root/sequences/NN``, ``root/NN``, or the sequence itself.

    Raises
    ------
    DataError
        If there is none.
    """
    root = Path(root)
    for place in (root / "sequences", root):
        if place.is_dir():
            found = {
                p.name: p for p in sorted(place.iterdir()) if any((p / n).is_dir() for n in IMAGE_FOLDERS)
            }
            if found:
                return found
    if any((root / name).is_dir() for name in IMAGE_FOLDERS):
        return {root.resolve().name: root}
    raise DataError(
        f"{root}: no KITTI odometry sequence (expected sequences/NN/image_0 or NN/image_0 inside)"
    )


class KittiOdometry(Lacking):
    """One sequence of the KITTI odometry benchmark, or a clip of one, as a `ImageSequence`.

    Images are those of ``image_0``, else of ``image_2`` (as grey). KITTI's poses are those of camera 0;
    `T_n_c` gives those of the camera whose images are read. {n} is the frame of the pose file. An image's
    number says which rows of poses and times are its own: row k is frame k where there are rows for all
    numbers; else there must be as many rows as images, the first that of the first image. Rows of 13 numbers
    begin with the frame's number.

    Parameters
    ----------
    folder : Path or str
        The sequence: ``calib.txt``, ``image_0`` or ``image_2`` with consecutively numbered PNG or JPEG
        files, and, optional, ``times.txt``.
    poses : Path or str, optional
        Pose file, one row a frame. By default ``poses.txt`` in the folder (a clip's own), else
        ``../../poses/NN.txt`` (the official layout). It is read when a pose is first asked for.
    lenient : bool
        Images may be missing between others, and times go back: what cannot be used is told when it is read.

    Attributes
    ----------
    name : str
        ``kitti/`` and the folder's name.
    times_source : str
        ``times.txt``, or ``frame/10s`` where that file is missing.

    Raises
    ------
    DataError
        If images or calibration are missing or wrong, images are not numbered without gaps, or times
        do not increase or are not those of these frames.
    """

    def __init__(self, folder: Path | str, poses: Path | str | None = None, lenient: bool = False) -> None:
        self.folder = Path(folder)
        self.name = f"kitti/{printable(self.folder.resolve().name)}"
        self._lenient = lenient
        self._poses_file = None if poses is None else Path(poses)
        self._images = images = images_in(self.folder, IMAGE_FOLDERS, "KITTI sequence")
        self._frames = numbered_images(self.folder / images, lenient)
        self._files = self._frames.files
        K, self._t_c_0 = read_calibration(self.folder / "calib.txt", IMAGE_FOLDERS[images])
        _, shape = first_readable(self._files, lenient)
        self._camera = matrix_lens(K, str(self.folder / "calib.txt")).pinhole(shape)
        self._timestamps, self.times_source = self._read_times(lenient)

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
            If there is no such frame, or its file is unreadable or of another size than the first.
        """
        path = self._files[frame_index(self, k)]
        return of_size(read_grey(path), (self._camera.height, self._camera.width), path, "the first image")

    def timestamp(self, k: int) -> float:
        """Time [s] of frame k.

        Raises
        ------
        DataError
            If there is no such frame.
        """
        return float(self._timestamps[frame_index(self, k)])

    def right_image(self, k: int) -> NDArray[np.uint8]:
        """Grey image (H, W) of the camera to the right.

        Raises
        ------
        MissingFieldError
            If its file is not there.
        DataError
            If there is no such frame, or its file is unreadable.
        """
        path = self.folder / RIGHT_FOLDERS[self._images] / self._files[frame_index(self, k)].name
        if not path.is_file():
            raise lacks(self.name, f"right image ({RIGHT_FOLDERS[self._images]}/{path.name})")
        return read_grey(path)

    @property
    def baseline_m(self) -> float:
        """Distance [m] of the camera to the right, by ``calib.txt``."""
        _, t = read_calibration(self.folder / "calib.txt", IMAGE_FOLDERS_RIGHT[self._images])
        return float(self._t_c_0[0] - t[0])

    def T_n_c(self, k: int) -> RigidTransform:
        """Return the true pose of frame k, which takes points in {c} to points in {n} [m].

        Raises
        ------
        MissingFieldError
            If there are no poses.
        DataError
            If there is no such frame, or the poses are malformed or not one an image.
        """
        poses, known = self._poses
        if not known[frame_index(self, k)]:
            raise DataError(f"{self.name}: no pose of frame {self._frames.numbers[k]}")
        return poses[k]

    @cached_property
    def _poses(self) -> tuple[RigidTransform, NDArray[np.bool_]]:
        """Poses (N,) of the camera, and which frames (N,) have one: the others hold that of another."""
        official = self.folder.resolve().parent.parent / "poses" / f"{self.folder.resolve().name}.txt"
        candidates = [self._poses_file] if self._poses_file else [self.folder / "poses.txt", official]
        path = next((path for path in candidates if path.is_file()), None)
        if path is None:
            raise lacks(self.name, f"poses ({' or '.join(map(str, candidates))})")
        table = read_pose_table(path, self._lenient, KITTI_COLUMNS)
        if table.times_s is not None:
            raise DataError(f"{path}: its first column must be frame numbers, which it has not")
        if table.frames is None:
            rows, known = self._frames.rows(len(table), "poses", path), np.ones(len(self), dtype=bool)
        else:
            rows, known = self._frames.find(table.frames)
        if not known.any() or not (self._lenient or known.all()):
            raise DataError(f"{path}: no pose of frame {self._frames.numbers[np.argmin(known)]}")
        return table.poses[rows] * RigidTransform.from_translation(-self._t_c_0), known

    def _read_times(self, lenient: bool) -> tuple[NDArray[np.float64], str]:
        path = self.folder / "times.txt"
        if not path.exists():
            return self._frames.numbers / FRAME_RATE, "frame/10s"
        seconds = read_times(path, increasing=not lenient)
        return seconds[self._frames.rows(len(seconds), "times", path)], "times.txt"


def read_calibration(path: Path | str, row: str) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Read one camera of a KITTI ``calib.txt``.

    Parameters
    ----------
    path : Path or str
        Calibration file, rows such as ``P0: …`` of 12 numbers (a 3 x 4 projection matrix K [I | t]).
    row : str
        Name of the row.

    Returns
    -------
    K : array (3, 3)
        Camera matrix [px].
    t_c_0 : array (3,)
        Translation [m] from camera 0 to this one: a point X in camera 0 is X + t in this camera.

    Raises
    ------
    DataError
        If the file is missing or not a calibration file, or has no such row.
    """
    P = read_projection(path, row)
    return P[:, :3], np.asarray(np.linalg.solve(P[:, :3], P[:, 3]), dtype=np.float64)


def images_in(folder: Path, names: Iterable[str], kind: str) -> str:
    """The first of the image folders `names` that a KITTI folder has.

    Raises
    ------
    DataError
        If it has none.
    """
    if not folder.is_dir():
        raise DataError(f"{folder}: no such folder")
    found = next((name for name in names if (folder / name).is_dir()), None)
    if found is None:
        raise DataError(f"{folder}: no folder {' or '.join(names)} in this {kind}")
    return found


def numbered_images(folder: Path, gaps: bool = False) -> Numbered:
    """PNG and JPEG files of a folder in the order of their numbers, which must be consecutive.

    With ``gaps`` the files that are missing in between stand in the list too.

    Raises
    ------
    DataError
        If there are none, one is named otherwise, or some are missing in between and ``gaps`` is off.
    """
    files = [path for path in folder.iterdir() if path.suffix.lower() in IMAGE_KINDS and path.name[0] != "."]
    if not files:
        raise DataError(f"{folder}: no images (NNNNNN.png or .jpg)")
    return numbered(files, r"([0-9]+)\.\w+", "NNNNNN.png or .jpg", gaps)
