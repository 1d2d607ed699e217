"""EuRoC MAV: one camera of a flying robot, with poses."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from scipy.spatial.transform import RigidTransform

from flowlik.datasets._camera_file import read_camera
from flowlik.datasets._euroc_files import read_T_b_c
from flowlik.datasets._frames import FrameFiles
from flowlik.datasets._timed import TimedFiles, left_out, timed_files
from flowlik.datasets.base import frame_index, lacks
from flowlik.datasets.intrinsics import GivenCamera
from flowlik.errors import DataError
from flowlik.geometry.pose_table import nanoseconds, read_euroc_poses
from flowlik.geometry.times import nearest
from flowlik.support.files import printable, read_csv

TOLERANCE_S = 0.003
"""Half the period of the poses (200 Hz), and a little more."""


class Euroc(GivenCamera, FrameFiles):
    """The left camera of one EuRoC MAV sequence (Burri et al. 2016), a `ImageSequence`.

    ``mav0/cam0`` holds ``data.csv`` (times and files), ``data`` and ``sensor.yaml`` (intrinsics, distortion,
    place on the robot), ``mav0/state_groundtruth_estimate0/data.csv`` the robot's poses. Images are as the
    camera's `lens` shows them; `flowlik.open_sequence` undistorts them as they are read. Frames without a
    pose within 3 ms are left out where poses are there: before take-off and after landing; `notes` counts
    them. World axes are those of the ground truth (z up). There is neither depth nor flow.

    Parameters
    ----------
    folder : Path or str
        One sequence, e.g. ``MH_01_easy``, or its ``mav0``.
    lenient : bool
        Rows of the tables may go back in time or be double: they are sorted, and of double ones the first is
        kept, which `notes` counts; images may be missing, which is told when they are read.

    Attributes
    ----------
    notes : tuple of str
        What was left out.

    Raises
    ------
    DataError
        If a file is missing or malformed, the lens is not known, or no image has a pose.
    """

    def __init__(self, folder: Path | str, lenient: bool = False) -> None:
        folder = Path(folder)
        if not folder.is_dir():
            raise DataError(f"{folder}: no such folder")
        mav = folder if (folder / "cam0").is_dir() else folder / "mav0"
        if not (mav / "cam0").is_dir():
            raise DataError(f"{folder}: no folder mav0/cam0, not a EuRoC sequence")
        sensor = mav / "cam0" / "sensor.yaml"
        self.lens = read_camera(sensor)
        times, files, self.notes = _read_images(mav / "cam0", lenient)
        truth = mav / "state_groundtruth_estimate0" / "data.csv"
        self._poses: RigidTransform | None = None
        if truth.is_file():
            table = read_euroc_poses(truth, lenient)
            assert table.times_s is not None
            self.notes += left_out(truth, table.left_out)
            pose_of = nearest(times, table.times_s, TOLERANCE_S)
            kept = pose_of >= 0
            if not kept.any():
                raise DataError(f"{truth}: no pose within {TOLERANCE_S} s of an image")
            self._poses = table.poses[pose_of[kept]] * read_T_b_c(sensor)
            times, files = times[kept], [files[i] for i in np.flatnonzero(kept)]
            if not kept.all():
                gone = f"{(~kept).sum()} of {len(kept)} images"
                self.notes += (f"{truth}: {gone} have no pose within {TOLERANCE_S} s, left out",)
        self._times = times
        scene = folder.resolve().parent.name if mav is folder else folder.resolve().name
        super().__init__(f"euroc/{printable(scene)}", files, lenient)
        self.lens.pinhole(self.shape)  # refuses what is no camera of these images

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


def _read_images(folder: Path, lenient: bool) -> TimedFiles:
    """Image files that ``data.csv`` lists."""
    path = folder / "data.csv"
    stamps, files = [], []
    for where, words in read_csv(path, 2, "a time [ns] and a file name"):
        stamps.append(nanoseconds(words[0], where))
        files.append(folder / "data" / words[1])
    return timed_files(stamps, files, path, lenient)
