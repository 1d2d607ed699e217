"""A user's mask: which pixels of the images as they are may be used."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from flowlik.datasets._images import decode_image, of_size
from flowlik.errors import DataError

LEAST_USABLE = 0.01
MOST_GREY = 0.01
GREY = (64, 191)
"""Values between are neither black nor white; what compression adds around them is smaller."""


def read_mask(path: Path | str, shape: tuple[int, ...]) -> NDArray[np.bool_]:
    """Read a mask: an image, white where pixels may be used, black elsewhere.

    Parameters
    ----------
    path : Path or str
        Any image file; colour is made grey, 16 bits are scaled to 8.
    shape : tuple of int
        Height and width of the images it is for, before they are undistorted or resized.

    Returns
    -------
    bool array (H, W)
        Which pixels are usable.

    Raises
    ------
    DataError
        If the file is missing or no image, of another size, not black and white, or leaves less than 1 % of
        the pixels.
    """
    path = Path(path)
    grey = of_size(decode_image(path, cv2.IMREAD_GRAYSCALE), shape, path, "the image")
    between = np.mean((grey >= GREY[0]) & (grey <= GREY[1]))
    if between > MOST_GREY:
        raise DataError(
            f"{path}: not black and white ({between:.0%} of the pixels are between): a mask is white where "
            "pixels are used, black elsewhere"
        )
    usable = grey > GREY[1]
    if usable.mean() < LEAST_USABLE:
        raise DataError(
            f"{path}: {usable.mean():.2%} of the pixels are white, the largest value is {grey.max()}: a mask "
            "is white (255) where pixels are used"
        )
    return np.asarray(usable)
