"""Finite planes: where they are, how far, and how a camera's rays meet them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform

from flowlik.geometry.camera import Pinhole
from flowlik.support.arrays import Array

_NEAR_M = 1e-3


@dataclass(frozen=True, eq=False)
class Rectangles:
    """R rectangles in {n}.

    Attributes
    ----------
    centres_m : array (R, 3)
        Centres.
    axes : array (R, 3, 3)
        Rows: unit normal, then the two unit edge directions.
    half_sizes_m : array (R, 2)
        Half extents along the edges.
    """

    centres_m: Array
    axes: Array
    half_sizes_m: Array

    def __len__(self) -> int:
        return len(self.centres_m)

    def joined(self, other: Rectangles) -> Rectangles:
        """Return these rectangles followed by the others."""
        return Rectangles(
            np.concatenate([self.centres_m, other.centres_m]),
            np.concatenate([self.axes, other.axes]),
            np.concatenate([self.half_sizes_m, other.half_sizes_m]),
        )


def box(low_m: Array, high_m: Array, overlap_m: float) -> Rectangles:
    """Make the six sides of an upright box, each larger by an overlap so that no ray slips between them."""
    middle, half = (low_m + high_m) / 2, (high_m - low_m) / 2
    orders = np.array([[0, 1, 2], [0, 1, 2], [1, 2, 0], [1, 2, 0], [2, 0, 1], [2, 0, 1]])
    signs = np.array([-1, 1, -1, 1, -1, 1])[:, None]
    axes = np.eye(3)[orders]
    return Rectangles(middle + signs * axes[:, 0] * half, axes, half[orders[:, 1:]] + overlap_m)


def distances_m(points_m: Array, rectangles: Rectangles) -> Array:
    """Distances (N, R) [m] from points (N, 3) to rectangles."""
    local = np.einsum("rij,nrj->nri", rectangles.axes, points_m[:, None] - rectangles.centres_m)
    beyond = np.maximum(np.abs(local[..., 1:]) - rectangles.half_sizes_m, 0)
    return np.sqrt(local[..., 0] ** 2 + (beyond**2).sum(axis=-1))


def ray_equations(rectangles: Rectangles, T_n_c: RigidTransform) -> Array:
    """Equations (R, 3, 4) that give inverse depth and rectangle coordinates of a ray (x, y, 1) in {c}.

    With normal n, the point depth * ray lies on the plane if depth * (n . ray) = n . (centre - camera);
    see `flowlik.simulation.worlds.planes._kernels.render_rectangles` for the layout.
    """
    axes_c = rectangles.axes @ T_n_c.rotation.as_matrix()
    offsets_m = np.einsum("rij,rj->ri", rectangles.axes, rectangles.centres_m - T_n_c.translation)
    equations = np.zeros((len(rectangles), 3, 4))
    # a plane through the camera is seen edge on: left at zero, no ray ever hits it
    seen = offsets_m[:, 0] != 0
    equations[seen, 0, :3] = axes_c[seen, 0] / offsets_m[seen, :1]
    equations[:, 1:, :3] = axes_c[:, 1:]
    equations[:, 1:, 3] = -offsets_m[:, 1:]
    return equations


def pixel_bounds(rectangles: Rectangles, T_n_c: RigidTransform, camera: Pinhole) -> NDArray[np.int64]:
    """First and last column, first and last row (R, 4) of the pixels that rectangles may cover."""
    signs = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    edges_m = (signs * rectangles.half_sizes_m[:, None]) @ rectangles.axes[:, 1:]
    corners = T_n_c.inv().apply((rectangles.centres_m[:, None] + edges_m).reshape(-1, 3)).reshape(-1, 4, 3)
    # where an edge passes through the plane z = near, that point stands in for the corner behind it
    ends = np.roll(corners, -1, axis=1)
    z0, z1 = corners[..., 2], ends[..., 2]
    crosses = (z0 < _NEAR_M) != (z1 < _NEAR_M)
    fraction = np.where(crosses, (_NEAR_M - z0) / np.where(crosses, z1 - z0, 1), 0)
    points = np.concatenate([corners, corners + fraction[..., None] * (ends - corners)], axis=1)
    in_front = np.concatenate([z0 >= _NEAR_M, crosses], axis=1)[..., None]
    tangents = points[..., :2] / np.where(in_front, points[..., 2:], 1)
    pixels = tangents * [camera.fx, camera.fy] + [camera.cx, camera.cy]
    size = np.array([camera.width, camera.height])
    first = np.clip(np.floor(np.where(in_front, pixels, np.inf).min(axis=1)) - 1, -1, size)
    last = np.clip(np.ceil(np.where(in_front, pixels, -np.inf).max(axis=1)) + 1, -1, size)
    return np.column_stack([first[:, 0], last[:, 0], first[:, 1], last[:, 1]]).astype(np.int64)
