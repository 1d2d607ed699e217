"""TUM RGB-D: frames of a Kinect with poses of a motion-capture system."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform

from flowlik.datasets._camera_file import read_camera
from flowlik.datasets._frames import DepthFrames, read_depth
from flowlik.datasets._lens import Lens
from flowlik.datasets._lens_models import BrownConrady
from flowlik.datasets._timed import TimedFiles, left_out, timed_files
from flowlik.datasets.base import frame_index, lacks
from flowlik.datasets.intrinsics import CameraLike, GivenCamera, given_lens
from flowlik.errors import DataError
from flowlik.geometry.pose_table import read_pose_table
from flowlik.geometry.times import mutual, nearest
from flowlik.support.files import numbers, printable, read_text

TOLERANCE_S = 0.02
"""Image, depth and pose further apart in time are not of one frame."""

UNITS_PER_M = 5000

UNKNOWN = 0, 65535
"""Depth that was not measured, or is farther than 16 bits hold."""

_SIZE = (640, 480)
CAMERAS = {
    "freiburg1": Lens(
        517.3, 516.5, 318.6, 255.3, BrownConrady((0.2624, -0.9531, -0.0054, 0.0026, 1.1633)), _SIZE
    ),
    "freiburg2": Lens(
        520.9, 521.0, 325.1, 249.7, BrownConrady((0.2312, -0.7849, -0.0033, -0.0001, 0.9172)), _SIZE
    ),
    "freiburg3": Lens(535.4, 539.2, 320.1, 247.6, size=_SIZE),
}
"""Colour cameras by what a sequence's name contains, as the benchmark gives them (RGB calibration)."""


class TumRgbd(GivenCamera, DepthFrames):
    """One sequence of the TUM RGB-D benchmark (Sturm et al. 2012), a `ImageSequence`.

    ``rgb.txt`` and ``depth.txt`` list times and files, ``groundtruth.txt`` poses (``t x y z qx qy qz qw``). A
    frame is an image with the depth and the pose nearest in time, within 0.02 s; where either list is there,
    images without such a partner are left out (so neighbouring frames may be further apart than the camera's
    period: see `timestamp`), which `notes` counts, and a depth image serves one frame only. **The truth is
    soft**: depth and colour are not taken at one instant, and shutters roll.

    Parameters
    ----------
    folder : Path or str
        One sequence, e.g. ``rgbd_dataset_freiburg3_long_office_household``.
    camera : Pinhole, Lens, str, Path or sequence of float, optional
        By default that of a ``calibration.txt`` in the folder (``fx fy cx cy``, as ETH3D has it), else the
        one of `CAMERAS` whose name the folder's contains. Other data sets of this layout have other cameras.
    lenient : bool
        Rows of the lists may go back in time or be double: they are sorted, and of double ones the first is
        kept, which `notes` counts.

    Attributes
    ----------
    notes : tuple of str
        What was left out.

    Raises
    ------
    DataError
        If a list is missing or malformed, or no image has its partners.
    """

    def __init__(self, folder: Path | str, camera: CameraLike | None = None, lenient: bool = False) -> None:
        self.folder = Path(folder)
        if not self.folder.is_dir():
            raise DataError(f"{self.folder}: no such folder")
        scene = self.folder.resolve().name
        times, files, self.notes = _read_list(self.folder / "rgb.txt", lenient)
        kept = np.ones(len(times), dtype=bool)
        self._depths: list[Path] | None = None
        self._poses: RigidTransform | None = None
        depth_list, truth = self.folder / "depth.txt", self.folder / "groundtruth.txt"
        if depth_list.is_file():
            depth_times, depth_files, notes = _read_list(depth_list, lenient)
            self.notes += notes
            depth_of = mutual(times, depth_times, TOLERANCE_S)
            kept &= depth_of >= 0
        if truth.is_file():
            table = read_pose_table(truth, lenient, columns=(8,))
            self.notes += left_out(truth, table.left_out)
            assert table.times_s is not None
            pose_of = nearest(times, table.times_s, TOLERANCE_S)
            kept &= pose_of >= 0
        if not kept.any():
            raise DataError(f"{self.folder}: no image has depth and pose within {TOLERANCE_S} s")
        if depth_list.is_file():
            self._depths = [depth_files[i] for i in depth_of[kept]]
        if truth.is_file():
            self._poses = table.poses[pose_of[kept]]
        self._times = times[kept]
        if not kept.all():
            left = f"{(~kept).sum()} of {len(kept)} images"
            self.notes += (f"{self.folder}: {left} have no depth or pose within {TOLERANCE_S} s, left out",)
        super().__init__(f"tum-rgbd/{printable(scene)}", [files[i] for i in np.flatnonzero(kept)])
        beside = self.folder / "calibration.txt"
        if camera is None and beside.is_file():
            camera = read_camera(beside)
        if camera is not None:
            self.lens = given_lens(camera, self.shape)
        else:
            self.lens = next((lens for name, lens in CAMERAS.items() if name in scene), None)

    def timestamp(self, k: int) -> float:
        """Return the time [s] of the image of frame k.

        Raises
        ------
        DataError
            If there is no such frame.
        """
        return float(self._times[frame_index(self, k)])

    def T_n_c(self, k: int) -> RigidTransform:
        """Return the true pose nearest in time to frame k, which takes points in {c} to points in {n} [m].

        Raises
        ------
        MissingFieldError
            If there are no poses.
        DataError
            If there is no such frame.
        """
        if self._poses is None:
            raise lacks(self.name, "poses (groundtruth.txt)")
        return self._poses[frame_index(self, k)]

    def depth(self, k: int) -> NDArray[np.float64]:
        """Return the measured depth (H, W) [m] along z nearest in time to frame k; NaN where unknown.

        Raises
        ------
        MissingFieldError
            If there is no depth.
        DataError
            If there is no such frame, or its file is missing, damaged or of another size.
        """
        if self._depths is None:
            raise lacks(self.name, "depth (depth.txt)")
        return read_depth(self._depths[frame_index(self, k)], self.shape, UNITS_PER_M, UNKNOWN)


def _read_list(path: Path, lenient: bool) -> TimedFiles:
    """Files of a list with rows ``timestamp filename``."""
    times: list[float] = []
    files: list[Path] = []
    for number, line in enumerate(read_text(path).splitlines(), start=1):
        words = line.partition("#")[0].split(maxsplit=1)
        if not words:
            continue
        if len(words) != 2:
            raise DataError(f"{path}, line {number}: expected a time [s] and a file name")
        times += numbers(words[:1], f"{path}, line {number}")
        files.append(path.parent / words[1].strip())
    if not times:
        raise DataError(f"{path}: empty, but expected rows of a time [s] and a file name")
    return timed_files(times, files, path, lenient)
