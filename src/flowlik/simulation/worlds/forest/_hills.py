"""Wooded hills around the forest, as their crowns show from afar, so that no edge of the world is seen."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from scipy.spatial import cKDTree

from flowlik.simulation.render import Mesh, lattice
from flowlik.simulation.worlds.forest._terrain import CENTRE_M, Lattice, Terrain, smooth_step, waves
from flowlik.support.arrays import Array

HILLS_TO_M = 1200.0
"""Half the size of the ring."""

_COLUMNS = 16
_GROWTH = 0.022
"""Each line of the ring is larger than the one before by this share."""

_CROWN_CELLS = 1.7
"""Radius of a crown in cells of the ring, which grow outwards: farther off it stands for a grove."""


def hills(seed: int, terrain: Terrain, material: int) -> Iterator[Mesh]:
    """Pieces of a ring that begins at the border of a terrain as the edge of a wood.

    Its texture's rows run up the slope, the last of them lowest.
    """
    border = _border(terrain.outer)
    scale = _ring_scales(terrain.extent_m)
    across = scale[:, None, None] * (border[:, [0, 2]] - CENTRE_M) + CENTRE_M
    crowns = _crowns_m(seed, across, (scale - 1) * terrain.extent_m / 2)
    points = np.stack([across[..., 0], border[:, 1] - crowns, across[..., 1]], axis=-1)
    step_m = terrain.outer.cell_m
    for first in range(0, len(border) - 1, _COLUMNS):
        yield _piece(points, step_m * scale, first, material)


def _border(heights: Lattice) -> Array:
    """Points (N + 1, 3) [m] around a lattice; the last is the first again."""
    x, z = np.meshgrid(heights.x, heights.z)
    points = np.stack([x, heights.values, z], axis=-1)
    return np.concatenate([points[0, :-1], points[:-1, -1], points[-1, :0:-1], points[::-1, 0]])


def _ring_scales(extent_m: float) -> Array:
    """Sizes (R,) of the lines of the ring as multiples of the terrain's."""
    return np.exp(np.arange(0, np.log(2 * HILLS_TO_M / extent_m), _GROWTH))


def _crowns_m(seed: int, across: Array, outside_m: Array) -> Array:
    """Height (R, N) of the crowns over the border, at places (R, N, 2) so far outside it (R,) [m]."""
    x, z = across[..., 0], across[..., 1]
    far = outside_m[:, None]
    edge = 7.0 * smooth_step(far, 0.0, 7.0)
    rise = 85 * np.exp(0.3 * waves([seed, 11], x, z, (500.0, 1500.0))) * smooth_step(far, 5.0, 900.0)
    ridges = 6 * waves([seed, 12], x, z, (120.0, 400.0)) * smooth_step(far, 20.0, 300.0)
    domes = 4.0 * _domes(seed, *x.shape) * np.minimum(far / 3, 1) * (1 + far / 150) ** 0.7
    return np.asarray(edge + rise + ridges + domes)


def _domes(seed: int, rows: int, columns: int) -> Array:
    """Rounded crowns (rows, columns), about 0 to 1, side by side; the last column is the first again."""
    rng = np.random.default_rng([seed, 13])
    size = np.array([columns - 1, rows])
    middles = rng.uniform(0, size, (int(size.prod() / (1.5 * _CROWN_CELLS**2)), 2))
    # periodic around the ring, and so far apart along it that its first and last line never meet
    crowns = cKDTree(middles, boxsize=[columns - 1, 10 * rows])
    j, i = np.meshgrid(np.arange(columns) % (columns - 1), np.arange(rows))
    distance, which = crowns.query(np.column_stack([j.ravel(), i.ravel()]))
    height = rng.uniform(0.5, 1.0, len(middles))[which] * (1 - 0.5 * (distance / _CROWN_CELLS) ** 2)
    return np.asarray(np.maximum(height, 0.0).reshape(rows, columns))


def _piece(points: Array, step_m: Array, first: int, material: int) -> Mesh:
    """Columns of a ring (R, N + 1, 3) from `first` on, which lie step_m (R,) apart."""
    around = np.arange(first - 1, first + _COLUMNS + 2) % (points.shape[1] - 1)
    strip = points[:, around]
    normals = np.cross(np.gradient(strip, axis=0), np.gradient(strip, axis=1))
    normals *= np.where(normals[..., [1]] > 0, -1.0, 1.0) / np.linalg.norm(normals, axis=-1, keepdims=True)
    strip, normals = strip[:, 1:-1], normals[:, 1:-1]
    rises_m = np.linalg.norm(np.diff(strip, axis=0), axis=2)
    v = -np.concatenate([np.zeros((1, _COLUMNS + 1)), np.cumsum(rises_m, axis=0)])
    u = np.outer(step_m, np.arange(_COLUMNS + 1) - _COLUMNS / 2) + 17.3 * first
    return Mesh.of(
        strip.reshape(-1, 3),
        normals.reshape(-1, 3),
        np.column_stack([u.ravel(), v.ravel()]),
        lattice(len(points), _COLUMNS + 1),
        material,
    )
