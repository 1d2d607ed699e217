"""Shapes of a world: triangle meshes, foliage, and where copies of them stand.

Axes are those of {n}: x right, y **down**, z forward, metres. A prototype stands with its foot at the origin
and grows towards negative y.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flowlik.support.arrays import Array

Floats = NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class Mesh:
    """Triangles with normals, texture coordinates and materials.

    Attributes
    ----------
    vertices : array (V, 3) float32
        Positions [m].
    normals : array (V, 3) float32
        Unit shading normals, pointing out of the solid. Triangles are seen from both sides.
    uv : array (V, 2) float32
        Texture coordinates [m] along the surface.
    triangles : array (F, 3) int32
        Vertex numbers; any winding.
    materials : array (F,) int32
        Index of each triangle's material in the scene's list.
    paint : array (V,) float32
        Which of the material's surfaces is seen: 0 the first, 1 the second, in between a mixture.
    """

    vertices: Floats
    normals: Floats
    uv: Floats
    triangles: NDArray[np.int32]
    materials: NDArray[np.int32]
    paint: Floats

    @classmethod
    def of(
        cls,
        vertices: Array | Floats,
        normals: Array | Floats,
        uv: Array | Floats,
        triangles: NDArray[np.integer],
        material: int | NDArray[np.integer],
        paint: float | Array | Floats = 0.0,
    ) -> Mesh:
        """Make a mesh of arrays of any float type; one material or paint may stand for all."""
        return cls(
            np.ascontiguousarray(vertices, np.float32),
            np.ascontiguousarray(normals, np.float32),
            np.ascontiguousarray(uv, np.float32),
            np.ascontiguousarray(triangles, np.int32),
            np.broadcast_to(np.asarray(material, np.int32), len(triangles)).copy(),
            np.broadcast_to(np.asarray(paint, np.float32), len(vertices)).copy(),
        )

    @classmethod
    def joined(cls, meshes: Sequence[Mesh]) -> Mesh:
        """Make one mesh of several; of none, an empty one."""
        if not meshes:
            none = np.empty((0, 3))
            return cls.of(none, none, np.empty((0, 2)), np.empty((0, 3), np.int32), 0)
        starts = np.cumsum([0] + [len(mesh.vertices) for mesh in meshes[:-1]])
        return cls(
            np.concatenate([mesh.vertices for mesh in meshes]),
            np.concatenate([mesh.normals for mesh in meshes]),
            np.concatenate([mesh.uv for mesh in meshes]),
            np.concatenate([mesh.triangles + np.int32(start) for mesh, start in zip(meshes, starts)]),
            np.concatenate([mesh.materials for mesh in meshes]),
            np.concatenate([mesh.paint for mesh in meshes]),
        )


@dataclass(frozen=True, eq=False)
class LeafShape:
    """The outline of one leaf as triangles, in leaf coordinates (s, t, h).

    s runs along the leaf from -1 (stem) to 1 (tip), t across it (the leaf spans -1 to 1 at its widest), h
    stands off its plane; all three in units of the leaf's half length, except t in units of its half width.

    Attributes
    ----------
    vertices : array (V, 3) float32
        At most 16.
    triangles : array (F, 3) int32
        At most 16.
    """

    vertices: Floats
    triangles: NDArray[np.int32]


@dataclass(frozen=True, eq=False)
class Foliage:
    """Leaves of one plant: copies of one shape, in random order, so that the first n stand for all of them.

    Near the camera each leaf is drawn in its shape, farther away as a rhombus of the same area, and where
    a leaf is smaller than a pixel or two only the first ones are drawn, larger in proportion.

    Attributes
    ----------
    centres : array (L, 3) float32
        [m].
    along, across : array (L, 3) float32
        Half length and half width as vectors [m], perpendicular to each other.
    normals : array (L, 3) float32
        Unit shading normals; pointing out of the crown they make it look round.
    shade : array (L,) float32
        Share of the sky's light that reaches the leaf, 0 to 1: small inside a crown.
    shape : LeafShape
        Outline of every leaf.
    material : int
        Index in the scene's list.
    """

    centres: Floats
    along: Floats
    across: Floats
    normals: Floats
    shade: Floats
    shape: LeafShape
    material: int

    def __len__(self) -> int:
        return len(self.centres)


@dataclass(frozen=True, eq=False)
class Prototype:
    """A thing that may stand in many places: a mesh, and leaves if it has any."""

    mesh: Mesh
    foliage: Foliage | None = None


@dataclass(frozen=True, eq=False)
class Instances:
    """Where copies of prototypes stand.

    Attributes
    ----------
    prototypes : array (N,) int64
        Index of each copy's prototype.
    transforms : array (N, 3, 4) float64
        Prototype to {n} [m]: a rotation times a uniform scale, and a translation.
    """

    prototypes: NDArray[np.int64]
    transforms: Array

    def __len__(self) -> int:
        return len(self.prototypes)

    @classmethod
    def of(cls, placed: Sequence[tuple[int, Array]]) -> Instances:
        """Make instances of pairs of a prototype's index and a transform (3, 4)."""
        return cls(
            np.array([prototype for prototype, _ in placed], np.int64),
            np.array([transform for _, transform in placed], np.float64).reshape(-1, 3, 4),
        )

    @classmethod
    def joined(cls, parts: Sequence[Instances]) -> Instances:
        """Make one list of several."""
        return cls(
            np.concatenate([part.prototypes for part in parts]),
            np.concatenate([part.transforms for part in parts]),
        )


def placed(position_m: Array, yaw: float = 0.0, scale: float = 1.0) -> Array:
    """Transform (3, 4) of a copy turned by yaw [rad about y] and scaled, standing at a position (3,) [m]."""
    c, s = np.cos(yaw), np.sin(yaw)
    turn = np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])
    return np.column_stack([turn * scale, position_m])
