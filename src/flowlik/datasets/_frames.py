"""What readers share: a sequence that lacks everything, one of image files, one with depth and poses."""

from __future__ import annotations

from collections.abc import Sequence as Seq
from contextlib import suppress
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform

from flowlik.datasets._images import decode_image, of_size, read_grey
from flowlik.datasets.base import frame_index, lacks
from flowlik.datasets.next_frame import is_visible, motion_to_next, true_flow, visibility_next
from flowlik.errors import DataError
from flowlik.geometry.camera import Pinhole


class Lacking:
    """A sequence that has neither camera, times, poses, depth nor flow: each says so when asked for.

    Raises
    ------
    MissingFieldError
        When the camera is asked for.
    """

    name: str

    @property
    def camera(self) -> Pinhole:
        """Raise: there is no camera."""
        raise lacks(self.name, "camera")

    def timestamp(self, k: int) -> float:
        """Time [s] of frame k.

        Raises
        ------
        MissingFieldError
            Always.
        """
        raise lacks(self.name, "times")

    def T_n_c(self, k: int) -> RigidTransform:
        """Return the pose of frame k.

        Raises
        ------
        MissingFieldError
            Always.
        """
        raise lacks(self.name, "poses")

    def depth(self, k: int) -> NDArray[np.float64]:
        """Return the depth (H, W) [m] of frame k.

        Raises
        ------
        MissingFieldError
            Always.
        """
        raise lacks(self.name, "depth")

    def flow(self, k: int) -> NDArray[np.float64]:
        """Return the true flow (H, W, 2) [px] of frame k.

        Raises
        ------
        MissingFieldError
            Always.
        """
        raise lacks(self.name, "true flow, nor depth and poses to make it of")

    def visible(self, k: int) -> NDArray[np.bool_]:
        """Return which pixels (H, W) of frame k are seen again.

        Raises
        ------
        MissingFieldError
            Always.
        """
        raise lacks(self.name, "visibility")


class FrameFiles(Lacking):
    """A sequence of image files of one size.

    Parameters
    ----------
    name : str
        Data set and scene.
    files : sequence of Path
        Image files in time order, at least one; the first tells the size.
    lenient : bool
        The size is that of the first image that can be read.

    Attributes
    ----------
    shape : tuple of int
        Height and width of every image.

    Raises
    ------
    DataError
        If the first image cannot be read.
    """

    def __init__(self, name: str, files: Seq[Path], lenient: bool = False) -> None:
        self.name = name
        self.files = list(files)
        self._first, self.shape = first_readable(self.files, lenient)

    def __len__(self) -> int:
        """Return the number of frames."""
        return len(self.files)

    def image(self, k: int) -> NDArray[np.uint8]:
        """Grey image (H, W) of frame k.

        Raises
        ------
        DataError
            If there is no such frame, or its file is unreadable or of another size than the first.
        """
        path = self.files[frame_index(self, k)]
        return of_size(read_grey(path), self.shape, path, f"the first image ({self._first.name})")


class DepthFrames(FrameFiles):
    """Image files with depth and poses: flow and visibility follow from them.

    Attributes
    ----------
    measured_truth : bool
        Whether sensors measured the truth, so that it may be a pixel or two off.
    """

    measured_truth = True

    def flow(self, k: int) -> NDArray[np.float64]:
        """Return the flow (H, W, 2) [px] of depth and poses, in float64; occluded pixels keep theirs.

        Raises
        ------
        MissingFieldError
            If there is no depth or no pose.
        """
        motion = motion_to_next(self, k)
        return true_flow(self.camera, self.depth(k), motion)

    def visible(self, k: int) -> NDArray[np.bool_]:
        """Return which pixels (H, W) of frame k the depth of frame k + 1 shows again.

        Raises
        ------
        MissingFieldError
            If there is no depth or no pose.
        """
        motion = motion_to_next(self, k)
        return is_visible(visibility_next(self.camera, self.depth(k), self.depth(k + 1), motion))


def first_readable(files: Seq[Path], lenient: bool = False) -> tuple[Path, tuple[int, ...]]:
    """First image file, or with ``lenient`` the first that can be read, and its height and width."""
    for path in files[:-1] if lenient else []:
        with suppress(DataError):
            return path, read_grey(path).shape
    path = files[-1] if lenient else files[0]
    return path, read_grey(path).shape


def read_depth(
    path: Path, shape: tuple[int, ...], units_per_m: float, unknown: tuple[int, ...] = (0,)
) -> NDArray[np.float64]:
    """Depth (H, W) [m] of a 16-bit PNG; NaN where the value is one of ``unknown``.

    Raises
    ------
    DataError
        If the file is missing or damaged, has other than one 16-bit channel, or another size than the images.
    """
    values = decode_image(path, cv2.IMREAD_UNCHANGED)
    if values.dtype != np.uint16 or values.ndim != 2:
        raise DataError(f"{path}: not a depth image (a PNG of one 16-bit channel)")
    values = of_size(values, shape, path, "the image")
    return np.where(np.isin(values, unknown), np.nan, values / units_per_m)
