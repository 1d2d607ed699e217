"""Two disjoint halves of the flow vectors of an image: the white and the black tiles of a chessboard."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from flowlik.support.arrays import Array

TILE_PX = 64


def halves(pixels: Array) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Masks (N,) of two halves: the white and the black tiles, 64 px wide, of a chessboard."""
    tile = np.floor(pixels / TILE_PX).astype(int).sum(axis=1)
    return tile % 2 == 0, tile % 2 == 1
