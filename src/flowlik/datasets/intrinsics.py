"""A camera that the user gives to a data set that has none of its own."""

from __future__ import annotations

from collections.abc import Sequence as Seq
from pathlib import Path

from flowlik.datasets.base import lacks
from flowlik.datasets.camera_file import read_camera
from flowlik.datasets.lens import Lens
from flowlik.errors import DataError
from flowlik.geometry.camera import Pinhole
from flowlik.support.files import numbers

CameraLike = Pinhole | Lens | str | Path | Seq[float]
"""A camera, its numbers [px] as text or sequence (``f,cx,cy`` or ``fx,fy,cx,cy``), or a camera file."""


CAMERA_HINT = "camera (give one by --camera: f,cx,cy or fx,fy,cx,cy in pixels, or a calibration file)"


class GivenCamera:
    """Base of data sets whose camera the user gives, or may have to give.

    Raises
    ------
    MissingFieldError
        When the camera is asked for and none was given.
    """

    name: str
    _camera: Pinhole | None = None

    @property
    def camera(self) -> Pinhole:
        """The camera of every image."""
        if self._camera is None:
            raise lacks(self.name, CAMERA_HINT)
        return self._camera


def read_if_file(camera: CameraLike) -> CameraLike:
    """Lens of a camera file; anything that is no name of a file is passed on.

    Raises
    ------
    DataError
        If the file is missing or malformed.
    """
    if isinstance(camera, Path):
        return read_camera(camera)
    if isinstance(camera, str) and "," not in camera:
        if not Path(camera).is_file():
            raise DataError(
                f"camera {camera!r}: no such file; expected f,cx,cy or fx,fy,cx,cy [px], or a camera file"
            )
        return read_camera(camera)
    return camera


def given_camera(camera: CameraLike, shape: tuple[int, ...]) -> Pinhole:
    """Camera of images of the shape (H, W).

    Raises
    ------
    DataError
        If it is of another image size, or there are not three or four sensible numbers.
    """
    height, width = shape[:2]
    camera = read_if_file(camera)
    if isinstance(camera, Lens):
        return camera.pinhole(shape)
    if isinstance(camera, Pinhole):
        if (camera.width, camera.height) != (width, height):
            size = f"{camera.width} x {camera.height}"
            raise DataError(f"camera: made for images of {size} pixels, these are {width} x {height}")
        return camera
    assert not isinstance(camera, Path)
    words = camera.split(",") if isinstance(camera, str) else [str(value) for value in camera]
    if len(words) not in (3, 4):
        raise DataError(f"camera {camera!r}: expected f,cx,cy or fx,fy,cx,cy [px]")
    values = numbers(words, f"camera {camera!r}")
    fx, fy, cx, cy = values if len(values) == 4 else [values[0], *values]
    # numbers typed in the wrong order; readers' own cameras are what they are
    if isinstance(camera, str) and not (0 <= cx < width and 0 <= cy < height):
        raise DataError(
            f"camera {camera!r}: principal point ({cx:g}, {cy:g}) outside of the image of {width} x {height} "
            "pixels; the order is f,cx,cy or fx,fy,cx,cy (of a cropped image, give a camera file)"
        )
    return Pinhole(width, height, fx, fy, cx, cy)
