"""Centre lines in {n} that every world keeps free of geometry, as functions of the distance flown."""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

STRAIGHT_LENGTH_M = 100.0
FREE_RADIUS_M = 2.2
"""No world places an object nearer than this to a centre line (ground excepted)."""

_EIGHT_HALF_WIDTH_M = 10.0
_EIGHT_HALF_LENGTH_M = 42.0
_EIGHT_CENTRE_Z_M = 50.0


def straight_line(distance_m: Array) -> tuple[Array, Array]:
    """Positions (N, 3) [m] and headings (N,) [rad about y, 0 = along z] on the line along z."""
    zero = np.zeros_like(distance_m)
    return np.stack([zero, zero, distance_m], axis=-1), zero


def figure_eight(distance_m: Array) -> tuple[Array, Array]:
    """Positions (N, 3) [m] and headings (N,) [rad] on a closed, level figure eight along z."""
    angles, travelled_m = _eight_arc_length()
    angle = np.interp(np.mod(distance_m, travelled_m[-1]), travelled_m, angles)
    return _eight_position(angle), np.arctan2(*_eight_tangent(angle))


def keep_free() -> Array:
    """Points (N, 3) [m] on all centre lines, at most 0.25 m apart."""
    straight_m = np.arange(0, STRAIGHT_LENGTH_M, 0.25)
    eight_m = np.arange(0, _eight_arc_length()[1][-1], 0.25)
    return np.concatenate([straight_line(straight_m)[0], figure_eight(eight_m)[0]])


def _eight_position(angle: Array) -> Array:
    x = _EIGHT_HALF_WIDTH_M * np.sin(2 * angle)
    z = _EIGHT_CENTRE_Z_M - _EIGHT_HALF_LENGTH_M * np.cos(angle)
    return np.stack([x, np.zeros_like(x), z], axis=-1)


def _eight_tangent(angle: Array) -> tuple[Array, Array]:
    return 2 * _EIGHT_HALF_WIDTH_M * np.cos(2 * angle), _EIGHT_HALF_LENGTH_M * np.sin(angle)


@cache
def _eight_arc_length() -> tuple[Array, Array]:
    angles = np.linspace(0, 2 * np.pi, 40_001)
    steps_m = np.linalg.norm(np.diff(_eight_position(angles), axis=0), axis=1)
    return angles, np.concatenate([[0.0], np.cumsum(steps_m)])
