"""How much of a plant is drawn: leaves in their shape near by, fewer and larger ones far away, no far twigs.

The share of leaves falls smoothly with distance while those left grow, so that the expected cover stays the
same and nothing pops between frames (stochastic simplification: Cook, Halstead, Planck and Ryu, ACM
Transactions on Graphics 26(3), 2007).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from flowlik.simulation.render._prototypes import Instances
from flowlik.simulation.render._raster.packed import Shapes
from flowlik.support.arrays import Array

FINE_PX = (4.0, 8.0)
"""Half length of a leaf on the screen below which none, and above which all, are drawn in their shape."""

WHOLE_PX = 1.6
"""Half length on the screen below which leaves are thinned out."""

LEAST_SHARE = 1 / 64

THIN_PX = 0.3
"""Width on the screen below which a triangle of a plant's wood is left out."""


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


def drawn_wood(
    shapes: Shapes, instances: Instances, least_width_m: Array
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """How many triangles of each copy's mesh are at least so wide (N,) [m], and how many vertices they use.

    Only plants have triangles that are left out; the widest come first.
    """
    p = instances.prototypes
    least = least_width_m / np.linalg.norm(instances.transforms[:, :, 0], axis=1)
    parts, points = np.diff(shapes.triangle_starts)[p], np.diff(shapes.vertex_starts)[p]
    for plant in np.unique(p[shapes.leaf_materials[p] >= 0]):
        mine = p == plant
        rows = slice(shapes.triangle_starts[plant], shapes.triangle_starts[plant + 1])
        wide = np.searchsorted(-shapes.widths[rows], -least[mine], side="right")
        parts[mine] = wide
        points[mine] = np.concatenate([[0], shapes.points_used[rows]])[wide]
    return parts, points
