"""How far points are from the surfaces of a scene."""

from __future__ import annotations

import numpy as np

from flowlik.simulation.render._raster._distance import nearest_surface
from flowlik.simulation.render._raster.packed import Drawn, Shapes
from flowlik.support.arrays import Array
from flowlik.support.threads import in_bands

_POINTS_PER_BAND = 16


def distances_m(points: Array, shapes: Shapes, drawn: Drawn, spheres: Array, most_m: float) -> Array:
    """Distance (N,) [m], at most `most_m`, of points (N, 3) in {n} to copies with bounding spheres (M, 4).

    A leaf counts as a ball around its centre.
    """
    distances = np.empty(len(points))
    in_bands(
        lambda first, last: nearest_surface(first, last, points, shapes, drawn, spheres, most_m, distances),
        len(points),
        _POINTS_PER_BAND,
    )
    return distances
