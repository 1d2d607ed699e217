"""A sequence with its images made smaller or larger, and camera, depth and flow with them."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from flowlik.datasets._images import MAX_PIXELS
from flowlik.datasets._lens import WHOLE
from flowlik.datasets._wrapped import Wrapped
from flowlik.datasets.base import ImageSequence, mask_of
from flowlik.errors import DataError
from flowlik.geometry.camera import Pinhole
from flowlik.image.sampling import sample_flow, sample_inverse_depth
from flowlik.support.arrays import Array

LEAST_PX = 16
MOST_FACTOR = 10
EXPECTED = "expected WIDTHxHEIGHT [px], such as 640x360, or a factor, such as 0.5"


@dataclass(frozen=True)
class Resize:
    """A new size for images: fixed, or a factor of the old one.

    Parameters
    ----------
    width, height : int, optional
        Size [px].
    factor : float, optional
        Of width and height, instead.
    """

    width: int | None = None
    height: int | None = None
    factor: float | None = None

    @classmethod
    def of(cls, text: str) -> Resize:
        """Size of a text, ``640x360`` or ``0.5``.

        Raises
        ------
        DataError
            If it is neither.
        """
        if size := re.fullmatch(r"\s*(\d{1,6})\s*[xX×]\s*(\d{1,6})\s*", text):
            return cls(int(size[1]), int(size[2]))
        if re.fullmatch(r"\s*(\d+\.?\d*|\.\d+)\s*", text) and 0 < float(text) <= MOST_FACTOR:
            return cls(factor=float(text))
        raise DataError(f"--resize {text!r}: {EXPECTED}")

    def shape(self, shape: tuple[int, ...]) -> tuple[int, int]:
        """Height and width of images that were of the shape (H, W).

        Raises
        ------
        DataError
            If that is less than 16 pixels, or more than an image may have.
        """
        if self.factor is None:
            assert self.width is not None and self.height is not None
            width, height = self.width, self.height
        else:
            height, width = (round(side * self.factor) for side in shape[:2])
        if min(width, height) < LEAST_PX or width * height > MAX_PIXELS:
            raise DataError(
                f"--resize: images of {shape[1]} x {shape[0]} pixels would become {width} x {height}; "
                f"a side has {LEAST_PX} at least, an image {MAX_PIXELS} pixels at most"
            )
        return height, width


class Resized(Wrapped):
    """A `ImageSequence` with images of another size, and all that counts in pixels scaled with them.

    What lies at u before lies at (u + 1/2) s - 1/2 after, since pixels have their origin at their centre.
    Images are averaged where they shrink, else interpolated; depth and flow are interpolated on one surface,
    else those of the nearest pixel, and flow is multiplied by s. A pixel is usable if all that it was made of
    is.

    Parameters
    ----------
    inner : ImageSequence
        The sequence.
    resize : Resize
        The size.

    Raises
    ------
    DataError
        If the new size is impossible.
    """

    def __init__(self, inner: ImageSequence, resize: Resize) -> None:
        super().__init__(inner)
        self.resize = resize
        resize.shape(super().shape)

    def on(self, inner: ImageSequence) -> Resized:
        """Return another sequence resized alike."""
        return Resized(inner, self.resize)

    @property
    def shape(self) -> tuple[int, int]:
        """Height and width of the first image."""
        return self.resize.shape(super().shape)

    @property
    def camera(self) -> Pinhole:
        """The camera of the resized images."""
        camera = self.inner.camera
        height, width = self.resize.shape((camera.height, camera.width))
        sx, sy = width / camera.width, height / camera.height
        cx, cy = (camera.cx + 0.5) * sx - 0.5, (camera.cy + 0.5) * sy - 0.5
        return Pinhole(width, height, camera.fx * sx, camera.fy * sy, cx, cy)

    def image(self, k: int) -> NDArray[np.uint8]:
        """Resized grey image (H, W) of frame k."""
        return self._resized(self.inner.image(k))

    def right_image(self, k: int) -> NDArray[np.uint8]:
        """Resized grey image (H, W) of the second camera, where there is one."""
        right: Any = self.inner
        return self._resized(right.right_image(k))

    def mask(self, k: int) -> NDArray[np.bool_] | None:
        """Usable pixels (H, W) of frame k, made of nothing but usable ones; None if all are."""
        usable = mask_of(self.inner, k)
        return None if usable is None else self._resized(usable.astype(np.float32)) > WHOLE

    def depth(self, k: int) -> Array:
        """Return the depth (H, W) [m] along z of frame k; NaN where unknown."""
        depth = self.inner.depth(k)
        before = self._before(depth.shape)
        with np.errstate(divide="ignore"):
            return np.asarray(
                1 / sample_inverse_depth(depth, before.reshape(-1, 2)).reshape(before.shape[:2])
            )

    def flow(self, k: int) -> Array:
        """Return the true flow (H, W, 2) [px of the resized images]; NaN where unknown."""
        flow = self.inner.flow(k)
        before = self._before(flow.shape)
        scale = np.divide(before.shape[1::-1], flow.shape[1::-1])
        return np.asarray(sample_flow(flow, before.reshape(-1, 2)).reshape(before.shape) * scale)

    def visible(self, k: int) -> NDArray[np.bool_]:
        """Return which pixels (H, W) of frame k frame k + 1 shows again, by the nearest one before."""
        whole: Any = self.inner
        visible = whole.visible(k)
        u, v = np.rint(self._before(visible.shape)).astype(int).transpose(2, 0, 1)
        return np.asarray(visible[np.minimum(v, visible.shape[0] - 1), np.minimum(u, visible.shape[1] - 1)])

    def _resized(self, values: NDArray[Any]) -> NDArray[Any]:
        height, width = self.resize.shape(values.shape)
        smaller = height <= values.shape[0] and width <= values.shape[1]
        kind = cv2.INTER_AREA if smaller else cv2.INTER_LINEAR
        return np.asarray(cv2.resize(values, (width, height), interpolation=kind))

    def _before(self, shape: tuple[int, ...]) -> Array:
        """Where in values of the shape (H, W, ...) each resized pixel was, (H', W', 2)."""
        height, width = self.resize.shape(shape)
        u = (np.arange(width) + 0.5) * (shape[1] / width) - 0.5
        v = (np.arange(height) + 0.5) * (shape[0] / height) - 0.5
        return np.stack(np.meshgrid(u, v), axis=-1)


def resized(sequence: ImageSequence, size: str | None) -> ImageSequence:
    """Sequence with its images made smaller or larger, and camera, depth, flow and mask with them.

    Parameters
    ----------
    sequence : ImageSequence
        The sequence; undistorted, if it has a lens.
    size : str, optional
        ``WIDTHxHEIGHT`` [px] or a factor; without one the sequence stays as it is.

    Raises
    ------
    DataError
        If that is no possible size.
    """
    return sequence if size is None else Resized(sequence, Resize.of(size))
