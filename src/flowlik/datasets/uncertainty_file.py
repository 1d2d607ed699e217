"""The uncertainty of a flow as a 16-bit PNG, beside the flow's own."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from flowlik.datasets._images import decode_image
from flowlik.errors import DataError
from flowlik.support.arrays import Array
from flowlik.support.files import atomic_write

STEPS_PER_PX = 256
LARGEST = 2**16 - 1
STEPS_PER_TURN = 2**16
"""Of half a turn: an eigenvector has no sign."""


class Uncertainty(NamedTuple):
    """What `read_uncertainty` returns."""

    half_width_px: Array
    angle: Array


def write_uncertainty(path: Path | str, half_width_px: NDArray, angle: NDArray) -> None:
    """Write half-widths and directions as a PNG of three 16-bit channels.

    Red is the half-width along e1 and green that along e2, in 1/256 px, at least 1 and at most 65535
    (255.996 px or more); 0 in both is unknown. Blue is the angle of e1 from the u axis towards the v axis,
    in 1/65536 of half a turn.

    Parameters
    ----------
    path : Path or str
        File.
    half_width_px : array (H, W, 2)
        Half-widths of the interval along e1 and e2 [px]; NaN where unknown.
    angle : array (H, W)
        Angle of e1 [rad], modulo half a turn.

    Raises
    ------
    DataError
        If the place cannot be written to.
    """
    known = np.asarray(np.isfinite(half_width_px).all(axis=-1) & np.isfinite(angle))
    widths = np.clip(np.rint(np.where(known[..., None], half_width_px, 0.0) * STEPS_PER_PX), 1, LARGEST)
    turns = np.rint(np.where(known, angle, 0.0) / np.pi * STEPS_PER_TURN) % STEPS_PER_TURN
    image = np.dstack([turns, widths[..., 1], widths[..., 0]])  # OpenCV's order: blue, green, red
    image[~known] = 0
    with atomic_write(path, "wb") as file:
        file.write(cv2.imencode(".png", image.astype(np.uint16))[1].tobytes())


def read_uncertainty(path: Path | str) -> Uncertainty:
    """Read what `write_uncertainty` wrote: half-widths (H, W, 2) [px] and angles (H, W) [rad], NaN unknown.

    Raises
    ------
    DataError
        If the file is missing, damaged, or not a PNG of three 16-bit channels.
    """
    image = decode_image(path, cv2.IMREAD_UNCHANGED)
    if image.dtype != np.uint16 or image.ndim != 3 or image.shape[2] != 3:
        raise DataError(f"{path}: not an uncertainty file (a PNG of three 16-bit channels)")
    half_width = image[..., [2, 1]].astype(np.float64) / STEPS_PER_PX
    angle = image[..., 0] * (np.pi / STEPS_PER_TURN)
    unknown = (image[..., 1:] == 0).all(axis=-1)
    half_width[unknown], angle[unknown] = np.nan, np.nan
    return Uncertainty(half_width, angle)
