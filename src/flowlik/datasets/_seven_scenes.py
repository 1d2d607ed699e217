"""Microsoft 7-Scenes: RGB-D frames of a Kinect with camera poses."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform

from flowlik.datasets._camera_model import matrix_lens
from flowlik.datasets._frames import DepthFrames, read_depth
from flowlik.datasets._lens import Lens
from flowlik.datasets._numbering import numbered
from flowlik.datasets._poses import rigid_transform
from flowlik.datasets.base import frame_index
from flowlik.datasets.intrinsics import CameraLike, GivenCamera, given_lens
from flowlik.errors import DataError
from flowlik.support.files import printable, read_table

KINECT = Lens(585.0, 585.0, 320.0, 240.0, size=(640, 480))
"""The camera that the data set's authors give."""

FRAMES_PER_SECOND = 30.0
"""Nominal: the data set has no times."""

MM_PER_M = 1000
UNKNOWN = (0, 65535)


class SevenScenes(GivenCamera, DepthFrames):
    """One sequence of 7-Scenes (Shotton et al. 2013), a `ImageSequence`.

    ``frame-NNNNNN.color.png`` (or ``.jpg``), ``.depth.png`` (millimetres, 0 and 65535 unknown) and
    ``.pose.txt`` (4 x 4, camera to world). **The truth is soft**: colour and depth come from two cameras that
    are not registered, shutters roll, and poses are those of a tracker (KinectFusion); expect 1 to 2 px of
    systematic error in the flow. Show it, but do not calibrate on it. Depth and pose are those of the image's
    number; times are nominal, number / 30 s.

    Parameters
    ----------
    folder : Path or str
        One sequence, e.g. ``chess/seq-01``.
    camera : Pinhole, str or sequence of float, optional
        By default that of ``camera-intrinsics.txt`` (3 x 3) if there is one, else, of images of 640 x 480
        pixels, 585, 320, 240.
    lenient : bool
        Images may be missing between others: they are told when they are chosen.

    Raises
    ------
    DataError
        If there are no images, or they are not numbered without gaps.
    """

    times_source = f"frame/{FRAMES_PER_SECOND:g}s"

    def __init__(self, folder: Path | str, camera: CameraLike | None = None, lenient: bool = False) -> None:
        self.folder = Path(folder)
        if not self.folder.is_dir():
            raise DataError(f"{self.folder}: no such folder")
        files = [path for kind in ("png", "jpg") for path in self.folder.glob(f"frame-*.color.{kind}")]
        if not files:
            raise DataError(f"{self.folder}: no images frame-NNNNNN.color.png, not a 7-Scenes sequence")
        shape = "frame-NNNNNN.color.png"
        frames = numbered(files, r"frame-([0-9]+)\.color\.\w+", shape, lenient)
        self._numbers = frames.numbers
        parts = self.folder.resolve().parts
        scene = "-".join(parts[-2:]) if parts[-1].startswith("seq-") else parts[-1]
        super().__init__(f"seven-scenes/{printable(scene)}", frames.files, lenient)
        if camera is not None:
            self.lens = given_lens(camera, self.shape)
        else:
            self.lens = _intrinsics(self.folder / "camera-intrinsics.txt") or KINECT

    def timestamp(self, k: int) -> float:
        """Return the nominal time [s] of frame k.

        Raises
        ------
        DataError
            If there is no such frame.
        """
        return float(self._numbers[frame_index(self, k)] / FRAMES_PER_SECOND)

    def T_n_c(self, k: int) -> RigidTransform:
        """Return the pose of frame k, which takes points in {c} to points in {n} [m].

        Raises
        ------
        DataError
            If there is no such frame, or its file is missing or not a pose.
        """
        path = self._beside(k, ".pose.txt")
        rows, _ = read_table(path, 4, "4 numbers (a row of a 4 x 4 pose)")
        if len(rows) != 4:
            raise DataError(f"{path}: {len(rows)} rows, but a pose is 4 x 4")
        return rigid_transform(rows, str(path))

    def depth(self, k: int) -> NDArray[np.float64]:
        """Return the measured depth (H, W) [m] along z; NaN where unknown.

        Raises
        ------
        DataError
            If there is no such frame, or its file is missing, damaged or of another size.
        """
        return read_depth(self._beside(k, ".depth.png"), self.shape, MM_PER_M, UNKNOWN)

    def _beside(self, k: int, end: str) -> Path:
        name = self.files[frame_index(self, k)].name
        return self.folder / (name.partition(".color.")[0] + end)


def _intrinsics(path: Path) -> Lens | None:
    if not path.is_file():
        return None
    K, _ = read_table(path, 3, "3 numbers (a row of a 3 x 3 camera matrix)")
    return matrix_lens(K, str(path))
