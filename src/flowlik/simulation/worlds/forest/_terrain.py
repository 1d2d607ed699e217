"""Ground of the forest: level along the paths, rolling beyond.

Heights are y in {n}, which points down: a hill is negative.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from flowlik.errors import DataError
from flowlik.simulation.render import Mesh, lattice
from flowlik.simulation.worlds.paths import figure_eight, keep_free
from flowlik.support.arrays import Array

CENTRE_M = np.array([0.0, 50.0])
"""Middle (x, z) of the world."""

PATCH_M = 16.0
INNER_M = np.array([96.0, 160.0])
"""Size (x, z) of the area around the paths whose mesh is fine."""

COARSE_CELL_M = 2.0
GROUND_M = 2.0
TRACK_HALF_WIDTH_M = 1.4


@dataclass(frozen=True, eq=False)
class Lattice:
    """Values at the points of a lattice, linear on the two triangles of each cell.

    Attributes
    ----------
    low : array (2,)
        First x and z [m].
    cell_m : float
        Distance of its points.
    values : array (Z, X)
        One row for each z.
    """

    low: Array
    cell_m: float
    values: Array

    @property
    def x(self) -> Array:
        """Coordinates (X,) of the columns [m]."""
        return np.asarray(self.low[0] + self.cell_m * np.arange(self.values.shape[1]))

    @property
    def z(self) -> Array:
        """Coordinates (Z,) of the rows [m]."""
        return np.asarray(self.low[1] + self.cell_m * np.arange(self.values.shape[0]))

    def contains(self, x: Array, z: Array) -> NDArray[np.bool_]:
        """Whether points lie within."""
        return (x >= self.x[0]) & (x <= self.x[-1]) & (z >= self.z[0]) & (z <= self.z[-1])

    def at(self, x: Array, z: Array) -> Array:
        """Values at points (x, z) [m], clamped to the border outside."""
        rows, columns = self.values.shape
        column = np.clip((x - self.low[0]) / self.cell_m, 0, columns - 1)
        row = np.clip((z - self.low[1]) / self.cell_m, 0, rows - 1)
        j, i = np.minimum(column.astype(int), columns - 2), np.minimum(row.astype(int), rows - 2)
        s, t = column - j, row - i
        a, d = self.values[i, j], self.values[i + 1, j + 1]
        corner = np.where(s >= t, self.values[i, j + 1], self.values[i + 1, j])
        first, second = np.maximum(s, t), np.minimum(s, t)
        return np.asarray(a + first * (corner - a) + second * (d - corner))


@dataclass(frozen=True, eq=False)
class Terrain:
    """Heights and what grows on them.

    Attributes
    ----------
    extent_m : float
        Side of the square that is the world.
    inner, outer : Lattice
        Height y of the ground [m] around the paths, and in the whole square.
    inner_paint, outer_paint : Lattice
        0 litter, 1 grass, 2 trodden earth, at the same points.
    free_m : Lattice
        Distance (x, z) of the inner points to the nearest centre line [m].
    """

    extent_m: float
    inner: Lattice
    outer: Lattice
    inner_paint: Lattice
    outer_paint: Lattice
    free_m: Lattice

    @classmethod
    def of(cls, seed: int, extent_m: float = 256.0, cell_m: float = 0.5) -> Terrain:
        """Draw a terrain.

        Parameters
        ----------
        seed : int
            Draws everything.
        extent_m : float
            Side of the world, a multiple of 32 m, at least 192 m.
        cell_m : float
            Distance of the inner mesh's points: a whole fraction of 2 m.

        Raises
        ------
        DataError
            If the sizes do not fit.
        """
        check_sizes(extent_m, cell_m)
        lines = cKDTree(keep_free()[:, [0, 2]])
        inner_low, outer_low = CENTRE_M - INNER_M / 2, CENTRE_M - extent_m / 2
        outer_points = _points(outer_low, COARSE_CELL_M, np.array([extent_m, extent_m]))
        inner_points = _points(inner_low, cell_m, INNER_M)
        free_inner, free_outer = (_distance_m(lines, *points) for points in (inner_points, outer_points))
        outer = Lattice(outer_low, COARSE_CELL_M, _height_m(seed, *outer_points, free_outer))
        inner = Lattice(inner_low, cell_m, _height_m(seed, *inner_points, free_inner))
        return cls(
            extent_m,
            Lattice(inner_low, cell_m, _meeting(inner, outer)),
            outer,
            Lattice(inner_low, cell_m, _paint(seed, *inner_points)),
            Lattice(outer_low, COARSE_CELL_M, _paint(seed, *outer_points)),
            Lattice(inner_low, cell_m, free_inner),
        )

    def ground_m(self, x: Array, z: Array) -> Array:
        """Height y of the ground's mesh [m, down] at points (x, z)."""
        return np.where(self.inner.contains(x, z), self.inner.at(x, z), self.outer.at(x, z))

    def paint_at(self, x: Array, z: Array) -> Array:
        """Paint at points (x, z)."""
        return np.where(self.inner.contains(x, z), self.inner_paint.at(x, z), self.outer_paint.at(x, z))

    def path_distance_m(self, x: Array, z: Array) -> Array:
        """Distance [m] of points to the nearest centre line, seen from above; too short beyond 30 m."""
        return self.free_m.at(x, z)

    def patches(self, material: int) -> Iterator[Mesh]:
        """Pieces of the ground's mesh, small enough to be left out one by one."""
        fine = (_slopes(self.inner), self.inner, self.inner_paint.values)
        coarse = (_slopes(self.outer), self.outer, self.outer_paint.values)
        for x in np.arange(*self._span(0), PATCH_M):
            for z in np.arange(*self._span(1), PATCH_M):
                within = (np.abs(np.array([x, z]) + PATCH_M / 2 - CENTRE_M) < INNER_M / 2).all()
                yield _patch(*(fine if within else coarse), np.array([x, z]), material)

    def _span(self, axis: int) -> tuple[float, float]:
        return CENTRE_M[axis] - self.extent_m / 2, CENTRE_M[axis] + self.extent_m / 2


