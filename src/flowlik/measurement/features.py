"""Where flow is measured for a motion: a sparse method's own corners, or a share of all pixels."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from flowlik.flow.base import DenseFlow, FlowMethod, Image
from flowlik.image.texture import TextureDefinition
from flowlik.measurement.masking import measure_clear
from flowlik.measurement.measurements import Measurements, stratified_pixels

DENSE_PIXELS = 4000


def measure_features(
    previous: Image,
    current: Image,
    method: FlowMethod,
    texture: TextureDefinition,
    seed: int = 0,
    signals: Iterable[str] = (),
    usable: NDArray[np.bool_] | None = None,
) -> Measurements:
    """Measure at a method's own corners, or at 4000 stratified pixels of a dense one.

    Where some pixels (H, W) are not usable, nothing is measured whose windows hold them, in either image.

    Raises
    ------
    DataError
        If the image is too small.
    """
    pixels = None
    if isinstance(method, DenseFlow):
        pixels = stratified_pixels(previous.shape, DENSE_PIXELS, np.random.default_rng(seed))
    return measure_clear((previous, current), method, texture, usable, pixels, signals)


def features_of(method: FlowMethod) -> str:
    """Feature choice as a protocol names it."""
    return f"stratified-{DENSE_PIXELS}" if isinstance(method, DenseFlow) else "corners"
