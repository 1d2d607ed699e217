"""Masks of usable pixels: a hood, or the black beyond a lens, is no part of the scene."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray


def clear(usable: NDArray[np.bool_], margin: int) -> NDArray[np.bool_]:
    """Pixels (H, W) around which, so far [px], all of the image is usable."""
    square = np.ones((2 * margin + 1, 2 * margin + 1), np.uint8)
    return np.asarray(cv2.erode(usable.astype(np.uint8), square) > 0)
