"""Maps read at points between pixels; those of depth and flow never across an edge."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from flowlik.image import _kernels
from flowlik.image.depth import check_depth_z
from flowlik.support.arrays import Array

SAME_SURFACE = 0.1
SAME_FLOW_PX = 0.05


def sample_inverse_depth(depth: Array, pixels: Array) -> Array:
    """Inverse depth (N,) [1/m] at pixels (N, 2) of a depth map (H, W) [m].

    Bilinear, which is exact on a plane, where the four pixels around differ by less than 10 %, else that of
    the nearest pixel. Where this has no depth (NaN, infinite, zero or negative) the answer is not positive
    or not finite.

    Raises
    ------
    DataError
        If depth is not in floats.
    """
    check_depth_z(depth)
    return inverse_depth_at(depth, pixels)


def inverse_depth_at(depth: Array, pixels: Array) -> Array:
    """`sample_inverse_depth` of a map that has been checked."""
    sampled: Array = _kernels.inverse_surface(np.asarray(depth), _positions(pixels), SAME_SURFACE)
    return sampled


def sample_flow(flow: Array, pixels: Array) -> Array:
    """Flow (N, 2) [px] at pixels (N, 2) of a true flow field (H, W, 2).

    Bilinear where the four pixels around differ by less than 10 % and 0.05 px, else that of the nearest
    pixel, NaN where this has none.
    """
    field = np.asarray(flow, dtype=np.float64)
    sampled: Array = _kernels.surface(field, _positions(pixels), SAME_SURFACE, SAME_FLOW_PX)
    return sampled


def at_nearest(field: NDArray[Any], pixels: Array) -> NDArray[Any]:
    """Values (N, ...) of a map (H, W, ...) at the pixels nearest to points (N, 2) inside it."""
    column, row = np.rint(pixels).astype(np.int64).T
    return field[row, column]


def bilinear(field: NDArray[np.floating], pixels: Array) -> Array:
    """Channels (N, C) of a map (H, W, C) between its pixels, at points clamped to the outermost ones."""
    return _kernels.bilinear(field, _positions(pixels))


def _positions(pixels: Array) -> Array:
    return np.ascontiguousarray(pixels, dtype=np.float64)
