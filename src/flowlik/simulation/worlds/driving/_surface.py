"""Triangles of the ground of one square: roadway, kerbs, strips, pavements, open land, painted lines.

Cells that a border crosses are divided and their triangles cut along it, so that borders are sharp, and meet
between squares, whatever the streets' directions.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from flowlik.simulation.render import Mesh
from flowlik.simulation.worlds.driving._ground import CELL_M, CELLS, SQUARE_M, Ground, Square
from flowlik.simulation.worlds.driving._profiles import Marking
from flowlik.support.arrays import Array

BLOCK_M = 12.0
"""Length of the blocks into which the strips between roadway and pavement are divided."""

PAVED, GREEN = 0.0, 1.0
"""Paint of the strips: cars park on paved blocks, trees stand on green ones."""

_MARKING_HEIGHT_M = 0.006
_GREEN_SHARE = 0.5


@dataclass(frozen=True, eq=False)
class GroundSurface:
    """What the ground along roads is made of.

    Attributes
    ----------
    ground : Ground
        Roads and heights.
    materials : mapping of str to int
        Index of each ground material.
    seed : int
        Draws strips and painted lines.
    """

    ground: Ground
    materials: Mapping[str, int]
    seed: int

    @cached_property
    def blocks(self) -> tuple[Array, ...]:
        """Paint of the strips' blocks (B, 2) of each street; the columns are its left and right side."""
        kinds = []
        for i, street in enumerate(self.ground.roads.streets):
            rng = np.random.default_rng([self.seed, 21, i])
            count = int(street.arc_m[-1] // BLOCK_M) + 1
            kinds.append(np.where(rng.random((count, 2)) < _GREEN_SHARE, GREEN, PAVED))
        return tuple(kinds)

    def strip_paint(self, points: Array) -> Array:
        """Paint (N,) of the strips at points (N, 2)."""
        number, arc, right = self.ground.roads.nearest_street(points)
        starts = np.cumsum([0, *(len(kinds) for kinds in self.blocks)])
        rows = np.concatenate(self.blocks)
        return np.asarray(rows[starts[number] + (arc // BLOCK_M).astype(int), right.astype(int)])

    def square(self, square: Square, fine: bool) -> Mesh:
        """Ground of a square in coordinates from its corner; x, z within 0 to `SQUARE_M`.

        fine divides the cells at borders into 4 by 4, and adds painted lines.
        """
        corner = np.array(square) * SQUARE_M
        edge = _Edges(self, corner)
        bands = np.array(self.ground.roads.profile.levels_m)
        steps = np.arange(CELLS) * CELL_M
        low_x, low_z = (values.ravel() for values in np.meshgrid(steps, steps))
        middle = edge(np.column_stack([low_x, low_z]) + CELL_M / 2)
        # the edge's distance changes by at most a metre a metre
        crossed = (np.abs(middle[:, None] - bands) <= CELL_M / np.sqrt(2) + 0.1).any(axis=1)
        low = np.column_stack([low_x, low_z])
        plain = _cell_triangles(low[~crossed], CELL_M, 1)
        pieces = [(plain, np.repeat(np.searchsorted(bands, middle[~crossed]), 2))]
        kerbs = np.empty((0, 2, 3))
        if crossed.any():
            divided = _cell_triangles(low[crossed], CELL_M, 4 if fine else 1)
            triangles = np.concatenate(
                [divided, _of_distinct(edge, divided.reshape(-1, 2)).reshape(-1, 3, 1)], axis=-1
            )
            for band, level in enumerate(bands):
                below, triangles, border = cut(triangles, level)
                pieces.append((below[..., :2], np.full(len(below), band)))
                kerbs = border if band == 0 else kerbs
            pieces.append((triangles[..., :2], np.full(len(triangles), len(bands))))
        plan = np.concatenate([triangles for triangles, _ in pieces])
        band_of = np.concatenate([numbers for _, numbers in pieces])
        parts = [self._land(square, plan, band_of)]
        if self.ground.roads.profile.kerb_m > 0 and len(kerbs):
            parts.append(self._kerb_faces(square, kerbs))
        if fine:
            parts.append(self._lines(square))
        return Mesh.joined(parts)

    def _land(self, square: Square, plan: Array, band_of: NDArray[np.int64]) -> Mesh:
        """Triangles (F, 3, 2) laid on the ground, each of the material of its band."""
        profile, corner = self.ground.roads.profile, np.array(square) * SQUARE_M
        points = plan.reshape(-1, 2)
        heights, normals = self._heights(square, plan)
        raised = np.repeat(np.where(band_of > 0, profile.kerb_m, 0.0), 3)
        numbers = np.array([self.materials[name] for _, name in profile.bands])[band_of]
        paint = np.zeros(len(points))
        for name, painted in (("strip", self.strip_paint), ("ground", self._ground_paint)):
            if name in self.materials:
                chosen = np.repeat(numbers == self.materials[name], 3)
                paint[chosen] = _of_distinct(painted, points[chosen] + corner) if chosen.any() else 0.0
        return Mesh.of(
            np.column_stack([points[:, 0], heights - raised, points[:, 1]]),
            normals,
            points + corner,
            np.arange(len(points)).reshape(-1, 3),
            numbers,
            paint,
        )

    def _ground_paint(self, points: Array) -> Array:
        """Paint (N,) of open land: tended near the road, wild farther away."""
        away = np.clip((self.ground.roads.edge(points) - 6.0) / 30.0, 0, 1)
        return np.clip(0.25 + 0.5 * away + 0.35 * self.ground.waves(points)[0], 0, 1)

    def _kerb_faces(self, square: Square, borders: Array) -> Mesh:
        """Upright faces between roadway and kerb along borders (N, 2, 3)."""
        plan = borders[..., :2]
        heights, _ = self._heights(square, plan)
        heights = heights.reshape(-1, 2)
        low = np.stack([plan[..., 0], heights, plan[..., 1]], axis=-1)
        high = low - [0.0, self.ground.roads.profile.kerb_m, 0.0]
        along = low[:, 1] - low[:, 0]
        length = np.linalg.norm(along, axis=1)
        keep = length > 1e-6
        low, high, along, length = low[keep], high[keep], along[keep], length[keep]
        # the roadway lies to the right of the border as `cut` returns it
        normals = np.column_stack([along[:, 2], np.zeros(len(along)), -along[:, 0]])
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        vertices = np.stack([low[:, 0], low[:, 1], high[:, 1], high[:, 0]], axis=1).reshape(-1, 3)
        u = np.column_stack([0 * length, length, length, 0 * length]) + plan[keep][:, :1, 0]
        v = np.tile([0.0, 0.0, 0.1, 0.1], (len(length), 1))
        first = 4 * np.arange(len(length))[:, None]
        triangles = np.concatenate([first + np.array([0, 1, 2]), first + np.array([0, 2, 3])])
        uv = np.column_stack([u.ravel(), v.ravel()])
        return Mesh.of(vertices, normals.repeat(4, axis=0), uv, triangles, self.materials["kerb"])

    def _heights(self, square: Square, plan: Array) -> tuple[Array, Array]:
        """Heights (N,) and normals (N, 3) of the level at points (..., 2) from a square's corner.

        Points of one face (first axis) are all looked up in the cell around the face's middle.
        """
        heights, normals = self.ground.nodes(square)
        cell = (
            np.clip(plan.mean(axis=1) // CELL_M, 0, CELLS - 1).astype(int)[:, None].repeat(plan.shape[1], 1)
        )
        i, j = cell[..., 1].ravel(), cell[..., 0].ravel()
        share = (plan.reshape(-1, 2) - cell.reshape(-1, 2) * CELL_M) / CELL_M
        a, b = share.T
        weights = [(1 - a) * (1 - b), a * (1 - b), (1 - a) * b, a * b]
        corners = [(i, j), (i, j + 1), (i + 1, j), (i + 1, j + 1)]
        y = sum(w * heights[c] for w, c in zip(weights, corners))
        n = np.sum([w[:, None] * normals[c] for w, c in zip(weights, corners)], axis=0)
        return np.asarray(y), n / np.linalg.norm(n, axis=1, keepdims=True)

    def _lines(self, square: Square) -> Mesh:
        """Painted lines and covers of a square, just above the roadway; none where streets meet."""
        parts = []
        corner = np.array(square) * SQUARE_M
        for i, street in enumerate(self.ground.roads.streets):
            near = ((street.points > corner - 10) & (street.points < corner + SQUARE_M + 10)).all(axis=1)
            if not near.any():
                continue
            arc = street.arc_m[near]
            for marking in self.ground.roads.profile.markings:
                starts = np.arange(np.floor(arc.min()), arc.max(), 0.5)
                parts.append(self._dashes(square, i, marking, starts))
        return Mesh.joined(parts)

    def _dashes(self, square: Square, street: int, marking: Marking, starts: Array) -> Mesh:
        """Pieces of half a metre of a painted line whose middles lie in the square."""
        line, corner = self.ground.roads.streets[street], np.array(square) * SQUARE_M
        starts = starts[starts % marking.period_m < marking.dash_m - 0.25]
        ends = np.stack([starts, starts + 0.5], axis=1)
        foot, along = line.at(ends.ravel())
        right = along[:, ::-1] * [1.0, -1.0]
        half = marking.width_m / 2
        sides = [foot + (marking.lateral_m + s * half) * right - corner for s in (-1.0, 1.0)]
        left, right_side = (side.reshape(-1, 2, 2) for side in sides)
        plan = np.stack([left[:, 0], left[:, 1], right_side[:, 1], right_side[:, 0]], axis=1)
        middle = plan.mean(axis=1)
        inside = ((middle >= 0) & (middle < SQUARE_M)).all(axis=1)
        inside &= self.ground.roads.other_edge(middle + corner, street) > 1.0
        plan = plan[inside]
        if not len(plan):
            return Mesh.joined([])
        points = plan.reshape(-1, 2)
        y = self.ground.level(points + corner) - _MARKING_HEIGHT_M
        first = 4 * np.arange(len(plan))[:, None]
        return Mesh.of(
            np.column_stack([points[:, 0], y, points[:, 1]]),
            np.tile([0.0, -1.0, 0.0], (len(points), 1)),
            points + corner,
            np.concatenate([first + np.array([0, 1, 2]), first + np.array([0, 2, 3])]),
            self.materials["marking"],
        )


@dataclass(frozen=True, eq=False)
class _Edges:
    """Distance from the roadway's edge at points (N, 2) counted from a square's corner."""

    surface: GroundSurface
    corner: Array

    def __call__(self, points: Array) -> Array:
        return self.surface.ground.roads.edge(points + self.corner)


def _of_distinct(values: Callable[[Array], Array], points: Array) -> Array:
    """Values (N,) at points (N, 2) of which many are the same: corners that triangles share."""
    # as complex numbers, which sort faster than rows
    distinct, which = np.unique(points[:, 0] + 1j * points[:, 1], return_inverse=True)
    return values(np.column_stack([distinct.real, distinct.imag]))[which]


def cut(triangles: Array, level: float) -> tuple[Array, Array, Array]:
    """Cut triangles along a level line of their third coordinate.

    Parameters
    ----------
    triangles : array (F, 3, 3)
        Corners (x, z, value), all of the same winding.
    level : float
        Value along the cut.

    Returns
    -------
    below, above : arrays (G, 3, 3)
        Triangles on either side, of the same winding.
    border : array (N, 2, 3)
        Ends of the cut through each triangle; below lies on the same side of all.
    """
    over = triangles[..., 2] > level
    count = over.sum(axis=1)
    mixed = (count == 1) | (count == 2)
    below, above = [triangles[count == 0]], [triangles[count == 3]]
    chosen, lone_over = triangles[mixed], count[mixed] == 1
    # turn each so that the corner that is alone on its side comes first
    alone = np.argmax(over[mixed] == lone_over[:, None], axis=1)
    order = (alone[:, None] + np.arange(3)) % 3
    a, b, c = np.moveaxis(np.take_along_axis(chosen, order[..., None], axis=1), 1, 0)
    p = a + (b - a) * ((level - a[:, 2]) / (b[:, 2] - a[:, 2]))[:, None]
    q = a + (c - a) * ((level - a[:, 2]) / (c[:, 2] - a[:, 2]))[:, None]
    tips = np.stack([a, p, q], axis=1)
    rests = np.concatenate([np.stack([p, b, c], axis=1), np.stack([p, c, q], axis=1)])
    above += [tips[lone_over], rests[np.tile(~lone_over, 2)]]
    below += [tips[~lone_over], rests[np.tile(lone_over, 2)]]
    border = np.where(lone_over[:, None, None], np.stack([p, q], axis=1), np.stack([q, p], axis=1))
    return np.concatenate(below), np.concatenate(above), border


def _cell_triangles(low: Array, size_m: float, parts: int) -> Array:
    """Triangles (F, 3, 2) of cells with low corners (N, 2), each divided into parts by parts squares."""
    step = size_m / parts
    i, j = (values.ravel() * step for values in np.meshgrid(np.arange(parts), np.arange(parts)))
    corner = (low[:, None] + np.column_stack([i, j])).reshape(-1, 1, 2)
    upper = corner + step * np.array([(0, 0), (1, 0), (1, 1)])
    lower = corner + step * np.array([(0, 0), (1, 1), (0, 1)])
    return np.stack([upper, lower], axis=1).reshape(-1, 3, 2)
