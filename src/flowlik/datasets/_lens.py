"""A lens: focal lengths, principal point and distortion of a camera, and the pinhole that it becomes."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

from flowlik.datasets._lens_models import BrownConrady, LensModel, true_points
from flowlik.errors import DataError
from flowlik.geometry.camera import Pinhole
from flowlik.image.sampling import sample_flow
from flowlik.support.arrays import Array

OFF_CENTRE = 0.1
"""How far from the middle, in parts of the image, a principal point may lie if no image size is told."""

BEYOND = -1e4
"""Where a map points that finds nothing."""

WHOLE = 0.999
"""Interpolated, a mask of 0 and 1 is at least so large where all it was made of is usable."""

Maps = tuple[NDArray[np.float32], NDArray[np.float32]]


@dataclass(frozen=True)
class Lens:
    """Intrinsics and distortion of a camera, as a calibration gives them.

    Parameters
    ----------
    fx, fy, cx, cy : float
        Focal lengths and principal point [px], with the origin at the centre of the top-left pixel.
    model : LensModel
        How it distorts; by default not at all.
    size : tuple of int, optional
        Width and height [px] of the images it was calibrated for.
    source : str
        Where it was read, for messages.

    Raises
    ------
    DataError
        If a focal length is not positive or a value not finite.
    """

    fx: float
    fy: float
    cx: float
    cy: float
    model: LensModel = field(default_factory=BrownConrady)
    size: tuple[int, int] | None = None
    source: str = field(default="camera", compare=False)

    def __post_init__(self) -> None:
        width, height = self.size or (1, 1)
        Pinhole(width, height, self.fx, self.fy, self.cx, self.cy)

    @property
    def distorts(self) -> bool:
        """Whether images need to be undistorted."""
        return self.model.bends

    def pinhole(self, shape: tuple[int, ...]) -> Pinhole:
        """Pinhole camera of undistorted images of shape (H, W): it keeps the scale at the principal point.

        That is the camera matrix, but for the double sphere model: there focal lengths become f / (1 + xi).

        Raises
        ------
        DataError
            If the lens was made for images of another size, or may have been: where the size is not told,
            the principal point must lie within a tenth of the image from the middle. If it lies outside of
            the image, or if the distortion turns back inside it.
        """
        height, width = shape[:2]
        _check_size(self, width, height)
        scale = self.model.magnification
        camera = Pinhole(width, height, self.fx * scale, self.fy * scale, self.cx, self.cy)
        _check_limit(self, camera)
        return camera

    def maps(self, shape: tuple[int, ...]) -> Maps:
        """Columns and rows (H, W) of the pinhole camera's pixels in the distorted image; read-only.

        Pixels of which the lens shows nothing lie far outside.
        """
        return _maps(self, (int(shape[0]), int(shape[1])))

    def valid(self, shape: tuple[int, ...]) -> NDArray[np.bool_]:
        """Which pixels (H, W) of undistorted images the original shows, with all that interpolation needs."""
        columns, rows = self.maps(shape)
        return (columns >= 1) & (columns <= shape[1] - 2) & (rows >= 1) & (rows <= shape[0] - 2)

    def straighten_mask(self, usable: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Usable pixels (H, W) of undistorted images: shown, and made of usable pixels of the original."""
        if not self.distorts:
            return usable
        parts = cv2.remap(usable.astype(np.float32), *self.maps(usable.shape), cv2.INTER_LINEAR)
        return np.asarray(self.valid(usable.shape) & (parts > WHOLE))

    def undistort(self, image: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """Image (H, W) as a pinhole camera would have seen it, bicubic; black beyond the original."""
        if not self.distorts:
            return image
        return np.asarray(cv2.remap(image, *self.maps(image.shape), cv2.INTER_CUBIC), dtype=np.uint8)

    def straighten(self, pixels: Array, shape: tuple[int, ...]) -> Array:
        """Where the pinhole camera sees what the lens shows at pixels (N, 2); NaN where it shows nothing."""
        pixels = np.asarray(pixels, dtype=np.float64)
        camera = self.pinhole(shape)
        true = true_points(self.model, (pixels - (self.cx, self.cy)) / (self.fx, self.fy))
        return np.asarray(true * (camera.fx, camera.fy) + (camera.cx, camera.cy))

    def straighten_flow(self, flow: Array) -> Array:
        """Flow (H, W, 2) [px] between undistorted images, of flow between images as the lens shows them.

        Both ends of a vector are moved. NaN where the flow is unknown, or the original does not show a pixel.
        """
        if not self.distorts:
            return np.asarray(flow, dtype=np.float64)
        shape = flow.shape[:2]
        valid = self.valid(shape)
        columns, rows = self.maps(shape)
        begins = np.column_stack([columns[valid], rows[valid]]).astype(np.float64)
        found = np.full((*shape, 2), np.nan)
        ends = self.straighten(begins + sample_flow(flow, begins), shape)
        found[valid] = ends - np.argwhere(valid)[:, ::-1]
        return found


@lru_cache(maxsize=4)
def _maps(lens: Lens, shape: tuple[int, int]) -> Maps:
    camera = lens.pinhole(shape)
    points = camera.rays(camera.pixel_grid())[:, :2]
    shown = np.linalg.norm(points, axis=1) < lens.model.limit
    found = np.full(points.shape, BEYOND)
    found[shown] = lens.model.seen(points[shown]) * (lens.fx, lens.fy) + (lens.cx, lens.cy)
    with np.errstate(invalid="ignore"):
        found[~(np.abs(found) < -BEYOND).all(axis=1)] = BEYOND
    maps = found.astype(np.float32).reshape(*shape, 2)
    columns, rows = (np.ascontiguousarray(maps[..., i]) for i in (0, 1))
    columns.flags.writeable = rows.flags.writeable = False
    return columns, rows


def _check_size(lens: Lens, width: int, height: int) -> None:
    """Refuse a lens that was made for other images, or for all that is known may have been."""
    images = f"these are {width} x {height}"
    if lens.size is not None and lens.size != (width, height):
        size = " x ".join(map(str, lens.size))
        raise DataError(
            f"{lens.source}: made for images of {size} pixels, {images}; give the images as they were "
            "calibrated (--resize then scales both), or a camera made for these"
        )
    point = f"{lens.source}: principal point ({lens.cx:g}, {lens.cy:g})"
    if not (0 <= lens.cx <= width - 1 and 0 <= lens.cy <= height - 1):
        raise DataError(
            f"{point} outside of the image, {images} pixels: made for images of another size? "
            "The order is f,cx,cy or fx,fy,cx,cy"
        )
    aside = max(abs(lens.cx - (width - 1) / 2) / width, abs(lens.cy - (height - 1) / 2) / height)
    if lens.size is None and aside > OFF_CENTRE:
        raise DataError(
            f"{point} far from the middle of the image, {images} pixels, and no size is given: made for "
            "images of another size? If it is right, give a file that says image_width and image_height too"
        )


def _check_limit(lens: Lens, camera: Pinhole) -> None:
    """Refuse a distortion that turns back where the image still shows something."""
    limit = lens.model.limit
    if not np.isfinite(limit):
        return
    u, v = np.arange(camera.width), np.arange(camera.height)
    rows = [np.stack(np.broadcast_arrays(u, y), axis=-1) for y in (0, camera.height - 1)]
    columns = [np.stack(np.broadcast_arrays(x, v), axis=-1) for x in (0, camera.width - 1)]
    points = camera.rays(np.concatenate(rows + columns))[:, :2]
    distance = np.linalg.norm(points, axis=1)
    beyond = distance > limit
    if not beyond.any():
        return
    ends = points[beyond] * (limit * (1 - 1e-9) / distance[beyond])[:, None]
    seen = lens.model.seen(ends) * (lens.fx, lens.fy) + (lens.cx, lens.cy)
    inside = camera.contains(seen)
    if inside.any():
        at = np.linalg.norm(seen[inside] - (lens.cx, lens.cy), axis=1).min()
        raise DataError(
            f"{lens.source}: its distortion turns back {at:.0f} px from the principal point, inside of the "
            f"image of {camera.width} x {camera.height} pixels: the coefficients do not hold for the whole "
            "image, or are those of another model"
        )
