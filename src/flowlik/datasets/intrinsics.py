"""A camera that the user gives to a data set that has none of its own."""

from __future__ import annotations

import re
from collections.abc import Sequence as Seq
from pathlib import Path

from flowlik.datasets._camera_file import read_camera
from flowlik.datasets._lens import Lens
from flowlik.datasets.base import lacks
from flowlik.errors import DataError
from flowlik.geometry.camera import Pinhole
from flowlik.support.files import numbers

CameraLike = Pinhole | Lens | str | Path | Seq[float]
"""A camera, its numbers [px] as text or sequence (``f,cx,cy`` or ``fx,fy,cx,cy``), or a camera file; one of
several cameras in a file is ``FILE:NAME``."""

CAMERA_HINT = "camera (give one by --camera: f,cx,cy or fx,fy,cx,cy in pixels, or a calibration file)"

SQUARE = 1.05
"""Typed focal lengths that differ by a larger factor are taken for a decimal comma."""


class GivenCamera:
    """Base of data sets whose camera the user gives, or may have to give.

    Attributes
    ----------
    shape : tuple of int
        Height and width of the images.
    lens : Lens or None
        What is known of the camera. Where it distorts, images are still distorted.

    Raises
    ------
    MissingFieldError
        When the camera is asked for and none was given.
    """

    name: str
    shape: tuple[int, ...]
    lens: Lens | None = None

    @property
    def camera(self) -> Pinhole:
        """The camera of every image, once it is undistorted."""
        if self.lens is None:
            raise lacks(self.name, CAMERA_HINT)
        return self.lens.pinhole(self.shape)


def given_lens(camera: CameraLike, shape: tuple[int, ...]) -> Lens:
    """Lens that the user gives for images of the shape (H, W).

    Raises
    ------
    DataError
        If it is of another image size, a file is not known, or there are not three or four sensible numbers.
    """
    lens = _lens(camera)
    lens.pinhole(shape)
    return lens


def _lens(camera: CameraLike) -> Lens:
    if isinstance(camera, Lens):
        return camera
    if isinstance(camera, Pinhole):
        size = (camera.width, camera.height)
        return Lens(camera.fx, camera.fy, camera.cx, camera.cy, size=size)
    if isinstance(camera, Path):
        return read_camera(camera)
    if isinstance(camera, str):
        return _of_words(camera)
    return _of_numbers([str(value) for value in camera], f"camera {camera!r}")


def _of_words(camera: str) -> Lens:
    """Camera file, or numbers."""
    if Path(camera).is_file():
        return read_camera(camera)
    file, colon, name = camera.rpartition(":")
    if colon and Path(file).is_file():
        return read_camera(file, name)
    if re.search(r"\.\w*[A-Za-z]\w*$|[/\\]", camera) or "," not in camera:
        raise DataError(
            f"camera {camera!r}: no such file; expected f,cx,cy or fx,fy,cx,cy [px], or a camera file"
        )
    return _of_numbers(camera.split(","), f"camera {camera!r}")


def _of_numbers(words: list[str], where: str) -> Lens:
    expected = "expected f,cx,cy or fx,fy,cx,cy [px]"
    if len(words) not in (3, 4):
        raise DataError(f"{where}: {len(words)} numbers, {expected}; decimals have a point, not a comma")
    values = numbers([word.strip() for word in words], where)
    fx, fy, cx, cy = values if len(values) == 4 else [values[0], *values]
    if min(fx, fy) > 0 and max(fx, fy) > SQUARE * min(fx, fy):
        raise DataError(
            f"{where}: focal lengths {fx:g} and {fy:g} differ, {expected}; decimals have a point, not a "
            "comma (if pixels are not square, give a camera file)"
        )
    return Lens(fx, fy, cx, cy, source=where)