def check_sizes(extent_m: float, cell_m: float) -> None:
    """Raise a DataError if no terrain of these sizes can be made."""
    if (
        extent_m % (2 * PATCH_M)
        or extent_m < 192
        or not 0 < cell_m <= COARSE_CELL_M
        or COARSE_CELL_M % cell_m
    ):
        raise DataError(
            f"impossible terrain of {extent_m} m in cells of {cell_m} m: the side must be a multiple "
            "of 32 m, at least 192 m, the cells a whole fraction of 2 m"
        )


def _points(low: Array, cell_m: float, size: Array) -> tuple[Array, Array]:
    counts = np.rint(size / cell_m).astype(int) + 1
    x, z = np.meshgrid(low[0] + cell_m * np.arange(counts[0]), low[1] + cell_m * np.arange(counts[1]))
    return x, z


def _distance_m(lines: cKDTree, x: Array, z: Array) -> Array:
    return np.asarray(lines.query(np.column_stack([x.ravel(), z.ravel()]))[0]).reshape(x.shape)


def waves(seed: list[int], x: Array, z: Array, wavelengths_m: tuple[float, float], count: int = 20) -> Array:
    """Smooth random function of (x, z) [m], about 1 in size and never above 3: a sum of sines."""
    rng = np.random.default_rng(seed)
    lengths = np.exp(rng.uniform(np.log(wavelengths_m[0]), np.log(wavelengths_m[1]), count))
    headings, phases = rng.uniform(0, 2 * np.pi, (2, count))
    weights = lengths / np.sqrt((lengths**2).sum() / 2)
    total = np.zeros(np.shape(x))
    for length, heading, phase, weight in zip(lengths, headings, phases, weights):
        total += weight * np.sin(2 * np.pi / length * (x * np.cos(heading) + z * np.sin(heading)) + phase)
    return 3 * np.tanh(total / 3)


def smooth_step(value: Array, low: float, high: float) -> Array:
    """0 up to `low`, 1 from `high` on, smooth in between."""
    share = np.clip((value - low) / (high - low), 0, 1)
    return np.asarray(share * share * (3 - 2 * share))


def _height_m(seed: int, x: Array, z: Array, free_m: Array) -> Array:
    """Height y [m, down] of points whose distance to the centre lines is known."""
    near = 0.08 * waves([seed, 1], x, z, (9.0, 30.0)) + 0.012 * waves([seed, 2], x, z, (1.2, 4.0))
    away = smooth_step(free_m, 3.0, 24.0)
    rough = 1.5 * waves([seed, 3], x, z, (22.0, 90.0)) + 0.3 * waves([seed, 4], x, z, (4.0, 14.0))
    # on the whole the ground rises with the distance, so that the forest closes the view
    return GROUND_M + near + away * (rough - 0.02 * np.minimum(free_m, 100.0))


def _paint(seed: int, x: Array, z: Array) -> Array:
    """0 litter, 1 grass, 2 the track, which meanders about the figure eight."""
    grass = np.clip(0.45 + 0.75 * waves([seed, 5], x, z, (7.0, 40.0)), 0, 1)
    eight = cKDTree(figure_eight(np.arange(0, 400, 0.25))[0][:, [0, 2]])
    aside = [0.45 * waves([seed, 6 + axis], x, z, (6.0, 25.0)) for axis in range(2)]
    track = 1 - smooth_step(
        _distance_m(eight, x + aside[0], z + aside[1]), TRACK_HALF_WIDTH_M - 0.5, TRACK_HALF_WIDTH_M + 0.6
    )
    return np.asarray(grass * (1 - track) + 2 * track)


def _meeting(inner: Lattice, outer: Lattice) -> Array:
    """Inner heights whose border lies on the edges of the outer mesh, so that no gap opens."""
    x, z = np.meshgrid(inner.x, inner.z)
    heights = inner.values.copy()
    rim = np.ones(heights.shape, bool)
    rim[1:-1, 1:-1] = False
    heights[rim] = outer.at(x[rim], z[rim])
    return heights


def _slopes(heights: Lattice) -> Array:
    """Unit normals (Z, X, 3), upwards."""
    along_z, along_x = np.gradient(heights.values, heights.cell_m)
    normals = np.stack([along_x, -np.ones_like(along_x), along_z], axis=-1)
    return np.asarray(normals / np.linalg.norm(normals, axis=-1, keepdims=True))


def _patch(normals: Array, heights: Lattice, paint: Array, low: Array, material: int) -> Mesh:
    size = round(PATCH_M / heights.cell_m)
    column, row = np.rint((low - heights.low) / heights.cell_m).astype(int)
    part = np.s_[row : row + size + 1, column : column + size + 1]
    x, z = np.meshgrid(heights.x[part[1]], heights.z[part[0]])
    return Mesh.of(
        np.stack([x, heights.values[part], z], axis=-1).reshape(-1, 3),
        normals[part].reshape(-1, 3),
        np.column_stack([x.ravel(), z.ravel()]),
        lattice(size + 1, size + 1),
        material,
        paint[part].ravel(),
    )
