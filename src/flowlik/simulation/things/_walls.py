"""Walls of buildings: flat sides divided into cells, with windows set into them and ledges standing out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from flowlik.simulation.render import Mesh, box
from flowlik.simulation.things._vectors import UP
from flowlik.support.arrays import Array

UNDERGROUND_M = 1.0
PANE, FRAME = 0.0, 1.0
"""Paint of a window's material: its first surface is the pane, its second the frame."""

Span = tuple[float, float]


@dataclass(frozen=True, eq=False)
class Plane:
    """A flat side of a building: an origin (3,) [m] and two unit axes (3,); across x up points outwards."""

    origin: Array
    across: Array
    up: Array

    @property
    def out(self) -> Array:
        """Unit normal (3,) that points outwards."""
        return np.cross(self.across, self.up)

    def at(self, u: float, v: float, out_m: float = 0.0) -> Array:
        """Point (3,) at (u, v) on the plane, or farther out [m]."""
        return self.origin + u * self.across + v * self.up + out_m * self.out

    def shifted(self, out_m: float) -> Plane:
        """Parallel plane farther out [m]."""
        return Plane(self.at(0, 0, out_m), self.across, self.up)

    def cells(self, us: ArrayLike, vs: ArrayLike, material: int, paint: Array | float = 0.0) -> Mesh:
        """Rectangles between lines at us (U + 1,) and vs (V + 1,) [m]; where paint (V, U) is NaN, none.

        uv is (u, v) itself, so that a texture's rows count from the plane's origin.
        """
        columns, rows = np.asarray(us, np.float64), np.asarray(vs, np.float64)
        paints = np.broadcast_to(paint, (len(rows) - 1, len(columns) - 1))
        row, column = np.nonzero(~np.isnan(paints))
        u = columns[column[:, None] + np.array([0, 1, 1, 0])]
        v = rows[row[:, None] + np.array([0, 0, 1, 1])]
        uv = np.stack([u.ravel(), v.ravel()], axis=-1)
        first = 4 * np.arange(len(row))[:, None]
        return Mesh.of(
            self.origin + uv @ np.stack([self.across, self.up]),
            np.tile(self.out, (len(uv), 1)),
            uv,
            np.concatenate([first + np.array([0, 1, 2]), first + np.array([0, 2, 3])]),
            material,
            paints[row, column].repeat(4),
        )


def sides(width_m: float, depth_m: float) -> list[Plane]:
    """Front, right, back and left of an upright block around the origin; v counts from the ground."""
    x, z = width_m / 2, depth_m / 2
    corners = np.array([(-x, 0, -z), (x, 0, -z), (x, 0, z), (-x, 0, z)])
    ahead = np.roll(corners, -1, axis=0) - corners
    return [Plane(corner, along / np.linalg.norm(along), UP) for corner, along in zip(corners, ahead)]


def pierced_wall(
    plane: Plane,
    width_m: float,
    height_m: float,
    columns: Sequence[Span],
    rows: Sequence[Span],
    wall: int,
    window: int,
) -> Mesh:
    """Wall with a recessed window, framed and with a sill, wherever a column and a row of openings cross."""
    us = np.array([0.0, *np.ravel(columns), width_m])
    vs = np.array([-UNDERGROUND_M, *np.ravel(rows), height_m])
    paint = np.zeros((len(vs) - 1, len(us) - 1))
    paint[1:-1:2, 1:-1:2] = np.nan
    parts = [plane.cells(us, vs, wall, paint)]
    for left, right in columns:
        parts += [_window(plane, left, right, low, high, wall, window) for low, high in rows]
    return Mesh.joined(parts)


def _ledge(plane: Plane, us: Span, vs: Span, out_m: float, material: int, paint: float = 0.0) -> Mesh:
    """Box between a rectangle of an upright plane along x or z and the same farther out [m]."""
    corners = np.array([plane.at(us[0], vs[0]), plane.at(us[1], vs[1], out_m)])
    block = box(corners.min(axis=0), corners.max(axis=0), material)
    return Mesh.of(block.vertices, block.normals, block.uv, block.triangles, block.materials, paint)


def openings(length_m: float, count: int, width_m: float) -> list[Span]:
    """Spans (from, to) [m] of equally spaced openings, at most 70 % of a wall's length together."""
    centres = (np.arange(count) + 0.5) * length_m / count
    half = min(width_m, 0.7 * length_m / count) / 2
    return [(float(c - half), float(c + half)) for c in centres]


def door(plane: Plane, middle_m: float, window: int) -> Mesh:
    """Door leaf in a frame that stands out of the wall, with a canopy."""
    left, right = middle_m - 0.5, middle_m + 0.5
    paint = np.full((3, 3), FRAME)
    paint[1, 1] = PANE
    leaf = plane.shifted(0.05).cells(
        [left, left + 0.1, right - 0.1, right], [0.0, 0.1, 2.0, 2.15], window, paint
    )
    canopy = _ledge(plane, (left - 0.3, right + 0.3), (2.3, 2.4), 0.8, window, FRAME)
    return Mesh.joined([_ledge(plane, (left, right), (0.0, 2.15), 0.04, window, FRAME), leaf, canopy])


def _window(plane: Plane, left: float, right: float, low: float, high: float, wall: int, window: int) -> Mesh:
    """Pane with frame and mullion 12 cm behind the wall, its reveals, and a sill that stands out."""
    bar, middle = 0.06, (left + right) / 2
    us = [left, left + bar, middle - bar / 2, middle + bar / 2, right - bar, right]
    paint = np.full((3, 5), FRAME)
    paint[1, [1, 3]] = PANE
    pane = plane.shifted(-0.12).cells(us, [low, low + bar, high - bar, high], window, paint)
    sill = _ledge(plane, (left - 0.08, right + 0.08), (low - 0.08, low - 0.005), 0.1, window, FRAME)
    return Mesh.joined([pane, sill, *_reveals(plane, left, right, low, high, 0.12, wall)])


def _reveals(
    plane: Plane, left: float, right: float, low: float, high: float, depth_m: float, wall: int
) -> list[Mesh]:
    """Return the four faces from an opening's edges back to its pane."""
    out, across, up = plane.out, plane.across, plane.up
    deep, wide, tall = [0.0, depth_m], [0.0, right - left], [0.0, high - low]
    return [
        Plane(plane.at(left, low), -out, up).cells(deep, tall, wall),
        Plane(plane.at(right, low, -depth_m), out, up).cells(deep, tall, wall),
        Plane(plane.at(left, low, -depth_m), out, across).cells(deep, wide, wall),
        Plane(plane.at(left, high, -depth_m), across, out).cells(wide, deep, wall),
    ]
