"""Arrays of the uncertainty figure."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from flowlik.flow.base import Image
from flowlik.measurement.measurements import Measurements
from flowlik.support.arrays import Array


def uncertainty_picture(
    image: Image, m: Measurements, half_width: Array, confidence: float
) -> dict[str, NDArray[Any]]:
    """Arrays of the uncertainty figure: maps that are NaN where nothing was measured."""
    column, row = np.rint(m.pixels).astype(int).T
    maps = {
        "flow": np.full((*image.shape, 2), np.nan, np.float32),
        "half_width": np.full((*image.shape, 2), np.nan, np.float32),
        "angle": np.full(image.shape, np.nan, np.float32),
    }
    maps["flow"][row, column] = m.flow
    maps["half_width"][row, column] = half_width
    maps["angle"][row, column] = np.arctan2(m.R_i_e[:, 1, 0], m.R_i_e[:, 0, 0])
    return {"image": image, **maps, "confidence": np.array(confidence)}
