"""How much of a plant is drawn: leaves in their shape near by, fewer and larger ones far away.

The share of leaves falls smoothly with distance while those left grow, so that the expected cover stays the
same and nothing pops between frames (stochastic simplification: Cook, Halstead, Planck and Ryu, ACM
Transactions on Graphics 26(3), 2007).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from flowlik.simulation.geometry import Array, Instances
from flowlik.simulation.raster.packed import Shapes

FINE_PX = (3.0, 6.0)
"""Half length of a leaf on the screen below which none, and above which all, are drawn in their shape."""

WHOLE_PX = 1.2
"""Half length on the screen below which leaves are thinned out."""

LEAST_SHARE = 1 / 64


def drawn_leaves(
    shapes: Shapes, instances: Instances, distance_m: Array, focal_px: float
) -> tuple[NDArray[np.int64], NDArray[np.int64], Array]:
    """How many leaves of each copy are drawn in their shape, how many at all, and the others' scale.

    Parameters
    ----------
    shapes, instances
        Prototypes and copies (N,).
    distance_m : array (N,)
        Distance of the nearest point of each copy [m].
    focal_px : float
        Focal length.

    Returns
    -------
    tuple of arrays (N,)
        int64, int64 and float64.
    """
    p = instances.prototypes
    leaves = np.diff(shapes.leaf_starts)[p]
    size_m = shapes.leaf_sizes[p] * np.linalg.norm(instances.transforms[:, :, 0], axis=1)
    size_px = size_m * focal_px / np.maximum(distance_m, 0.1)
    fine = np.clip((size_px - FINE_PX[0]) / (FINE_PX[1] - FINE_PX[0]), 0, 1)
    share = np.clip((size_px / WHOLE_PX) ** 2, LEAST_SHARE, 1)
    count = np.ceil(share * leaves)
    # scaled by what is drawn, not by the share, so that the cover is that of all leaves
    scale = np.sqrt(np.divide(leaves, count, out=np.ones(len(p)), where=count > 0))
    return np.floor(fine * leaves).astype(np.int64), count.astype(np.int64), scale
