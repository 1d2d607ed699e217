"""Patches of an image, as kernels of flow and of signals take them."""

from __future__ import annotations

import numpy as np
from numba import njit


@njit(cache=True, inline="always")
def copy_patch(image, row, column, rows, width, out):  # type: ignore[no-untyped-def]
    """Copy a rectangle of an image into rows, one after the other."""
    # an index without a sign needs no check for one, which would keep processors from copying many at once
    first_row, first, k = np.uint64(row), np.uint64(column), np.uint64(0)
    for y in range(rows):
        for x in range(width):
            out[k + np.uint64(x)] = image[first_row + np.uint64(y), first + np.uint64(x)]
        k += np.uint64(width)
