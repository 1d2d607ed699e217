"""A scene laid out in arrays, as the kernels take it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from flowlik.simulation.render._materials import Layer, Material
from flowlik.simulation.render._prototypes import Floats, Foliage, LeafShape, Mesh, Prototype
from flowlik.simulation.render._textures.tiles import Tiles
from flowlik.support.arrays import Array

Ints = NDArray[np.int64]
Ints32 = NDArray[np.int32]

OUTLINE = 16
"""Most vertices and triangles of a leaf; a leaf's triangles are numbered in steps of this plus two."""


class Shapes(NamedTuple):
    """All prototypes, one after another; prototype p owns rows ``starts[p]`` to ``starts[p + 1]``."""

    vertices: Floats  # (V, 3) [m]
    normals: Floats  # (V, 3)
    uv: Floats  # (V, 2) [m]
    paint: Floats  # (V,)
    triangles: Ints32  # (F, 3), numbers within the prototype
    materials: Ints32  # (F,)
    vertex_starts: Ints  # (P + 1,)
    triangle_starts: Ints  # (P + 1,)
    leaf_centres: Floats  # (L, 3) [m]
    leaf_along: Floats  # (L, 3) [m]
    leaf_across: Floats  # (L, 3) [m]
    leaf_normals: Floats  # (L, 3)
    leaf_shade: Floats  # (L,)
    leaf_starts: Ints  # (P + 1,)
    leaf_materials: Ints  # (P,)
    outlines: Ints  # (P,) which leaf shape
    outline_vertices: Floats  # (S, OUTLINE, 3)
    outline_triangles: Ints32  # (S, OUTLINE, 3)
    outline_sizes: Ints  # (S, 2) vertices and triangles
    outline_rhombus: Floats  # (S,) scale of a rhombus of the same area
    leaf_sizes: Array  # (P,) median half length [m], 0 without leaves
    spheres: Array  # (P, 4) around all of it: centre, radius [m]
    widths: Floats  # (F,) least altitude [m], falling within a plant; infinite for other things
    points_used: Ints  # (F,) vertices that a prototype's triangles up to this one use


class Looks(NamedTuple):
    """Materials, their surfaces and the tiles on them."""

    first_surface: Ints  # (M,)
    surface_count: Ints  # (M,)
    fray_tile: Ints  # (M,), -1 for none
    fray: Array  # (M, 2) tiles a metre, amplitude
    leafy: Array  # (M, 2) translucency, variation
    reflectance: Array  # (S,)
    relief: Array  # (S,) [m]
    layer_tile: Ints  # (S, 3), -1 for none
    layers: Array  # (S, 3, 2) tiles a metre, amplitude
    pyramids: NDArray[np.uint8]  # (T, P)
    level_offsets: Ints  # (levels,)
    cloud_tile: int


class Drawn(NamedTuple):
    """The copies to be drawn, near to far."""

    prototypes: Ints  # (N,)
    transforms: Array  # (N, 3, 4) prototype to {n} [m]
    identities: Ints  # (N,) the same for the same copy in every frame
    movers: Ints  # (N,) index of the moving object, -1 for the static world
    parts: Ints  # (N,) triangles of the mesh drawn
    points: Ints  # (N,) vertices that these use
    fine: Ints  # (N,) leaves drawn in their shape
    leaves: Ints  # (N,) leaves drawn at all
    leaf_scale: Array  # (N,) of the leaves drawn as a rhombus


def pack_shapes(prototypes: Sequence[Prototype]) -> Shapes:
    """Lay prototypes out one after another."""
    ordered = [_thick_first(p) for p in prototypes]
    joined = Mesh.joined([mesh for mesh, _ in ordered])
    vertex_starts = _starts([len(p.mesh.vertices) for p in prototypes])
    triangle_starts = _starts([len(p.mesh.triangles) for p in prototypes])
    own = np.repeat(vertex_starts[:-1], np.diff(triangle_starts))
    local = joined.triangles - own[:, None].astype(np.int32)
    foliage = [p.foliage for p in prototypes if p.foliage is not None]
    shapes: list[LeafShape] = []
    for leaves in foliage:
        if not any(leaves.shape is known for known in shapes):
            shapes.append(leaves.shape)
    return Shapes(
        joined.vertices,
        joined.normals,
        joined.uv,
        joined.paint,
        np.ascontiguousarray(local),
        joined.materials,
        vertex_starts,
        triangle_starts,
        _leaves(foliage, "centres"),
        _leaves(foliage, "along"),
        _leaves(foliage, "across"),
        _leaves(foliage, "normals"),
        np.concatenate([np.empty(0, np.float32), *(leaves.shade for leaves in foliage)]),
        _starts([0 if p.foliage is None else len(p.foliage) for p in prototypes]),
        np.array([-1 if p.foliage is None else p.foliage.material for p in prototypes], np.int64),
        np.array([_which(p, shapes) for p in prototypes], np.int64),
        *_outlines(shapes),
        np.array([_leaf_size_m(p.foliage) for p in prototypes]),
        np.array([_sphere(p) for p in prototypes]),
        np.concatenate([np.empty(0, np.float32), *(widths for _, widths in ordered)]),
        np.concatenate([np.empty(0, np.int64), *(_points_used(mesh) for mesh, _ in ordered)]),
    )


