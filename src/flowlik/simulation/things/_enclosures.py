"""What stands between gardens and pavements: walls, fences, railings, hedges."""

from __future__ import annotations

import numpy as np

from flowlik.simulation.render import Foliage, LeafShape, Mesh, Prototype, box, quad
from flowlik.simulation.things._walls import UNDERGROUND_M, sides

OVAL = LeafShape(
    np.array([(-1, 0, 0), (-0.1, -0.9, 0.12), (1, 0, 0), (-0.1, 0.9, 0.12), (0.1, 0, -0.05)], np.float32),
    np.array([(0, 1, 4), (1, 2, 4), (2, 3, 4), (3, 0, 4)], np.int32),
)
"""A pointed oval leaf, a little folded, of only four triangles."""


def garden_wall(length_m: float, height_m: float, wall: int, coping: int) -> Mesh:
    """Make a masonry wall along x, 24 cm thick, with a coping."""
    x = length_m / 2
    lengths = [length_m, 0.24] * 2
    body = [
        plane.cells([0.0, length], [-UNDERGROUND_M, height_m], wall)
        for plane, length in zip(sides(length_m, 0.24), lengths)
    ]
    return Mesh.joined([*body, box((-x, -height_m - 0.07, -0.16), (x, -height_m, 0.16), coping)])


def fence(length_m: float, height_m: float, boards: int, posts: int) -> Mesh:
    """Make a fence along x: boards 4 cm thick, 8 cm above the ground, between posts 2 m apart."""
    x = length_m / 2
    parts = [box((-x, -height_m, -0.02), (x, -0.08, 0.02), boards)]
    for place in np.linspace(-x + 0.05, x - 0.05, max(2, round(length_m / 2) + 1)):
        parts.append(box((place - 0.05, -height_m - 0.06, -0.05), (place + 0.05, UNDERGROUND_M, 0.05), posts))
    return Mesh.joined(parts)


def railing(length_m: float, height_m: float, metal: int) -> Mesh:
    """Make a see-through railing along x: two rails and bars 14 cm apart."""
    x = length_m / 2
    rails = [box((-x, -top, -0.02), (x, 0.05 - top, 0.02), metal) for top in (height_m, 0.18)]
    bars = [
        quad([(u, -height_m, 0), (u + 0.025, -height_m, 0), (u + 0.025, 0.3, 0), (u, 0.3, 0)], metal)
        for u in np.arange(-x, x, 0.14)
    ]
    return Mesh.joined([*rails, *bars])


def hedge(rng: np.random.Generator, core: int, leaf: int, length_m: float, height_m: float) -> Prototype:
    """Make a clipped hedge along x, 0.7 m thick: a dark core under leaves of 6 to 11 cm."""
    size = np.array([length_m, height_m, 0.7])
    low, high = np.array([-0.5, -1.0, -0.5]) * size, np.array([0.5, 0.0, 0.5]) * size
    mesh = box(low + 0.05, high + np.array([-0.05, UNDERGROUND_M, -0.05]), core)
    count = int(240 * length_m * (2 * height_m + 0.7))
    # leaves lie on front, back, top and both ends, in proportion to their areas
    areas = np.array([length_m * height_m] * 2 + [length_m * 0.7] + [height_m * 0.7] * 2)
    side = rng.choice(5, count, p=areas / areas.sum())
    outward = np.array([(0, 0, -1), (0, 0, 1), (0, -1, 0), (-1, 0, 0), (1, 0, 0)], float)[side]
    centres = low + rng.random((count, 3)) * size
    on_side = np.where(outward > 0, high, low)
    centres = np.where(outward != 0, on_side - outward * rng.normal(0.02, 0.03, (count, 1)), centres)
    normals = outward + rng.normal(0, 0.55, (count, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    along = np.cross(normals, rng.normal(0, 1, (count, 3)))
    along *= rng.uniform(0.03, 0.055, (count, 1)) / np.linalg.norm(along, axis=1, keepdims=True)
    depth_m = ((on_side - centres) * outward).sum(axis=1)
    foliage = Foliage(
        centres=centres.astype(np.float32),
        along=along.astype(np.float32),
        across=(0.5 * np.cross(normals, along)).astype(np.float32),
        normals=normals.astype(np.float32),
        shade=np.clip(0.8 - 6 * depth_m, 0.2, 1).astype(np.float32),
        shape=OVAL,
        material=leaf,
    )
    return Prototype(mesh, foliage)
