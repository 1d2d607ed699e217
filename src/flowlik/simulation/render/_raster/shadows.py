"""The shadow map of a scene."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from flowlik.simulation.render._daylight import Daylight
from flowlik.simulation.render._prototypes import Floats
from flowlik.simulation.render._raster._shadow import cast_shadows
from flowlik.simulation.render._raster.packed import Drawn, Shapes
from flowlik.support.arrays import Array
from flowlik.support.threads import in_bands

TEXELS = 4096
_ROWS_PER_BAND = 1024


class Shadows(NamedTuple):
    """Heights towards the sun, in the sun's axes."""

    axes: Array  # (4, 3): towards the sun; two axes across the light, and towards the sun again
    heights: Floats  # (n, n) [m]
    origin: Array  # (3,) point of {n} at the middle of the map [m]
    rate: float  # texels a metre


def no_shadows(light: Daylight) -> Shadows:
    """Make an empty map: the sun reaches everywhere that faces it."""
    return Shadows(_axes(light), np.full((1, 1), -np.inf, np.float32), np.zeros(3), 1.0)


def shadow_map(
    shapes: Shapes, drawn: Drawn, spheres: Array, light: Daylight, area: tuple[float, float, float]
) -> Shadows:
    """Cast shadows on a square of the ground.

    Parameters
    ----------
    shapes, drawn
        What casts them.
    spheres : array (N, 4)
        Bounding spheres of the copies [m].
    light : Daylight
        Where the sun stands.
    area : tuple of three float
        Centre x, z and half size [m].
    """
    x, z, half_m = area
    rate = TEXELS / (2.0 * half_m)
    axes = _axes(light)
    # the middle lies on a whole texel of the world, so that overlapping maps agree
    across = np.rint(axes[1:3] @ [x, 0.0, z] * rate) / rate
    origin = across @ axes[1:3]
    heights: NDArray[np.float32] = np.empty((TEXELS, TEXELS), np.float32)
    in_bands(
        lambda first, last: cast_shadows(
            first, last, shapes, drawn, spheres, axes[1:], origin, rate, heights
        ),
        TEXELS,
        _ROWS_PER_BAND,
    )
    return Shadows(axes, heights, origin, rate)


def _axes(light: Daylight) -> Array:
    to_sun = light.to_sun
    first = np.cross(to_sun, [0.0, 1.0, 0.0]) if abs(to_sun[1]) < 0.999 else np.array([1.0, 0.0, 0.0])
    first = first / np.linalg.norm(first)
    return np.stack([to_sun, first, np.cross(to_sun, first), to_sun])