def pack_looks(materials: Sequence[Material], tiles: Tiles) -> Looks:
    """Lay materials out with the numbers of the tiles that they name."""
    surfaces = [surface for material in materials for surface in material.surfaces]
    counts = np.array([len(material.surfaces) for material in materials], np.int64)
    layers = [[*surface.layers, *[None] * (3 - len(surface.layers))] for surface in surfaces]
    frays = [material.fray for material in materials]
    return Looks(
        _starts(counts)[:-1],
        counts,
        np.array([_tile(layer, tiles) for layer in frays], np.int64),
        np.array([_rate(layer) for layer in frays]),
        np.array([(material.translucency, material.variation) for material in materials]),
        np.array([surface.reflectance for surface in surfaces]),
        np.array([surface.relief_m for surface in surfaces]),
        np.array([[_tile(layer, tiles) for layer in row] for row in layers], np.int64),
        np.array([[_rate(layer) for layer in row] for row in layers]),
        tiles.pyramids,
        tiles.level_offsets,
        tiles.names.index("clouds"),
    )


def tile_names(materials: Sequence[Material]) -> tuple[str, ...]:
    """Names of the tiles that materials and the sky need, sorted."""
    layers = [layer for m in materials for surface in m.surfaces for layer in surface.layers]
    frays = [m.fray for m in materials if m.fray is not None]
    return tuple(sorted({"clouds", *(layer.texture for layer in [*layers, *frays])}))


def _starts(counts: Sequence[int] | Ints) -> Ints:
    return np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)


def _leaves(foliage: list[Foliage], name: str) -> Floats:
    return np.concatenate([np.empty((0, 3), np.float32), *(getattr(leaves, name) for leaves in foliage)])


def _which(prototype: Prototype, shapes: list[LeafShape]) -> int:
    if prototype.foliage is None:
        return -1
    return next(i for i, shape in enumerate(shapes) if shape is prototype.foliage.shape)


def _outlines(shapes: list[LeafShape]) -> tuple[Floats, Ints32, Ints, Floats]:
    vertices = np.zeros((len(shapes), OUTLINE, 3), np.float32)
    triangles = np.zeros((len(shapes), OUTLINE, 3), np.int32)
    for i, shape in enumerate(shapes):
        vertices[i, : len(shape.vertices)] = shape.vertices
        triangles[i, : len(shape.triangles)] = shape.triangles
    sizes = np.array([(len(s.vertices), len(s.triangles)) for s in shapes], np.int64).reshape(-1, 2)
    # in leaf coordinates a rhombus from -1 to 1 has area 2
    rhombus = np.array([np.sqrt(_area(shape) / 2) for shape in shapes], np.float32)
    return vertices, triangles, sizes, rhombus


def _area(shape: LeafShape) -> float:
    a, b, c = (shape.vertices[shape.triangles[:, i], :2].astype(float) for i in range(3))
    p, q = b - a, c - a
    return float(np.abs(p[:, 0] * q[:, 1] - p[:, 1] * q[:, 0]).sum() / 2)


def _thick_first(prototype: Prototype) -> tuple[Mesh, Floats]:
    """Mesh of a prototype and its triangles' widths; of a plant thick limbs first, twigs last."""
    mesh = prototype.mesh
    if prototype.foliage is None:
        return mesh, np.full(len(mesh.triangles), np.inf, np.float32)
    corners = mesh.vertices[mesh.triangles].astype(np.float64)
    edges = corners - np.roll(corners, 1, axis=1)
    longest = np.linalg.norm(edges, axis=2).max(axis=1)
    widths = np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1) / np.maximum(longest, 1e-12)
    order = np.argsort(-widths, kind="stable")
    # vertices in the order of their first use, so that the first triangles need the first vertices only
    used, first_use = np.unique(mesh.triangles[order], return_index=True)
    vertices = used[np.argsort(first_use)]
    number = np.zeros(len(mesh.vertices), np.int32)
    number[vertices] = np.arange(len(vertices))
    sorted_mesh = Mesh(
        mesh.vertices[vertices],
        mesh.normals[vertices],
        mesh.uv[vertices],
        number[mesh.triangles[order]],
        mesh.materials[order],
        mesh.paint[vertices],
    )
    return sorted_mesh, widths[order].astype(np.float32)


def _points_used(mesh: Mesh) -> Ints:
    if not len(mesh.triangles):
        return np.empty(0, np.int64)
    return np.maximum.accumulate(mesh.triangles.max(axis=1)).astype(np.int64) + 1


def _leaf_size_m(foliage: Foliage | None) -> float:
    return float(np.median(np.linalg.norm(foliage.along, axis=1))) if foliage else 0.0


def _sphere(prototype: Prototype) -> Array:
    """Centre and radius of a sphere around a mesh and its leaves [m]."""
    points = prototype.mesh.vertices
    if leaves := prototype.foliage:
        reach = np.linalg.norm(leaves.along, axis=1, keepdims=True)
        points = np.concatenate([points, leaves.centres - reach, leaves.centres + reach])
    if not len(points):
        return np.zeros(4)
    centre = (points.min(axis=0) + points.max(axis=0)) / 2.0
    # leaves drawn as rhombi are longer than their own, fewer ones longer still: these are far away
    return np.append(centre, np.linalg.norm(points - centre, axis=1).max() + 0.01)


def _tile(layer: Layer | None, tiles: Tiles) -> int:
    return -1 if layer is None else tiles.names.index(layer.texture)


def _rate(layer: Layer | None) -> tuple[float, float]:
    return (0.0, 0.0) if layer is None else (1 / layer.period_m, layer.amplitude)
