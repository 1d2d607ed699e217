"""Where flow may be measured in images that show more than the scene: a hood, the black beyond a lens."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from flowlik.flow.base import DenseFlow, FlowMethod, Image, all_pixels
from flowlik.flow.lucas_kanade import LucasKanade, detect_corners
from flowlik.image.texture import TextureDefinition
from flowlik.measurement.measurements import Measurements
from flowlik.support.arrays import Array

WINDOWS = ("window", "poly_n", "patch_size")
"""What flow methods call the sides of their windows [px]."""

Usable = NDArray[np.bool_]


def reach(method: FlowMethod, texture: TextureDefinition) -> int:
    """How far [px] the windows of a flow method and of texture reach; of one without windows, texture's.

    What a pyramid or a network sees further away only begins or regularises the flow, and is not counted.
    """
    of_flow = sum(int(getattr(method, name, 0)) for name in WINDOWS) // 2
    return max(of_flow, texture.window // 2 + 1)


def clear(usable: Usable, margin: int) -> Usable:
    """Pixels (H, W) around which, so far [px], all of the image is usable."""
    square = np.ones((2 * margin + 1, 2 * margin + 1), np.uint8)
    return np.asarray(cv2.erode(usable.astype(np.uint8), square) > 0)


def clear_pixels(
    images: tuple[Image, Image],
    method: FlowMethod,
    texture: TextureDefinition,
    usable: Usable | None,
    pixels: Array | None = None,
) -> Array | None:
    """Of the pixels (N, 2) to measure at, those whose windows hold usable pixels only.

    Parameters
    ----------
    images : pair of uint8 array (H, W)
        Images k-1 and k.
    method : FlowMethod
        Flow.
    texture : TextureDefinition
        Definition of texture.
    usable : bool array (H, W), optional
        Usable pixels; without it all are, and what is given is returned.
    pixels : array (N, 2), optional
        Where to measure [px]; by default where the method itself chooses.
    """
    if usable is None:
        return pixels
    if pixels is None and isinstance(method, DenseFlow):
        pixels = all_pixels(usable.shape)
    elif pixels is None:
        corners = isinstance(method, LucasKanade)
        pixels = detect_corners(images[0]) if corners else method.measure(*images)[0]
    return pixels[_holds(clear(usable, reach(method, texture)), pixels)]


def ending_clear(m: Measurements, method: FlowMethod, usable: Usable | None) -> Measurements:
    """Measurements whose windows in the second image, if they end in it, hold usable pixels only."""
    if usable is None:
        return m
    ends = m.pixels + m.flow
    height, width = usable.shape
    inside = np.asarray(((ends >= 0) & (ends <= [width - 1, height - 1])).all(axis=1))
    kept = ~inside
    kept[inside] = _holds(clear(usable, reach(method, m.texture)), ends[inside])
    return m.select(kept)


def _holds(where: Usable, pixels: Array) -> Usable:
    """Whether a mask holds at the pixels nearest to points (N, 2)."""
    column, row = np.rint(pixels).astype(np.int64).T
    return where[row, column]
