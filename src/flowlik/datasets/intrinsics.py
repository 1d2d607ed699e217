"""A camera that the user gives to a data set that has none of its own."""

from __future__ import annotations

from collections.abc import Sequence as Seq

from flowlik.camera import Pinhole
from flowlik.errors import DataError
from flowlik.files import numbers

CameraLike = Pinhole | str | Seq[float]
"""A camera, or its numbers [px] as text or sequence: ``f,cx,cy`` or ``fx,fy,cx,cy``."""


def given_camera(camera: CameraLike, shape: tuple[int, ...]) -> Pinhole:
    """Camera of images of the shape (H, W).

    Raises
    ------
    DataError
        If it is of another image size, or there are not three or four sensible numbers.
    """
    height, width = shape[:2]
    if isinstance(camera, Pinhole):
        if (camera.width, camera.height) != (width, height):
            size = f"{camera.width} x {camera.height}"
            raise DataError(f"camera: made for images of {size} pixels, these are {width} x {height}")
        return camera
    words = camera.split(",") if isinstance(camera, str) else [str(value) for value in camera]
    if len(words) not in (3, 4):
        raise DataError(f"camera {camera!r}: expected f,cx,cy or fx,fy,cx,cy [px]")
    values = numbers(words, f"camera {camera!r}")
    fx, fy, cx, cy = values if len(values) == 4 else [values[0], *values]
    return Pinhole(width, height, fx, fy, cx, cy)
