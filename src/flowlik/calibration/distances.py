"""Distances between flow vectors of an image, in the bins over which a correlation of scores is measured."""

from __future__ import annotations

import numpy as np
from numba import njit

from flowlik.support.arrays import Array

EDGES_PX = np.concatenate([[0.0], np.geomspace(3.0, 3072.0, 31)])
"""Edges of the distance bins; a bin's distances stand for their geometric mean."""

PER_OCTAVE = float((len(EDGES_PX) - 2) / np.log2(EDGES_PX[-1] / EDGES_PX[1]))


@njit(cache=True, inline="always")
def bin_of(square, first, per_octave, last):  # type: ignore[no-untyped-def]
    """Row of sums of two different vectors whose squared distance [px^2] is given."""
    if square >= first * first:
        return min(2 + int(per_octave * 0.5 * np.log2(square / (first * first))), last)
    return 1


def distances_px() -> Array:
    """Distance (D + 1,) [px] that stands for each row of sums: each vector with itself, then the bins."""
    middle = np.sqrt(EDGES_PX[1:-1] * EDGES_PX[2:])
    return np.concatenate([[0.0, EDGES_PX[1] / 2], middle])
