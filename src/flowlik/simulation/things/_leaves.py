"""Shapes of leaves, and leaves along twigs.

Leaf coordinates are those of `flowlik.simulation.render.LeafShape`.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from flowlik.simulation.render import Foliage, LeafShape
from flowlik.simulation.things._vectors import UP, unit
from flowlik.support.arrays import Array


def _folded(stations: ArrayLike, widths: ArrayLike, sweep: ArrayLike, fold: float, droop: float) -> LeafShape:
    """Leaf with a midrib: stations (6,) along it, half widths (6,) of which the outer two are 0.

    Edges lie `sweep` (6,) further towards the tip and are raised by `fold` times their half width; the whole
    leaf bends down by `droop` towards the tip.
    """
    s, w, forward = np.asarray(stations, float), np.asarray(widths, float), np.asarray(sweep, float)
    inner = slice(1, -1)
    rib = np.column_stack([s, 0 * s, 0 * s])
    edges = [np.column_stack([s + forward, side * w, fold * w])[inner] for side in (1, -1)]
    vertices = np.concatenate([rib, *edges])
    vertices[:, 2] -= droop * (vertices[:, 0] + 1) ** 2 / 4
    triangles = []
    for first in (6, 10):
        triangles += [(0, 1, first), (4, 5, first + 3)]
        for i in range(3):
            a, b = first + i, first + i + 1
            triangles += [(1 + i, 2 + i, b), (1 + i, b, a)]
    return _shape(vertices, triangles)


def _palmate() -> LeafShape:
    """Five pointed lobes around the end of the stem, the tips hanging."""
    angles = np.deg2rad([0, 26, 50, 78, 106, 132, 160])
    reach = np.array([1.3, 0.55, 1.15, 0.5, 0.9, 0.4, 0.3])
    angles = np.concatenate([angles, -angles[:0:-1]])
    reach = np.concatenate([reach, reach[:0:-1]])
    rim = np.column_stack([reach * np.cos(angles) - 0.3, reach * np.sin(angles) / 1.12, -0.16 * reach**2])
    vertices = np.concatenate([[[-0.3, 0.0, 0.0]], rim])
    count = len(rim)
    return _shape(vertices, [(0, 1 + i, 1 + (i + 1) % count) for i in range(count)])


def _cluster() -> LeafShape:
    """Two leaves that part from one stem, each of six points and two on its midrib."""
    one = np.array(
        [
            [0, 0, 0],
            [0.42, 0.33, 0.1],
            [0.9, 0.3, 0.04],
            [1.35, 0, -0.2],
            [0.9, -0.26, 0.04],
            [0.42, -0.3, 0.1],
        ]
    )
    rib = np.array([[0.42, 0, 0], [0.9, 0, -0.06]])
    one = np.concatenate([one, rib])
    fan = np.array([(0, 1, 6), (1, 2, 7), (1, 7, 6), (2, 3, 7), (3, 4, 7), (4, 5, 6), (4, 6, 7), (5, 0, 6)])
    parts = []
    for turn, size in ((0.45, 1.12), (-0.6, 0.95)):
        c, s = np.cos(turn), np.sin(turn)
        parts.append(one @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]]) * size - [0.6, 0, 0])
    vertices = np.concatenate(parts)
    vertices[:, 1] /= 0.75
    return _shape(vertices, [*fan, *(fan + 8)])


def _feather(tip: float, sweep: float, lift: float) -> LeafShape:
    """Slender triangles on both sides of a twig that ends at `tip`, swept forwards: needles or leaflets."""
    axis = np.linspace(-1, tip, 6)
    reach = np.array([0.8, 1.0, 1.0, 0.9, 0.7])
    droop = -0.05 * (axis + 1) ** 2
    rib = np.column_stack([axis, 0 * axis, droop])
    ahead = axis[:-1] + sweep * reach
    tips = [np.column_stack([ahead, side * reach, droop[:-1] + lift * reach]) for side in (1, -1)]
    triangles = [(i, i + 1, first + i) for first in (6, 11) for i in range(5)]
    return _shape(np.concatenate([rib, *tips]), triangles)


def _blade(bend: float) -> LeafShape:
    """Blade of grass, bent over towards its tip."""
    s = np.linspace(-1, 0.7, 6)
    w = np.array([0.7, 1.0, 1.0, 0.9, 0.7, 0.4])
    h = -bend * ((s + 1) / 2) ** 2 + 0.12
    left, right = np.column_stack([s, w, h]), np.column_stack([s, -w, h])
    vertices = np.concatenate([left, right, [[1.0, 0.0, 0.12 - bend]]])
    strips = [t for i in range(5) for t in ((i, i + 1, i + 7), (i, i + 7, i + 6))]
    return _shape(vertices, [*strips, (5, 12, 11)])


def _shape(vertices: Array, triangles: ArrayLike) -> LeafShape:
    return LeafShape(np.asarray(vertices, np.float32), np.asarray(triangles, np.int32))


_STATIONS = (-1.0, -0.68, -0.2, 0.28, 0.68, 1.0)
OVATE = _folded(_STATIONS, (0, 0.72, 1.0, 0.86, 0.48, 0), (0, -0.02, 0.03, 0.05, 0.05, 0), 0.2, 0.5)
LOBED = _folded(_STATIONS, (0, 0.62, 0.4, 1.0, 0.5, 0), (0, 0.14, 0.02, 0.26, 0.14, 0), 0.15, 0.35)
LANCEOLATE = _folded(_STATIONS, (0, 0.7, 1.0, 0.9, 0.55, 0), (0, 0, 0, 0, 0, 0), 0.1, 0.7)
PALMATE = _palmate()
CLUSTER = _cluster()
NEEDLES = _feather(tip=0.4, sweep=0.75, lift=0.15)
BLADE = _blade(bend=0.45)


def along_twigs(
    rng: np.random.Generator,
    places: Array,
    outward: Array,
    half_length_m: float,
    flatness: float,
    shape: LeafShape,
    material: int,
    level: float = 0.9,
) -> Foliage:
    """Leaves at places on twigs, in the order given.

    Parameters
    ----------
    rng : Generator
        Draws size and attitude of each leaf.
    places : array (L, 3)
        Where the stems are [m].
    outward : array (L, 3)
        Unit vectors along which the leaves grow.
    half_length_m : float
        Mean half length; single ones vary by a third.
    flatness : float
        Half width as a share of the half length.
    shape : LeafShape
        Outline.
    material : int
        Index in the scene's list.
    level : float
        How much blades turn their faces to the sky, 0 not at all.
    """
    count = len(places)
    half = half_length_m * rng.uniform(0.67, 1.33, (count, 1))
    along = unit(outward + 0.55 * rng.standard_normal((count, 3)) - 0.25 * UP)
    face = unit(level * UP + 0.6 * rng.standard_normal((count, 3)))
    across = unit(np.cross(face, along))
    face = np.cross(along, across)
    centres = places + half * along
    normals, shade = _round_normals(centres, face), _shade(centres)
    return leaves_of(centres, half * along, flatness * half * across, normals, shade, shape, material)


def leaves_of(
    centres: Array, along: Array, across: Array, normals: Array, shade: Array, shape: LeafShape, material: int
) -> Foliage:
    """Foliage of arrays (L, 3), and shade (L,), of any float type."""
    return Foliage(
        np.ascontiguousarray(centres, np.float32),
        np.ascontiguousarray(along, np.float32),
        np.ascontiguousarray(across, np.float32),
        np.ascontiguousarray(normals, np.float32),
        np.ascontiguousarray(shade, np.float32),
        shape,
        material,
    )


def _within_crown(centres: Array) -> Array:
    """Position (L, 3) in units of the crown: its middle is 0, its surface about 1 away."""
    middle = np.median(centres, axis=0)
    return (centres - middle) / np.maximum(np.quantile(np.abs(centres - middle), 0.95, axis=0), 1e-3)


def _round_normals(centres: Array, faces: Array) -> Array:
    """Mixture of where leaves face and of the crown's own outside."""
    outside = unit(_within_crown(centres))
    facing = faces * np.where((faces * outside).sum(axis=1, keepdims=True) < 0, -1.0, 1.0)
    return unit(0.6 * outside + 0.55 * facing)


def _shade(centres: Array) -> Array:
    """Share of the sky's light: small in the middle and at the bottom of the crown."""
    place = _within_crown(centres)
    depth = np.clip(np.linalg.norm(place, axis=1), 0, 1.2) / 1.2
    return np.clip(0.22 + 0.63 * depth**1.5 - 0.2 * np.clip(place[:, 1], -1, 1), 0.12, 1.0)
