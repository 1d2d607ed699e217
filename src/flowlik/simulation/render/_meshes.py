"""Builders of meshes: flat faces, boxes, tubes, lattices."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flowlik.simulation.render._prototypes import Mesh
from flowlik.support.arrays import Array


def quad(corners: ArrayLike, material: int, paint: float = 0.0) -> Mesh:
    """Make a flat face of four corners (4, 3) [m] in turn; seen from its front they run clockwise.

    uv is in metres from the first corner, u towards the second, v towards the fourth.
    """
    points = np.asarray(corners, np.float64)
    u_axis, v_axis = points[1] - points[0], points[3] - points[0]
    normal = np.cross(u_axis, v_axis)
    normal /= -np.linalg.norm(normal)
    u_axis = u_axis / np.linalg.norm(u_axis)
    v_axis = np.cross(u_axis, normal)
    uv = (points - points[0]) @ np.column_stack([u_axis, v_axis])
    return Mesh.of(points, np.tile(normal, (4, 1)), uv, np.array([[0, 1, 2], [0, 2, 3]]), material, paint)


def box(low: ArrayLike, high: ArrayLike, material: int) -> Mesh:
    """Make the six faces of an upright box between two corners (3,) [m]; sides' v runs upwards from 0."""
    (x0, y0, z0), (x1, y1, z1) = np.asarray(low, float), np.asarray(high, float)
    sides = [
        [(x0, y1, z0), (x1, y1, z0), (x1, y0, z0), (x0, y0, z0)],
        [(x1, y1, z0), (x1, y1, z1), (x1, y0, z1), (x1, y0, z0)],
        [(x1, y1, z1), (x0, y1, z1), (x0, y0, z1), (x1, y0, z1)],
        [(x0, y1, z1), (x0, y1, z0), (x0, y0, z0), (x0, y0, z1)],
        [(x0, y0, z0), (x1, y0, z0), (x1, y0, z1), (x0, y0, z1)],
        [(x0, y1, z1), (x1, y1, z1), (x1, y1, z0), (x0, y1, z0)],
    ]
    middle = np.array([x0 + x1, y0 + y1, z0 + z1]) / 2
    return Mesh.joined([_outward(quad(corners, material), middle) for corners in sides])


def tube(points: ArrayLike, radii: ArrayLike, sides: int, material: int) -> Mesh:
    """Make a round tube along points (N, 3) [m] with radii (N,) [m]; u runs around it, v along it."""
    centres, radius = np.asarray(points, np.float64), np.asarray(radii, np.float64)
    tangents = np.gradient(centres, axis=0)
    tangents /= np.linalg.norm(tangents, axis=1, keepdims=True)
    helper = np.eye(3)[np.argmin(np.abs(tangents).max(axis=0))]
    first = np.cross(tangents, helper)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    second = np.cross(tangents, first)
    angles = np.linspace(0, 2 * np.pi, sides + 1)
    normals = first[:, None] * np.cos(angles)[:, None] + second[:, None] * np.sin(angles)[:, None]
    vertices = centres[:, None] + radius[:, None, None] * normals
    lengths = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(centres, axis=0), axis=1))])
    u, v = np.meshgrid(angles * radius.mean(), lengths)
    return Mesh.of(
        vertices.reshape(-1, 3),
        normals.reshape(-1, 3),
        np.column_stack([u.ravel(), v.ravel()]),
        lattice(len(centres), sides + 1),
        material,
    )


def lattice(rows: int, columns: int) -> NDArray[np.int32]:
    """Triangles (F, 3) between the points of a lattice whose points are numbered row by row."""
    i, j = np.meshgrid(np.arange(rows - 1), np.arange(columns - 1), indexing="ij")
    corner = (i * columns + j).ravel()
    upper = np.column_stack([corner, corner + 1, corner + columns + 1])
    lower = np.column_stack([corner, corner + columns + 1, corner + columns])
    return np.concatenate([upper, lower]).astype(np.int32)


def _outward(face: Mesh, inside: Array) -> Mesh:
    """Flat face whose normal points away from a point."""
    away = face.vertices.mean(axis=0) - inside
    return (
        face
        if face.normals[0] @ away > 0
        else Mesh(face.vertices, -face.normals, face.uv, face.triangles, face.materials, face.paint)
    )
