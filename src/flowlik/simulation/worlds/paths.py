"""Centre lines in {n} that every world keeps free of geometry, as functions of the distance flown."""

from __future__ import annotations

from functools import cache

import numpy as np

from flowlik.support.arrays import Array

STRAIGHT_LENGTH_M = 110.0
LOOP_LENGTH_M = 198.0
"""Length of one lap of the figure eight: 1980 steps at 6 m/s and 60 frames/s."""

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
    angle = _eight_angle(distance_m)
    return _eight_position(angle), np.arctan2(*_eight_tangent(angle))


def figure_eight_curvature(distance_m: Array) -> Array:
    """Change of heading a metre (N,) [rad/m] along `figure_eight`; positive in right turns."""
    angle = _eight_angle(distance_m)
    dx, dz = _eight_tangent(angle)
    ddx, ddz = -4 * _EIGHT_HALF_WIDTH_M * np.sin(2 * angle), _EIGHT_HALF_LENGTH_M * np.cos(angle)
    return np.asarray((ddx * dz - dx * ddz) / (dx**2 + dz**2) ** 1.5 / _eight()[2])


def keep_free() -> Array:
    """Points (N, 3) [m] on all centre lines, at most 0.25 m apart."""
    straight_m = np.arange(0, STRAIGHT_LENGTH_M, 0.25)
    eight_m = np.arange(0, LOOP_LENGTH_M, 0.25)
    return np.concatenate([straight_line(straight_m)[0], figure_eight(eight_m)[0]])


def _eight_angle(distance_m: Array) -> Array:
    angles, travelled_m, _ = _eight()
    return np.interp(np.mod(distance_m, LOOP_LENGTH_M), travelled_m, angles)


def _eight_position(angle: Array) -> Array:
    scale = _eight()[2]
    x, z = _eight_shape(angle)
    return np.stack([scale * x, np.zeros_like(x), _EIGHT_CENTRE_Z_M + scale * z], axis=-1)


def _eight_shape(angle: Array) -> tuple[Array, Array]:
    return _EIGHT_HALF_WIDTH_M * np.sin(2 * angle), -_EIGHT_HALF_LENGTH_M * np.cos(angle)


def _eight_tangent(angle: Array) -> tuple[Array, Array]:
    return 2 * _EIGHT_HALF_WIDTH_M * np.cos(2 * angle), _EIGHT_HALF_LENGTH_M * np.sin(angle)


@cache
def _eight() -> tuple[Array, Array, float]:
    """Angles, the length of path [m] up to each, and the scale that makes a lap `LOOP_LENGTH_M` long."""
    angles = np.linspace(0, 2 * np.pi, 40_001)
    x, z = _eight_shape(angles)
    travelled = np.concatenate([[0.0], np.cumsum(np.hypot(np.diff(x), np.diff(z)))])
    scale = LOOP_LENGTH_M / travelled[-1]
    return angles, scale * travelled, float(scale)
