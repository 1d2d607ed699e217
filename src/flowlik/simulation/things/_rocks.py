"""Rocks, drawn anew from a generator."""

from __future__ import annotations

import numpy as np

from flowlik.simulation.render import Mesh, Prototype, lattice
from flowlik.simulation.things._vectors import unit
from flowlik.support.arrays import Array


def rock(rng: np.random.Generator, material: int, cells: int = 8) -> Prototype:
    """Weathered rock of about 1 m, a third of it in the ground, of six sides of `cells` by `cells` faces."""
    place = np.tan(np.linspace(-np.pi / 4, np.pi / 4, cells + 1))
    a, b = np.meshgrid(place, place)
    one = np.ones_like(a)
    sides = [(a, b, one), (a, b, -one), (a, one, b), (a, -one, b), (one, a, b), (-one, a, b)]
    cube = np.stack([np.stack(side, axis=-1) for side in sides])
    directions = unit(cube)
    # cut by planes, worn by waves
    cuts = unit(rng.standard_normal((14, 3)))
    depths = rng.uniform(0.5, 0.95, 14)
    reach = np.minimum(1.0, (depths / np.maximum(directions @ cuts.T, 1e-3)).min(axis=-1))
    waves = rng.normal(0, 3.0, (8, 3)) * np.array([1, 1, 2, 2, 3, 3, 5, 5])[:, None]
    sines = np.sin(directions @ waves.T + rng.uniform(0, 2 * np.pi, 8)) / np.linalg.norm(waves, axis=1)
    reach = reach * (1 + 0.22 * sines.sum(axis=-1))
    points = directions * reach[..., None] * rng.uniform([0.42, 0.3, 0.42], [0.65, 0.5, 0.65])
    normals = _normals_about(points, directions)
    points[..., 1] -= 0.16
    # lengths along the surface from the middle of each side, so that the texture is nowhere drawn out
    uv = np.stack([_lengths(points, axis=2), _lengths(points, axis=1)], axis=-1)
    uv += 0.7 * np.arange(6)[:, None, None, None]
    faces = lattice(cells + 1, cells + 1)
    triangles = np.concatenate([faces + i * (cells + 1) ** 2 for i in range(6)])
    return Prototype(
        Mesh.of(points.reshape(-1, 3), normals.reshape(-1, 3), uv.reshape(-1, 2), triangles, material)
    )


def _normals_about(points: Array, outward: Array) -> Array:
    """Unit normals of patches of points (P, R, C, 3) that point to the outside."""
    normals = unit(np.cross(np.gradient(points, axis=1), np.gradient(points, axis=2)))
    return normals * np.where((normals * outward).sum(axis=-1, keepdims=True) < 0, -1.0, 1.0)


def _lengths(points: Array, axis: int) -> Array:
    """Lengths (P, R, C) along an axis of patches of points (P, R, C, 3), from its middle."""
    steps = np.linalg.norm(np.diff(points, axis=axis), axis=-1)
    lengths = np.insert(np.cumsum(steps, axis=axis), 0, 0.0, axis=axis)
    return np.asarray(lengths - np.take(lengths, [lengths.shape[axis] // 2], axis=axis))
