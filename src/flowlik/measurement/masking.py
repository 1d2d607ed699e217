"""Where flow may be measured in images that show more than the scene: a hood, the black beyond a lens."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from flowlik.flow.base import DenseFlow, FlowMethod, Image, all_pixels
from flowlik.flow.lucas_kanade import LucasKanade, detect_corners
from flowlik.image.masks import clear
from flowlik.image.sampling import at_nearest
from flowlik.image.texture import TextureDefinition
from flowlik.measurement.measurements import Measurements, measure
from flowlik.support.arrays import Array

WINDOWS = ("window", "poly_n", "patch_size")
"""What flow methods call the sides of their windows [px]."""


def reach(method: FlowMethod, texture: TextureDefinition) -> int:
    """How far [px] the windows of a flow method and of texture reach; of one without windows, texture's.

    What a pyramid or a network sees further away only begins or regularises the flow, and is not counted.
    """
    of_flow = sum(int(getattr(method, name, 0)) for name in WINDOWS) // 2
    return max(of_flow, texture.window // 2 + 1)


def measure_clear(
    images: tuple[Image, Image],
    method: FlowMethod,
    texture: TextureDefinition,
    usable: NDArray[np.bool_] | None = None,
    pixels: Array | None = None,
    signals: Iterable[str] = (),
) -> Measurements:
    """`measure` vectors whose windows, in both images, hold usable pixels only.

    Parameters
    ----------
    images : pair of uint8 array (H, W)
        Images k-1 and k.
    method : FlowMethod
        Flow.
    texture : TextureDefinition
        Definition of texture.
    usable : bool array (H, W), optional
        Usable pixels of both; without it all are.
    pixels : array (N, 2), optional
        Where to measure [px]; by default where the method itself chooses.
    signals : iterable of str
        Signals to measure besides.
    """
    if usable is None:
        return measure(*images, method, texture, pixels, signals)
    where = clear(usable, reach(method, texture))
    if pixels is None:
        pixels = _chosen(images, method)
    m = measure(*images, method, texture, pixels[at_nearest(where, pixels)], signals)
    ends = m.pixels + m.flow
    height, width = usable.shape
    inside = np.asarray(((ends >= 0) & (ends <= [width - 1, height - 1])).all(axis=1))
    kept = ~inside
    kept[inside] = at_nearest(where, ends[inside])
    return m.select(kept)


def _chosen(images: tuple[Image, Image], method: FlowMethod) -> Array:
    """Pixels (N, 2) at which a method measures by itself."""
    if isinstance(method, DenseFlow):
        return all_pixels(images[0].shape)
    return detect_corners(images[0]) if isinstance(method, LucasKanade) else method.measure(*images)[0]
