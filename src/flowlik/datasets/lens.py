"""A lens that distorts, and sequences seen as a pinhole camera would have seen them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from flowlik.datasets.base import ImageSequence, is_visible, motion_to_next, true_flow, visibility_next
from flowlik.datasets.frames import Lacking
from flowlik.errors import DataError
from flowlik.geometry.camera import Pinhole
from flowlik.support.arrays import Array


@dataclass(frozen=True)
class Lens:
    """Intrinsics and distortion of a camera, as a calibration gives them.

    Parameters
    ----------
    fx, fy, cx, cy : float
        Focal lengths and principal point [px].
    coefficients : tuple of float
        Of Brown and Conrady in OpenCV's order, k1 k2 p1 p2 [k3 [k4 k5 k6]], or the fisheye's four; none is a
        pinhole camera.
    fisheye : bool
        Whether the coefficients are those of the equidistant fisheye.
    size : tuple of int, optional
        Width and height [px] of the images it was calibrated for.

    Raises
    ------
    DataError
        If a focal length is not positive or a value not finite.
    """

    fx: float
    fy: float
    cx: float
    cy: float
    coefficients: tuple[float, ...] = ()
    fisheye: bool = False
    size: tuple[int, int] | None = None

    def __post_init__(self) -> None:
        width, height = self.size or (1, 1)
        Pinhole(width, height, self.fx, self.fy, self.cx, self.cy)
        if not np.isfinite(self.coefficients).all():
            raise DataError("a distortion coefficient is not a finite number")

    @property
    def distorts(self) -> bool:
        """Whether images need to be undistorted; an equidistant fisheye always does."""
        return self.fisheye or any(self.coefficients)

    def pinhole(self, shape: tuple[int, ...]) -> Pinhole:
        """Pinhole camera of undistorted images of shape (H, W), with this camera matrix.

        Raises
        ------
        DataError
            If the lens was calibrated for another size.
        """
        height, width = shape[:2]
        if self.size is not None and self.size != (width, height):
            size = " x ".join(map(str, self.size))
            raise DataError(f"camera: made for images of {size} pixels, these are {width} x {height}")
        return Pinhole(width, height, self.fx, self.fy, self.cx, self.cy)

    def maps(self, shape: tuple[int, ...]) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Columns and rows (H, W) of the pinhole camera's pixels in the distorted image.

        Raises
        ------
        DataError
            If the lens was calibrated for another size.
        """
        K, size = self.pinhole(shape).K, (shape[1], shape[0])
        d = np.array(self.coefficients or (0.0,) * 4)
        undistort = cv2.fisheye.initUndistortRectifyMap if self.fisheye else cv2.initUndistortRectifyMap
        columns, rows = undistort(K, d, np.eye(3), K, size, cv2.CV_32FC1)
        return np.asarray(columns, np.float32), np.asarray(rows, np.float32)

    def undistort(self, image: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """Image (H, W) as a pinhole camera would have seen it, bilinear; black beyond the original."""
        return _remap(image, self.maps(image.shape)) if self.distorts else image


class Undistorted(Lacking):
    """A `ImageSequence` whose images, and depth where there is any, are undistorted as they are read.

    Images are sampled bilinearly, depth at the nearest pixel (it has edges). Flow and visibility are those of
    depth and poses; a data set's own flow belongs to the distorted images and is not passed on.

    Parameters
    ----------
    sequence : ImageSequence
        The sequence as its images are.
    lens : Lens
        Its lens.
    """

    def __init__(self, sequence: ImageSequence, lens: Lens) -> None:
        self.sequence, self.lens = sequence, lens
        self.name = sequence.name
        self.times_source = getattr(sequence, "times_source", None)

    @property
    def camera(self) -> Pinhole:
        """The pinhole camera of the undistorted images."""
        return self.sequence.camera

    def __len__(self) -> int:
        """Return the number of frames."""
        return len(self.sequence)

    def image(self, k: int) -> NDArray[np.uint8]:
        """Undistorted grey image (H, W) of frame k."""
        return _remap(self.sequence.image(k), self._maps)

    def timestamp(self, k: int) -> float:
        """Return the time [s] of frame k."""
        return self.sequence.timestamp(k)

    def T_n_c(self, k: int) -> Any:
        """Return the true pose of frame k, which takes points in {c} to points in {n} [m]."""
        return self.sequence.T_n_c(k)

    def depth(self, k: int) -> Array:
        """Return the depth (H, W) [m] along z of the undistorted pixels; NaN where unknown."""
        columns, rows = self._maps
        depth = self.sequence.depth(k)
        column, row = np.rint(columns), np.rint(rows)
        inside = (column >= 0) & (column < depth.shape[1]) & (row >= 0) & (row < depth.shape[0])
        found = np.full(depth.shape, np.nan)
        found[inside] = depth[row[inside].astype(int), column[inside].astype(int)]
        return found

    def flow(self, k: int) -> Array:
        """Return the flow (H, W, 2) [px] of depth and poses; occluded pixels keep theirs."""
        return true_flow(self.camera, self.depth(k), motion_to_next(self, k))

    def visible(self, k: int) -> NDArray[np.bool_]:
        """Return which pixels (H, W) of frame k the depth of frame k + 1 shows again."""
        motion = motion_to_next(self, k)
        return is_visible(visibility_next(self.camera, self.depth(k), self.depth(k + 1), motion))

    @cached_property
    def _maps(self) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        camera = self.camera
        return self.lens.maps((camera.height, camera.width))


def _remap(
    image: NDArray[np.uint8], maps: tuple[NDArray[np.float32], NDArray[np.float32]]
) -> NDArray[np.uint8]:
    return np.asarray(cv2.remap(image, maps[0], maps[1], cv2.INTER_LINEAR), dtype=np.uint8)
