"""A driven route and the smooth line along it.

Plans are in (x, z) of {n} [m], heights along y, which points down. The route is that of the camera,
`CAMERA_HEIGHT_M` above the road.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d
from scipy.spatial import KDTree
from scipy.spatial.transform import RigidTransform

from flowlik.errors import DataError
from flowlik.support.arrays import Array

CAMERA_HEIGHT_M = 1.65
"""Height of KITTI's cameras above the road."""

STEP_M = 1.0
EXTENSION_M = 300.0
"""The road goes on this far before the route's start and beyond its end."""


@dataclass(frozen=True, eq=False)
class Route:
    """Camera positions and viewing directions of a drive, compared by their bytes.

    Parameters
    ----------
    positions_m : array (N, 3)
        Camera centres in {n} [m], in time order.
    forward : array (N, 3)
        Unit optical axes in {n}.

    Raises
    ------
    DataError
        If there is no position, or one is not finite.
    """

    positions_m: Array
    forward: Array

    def __post_init__(self) -> None:
        for name in ("positions_m", "forward"):
            values = np.array(getattr(self, name), dtype=np.float64)
            if values.ndim != 2 or values.shape[1] != 3 or len(values) == 0 or not np.isfinite(values).all():
                raise DataError(
                    f"a route needs finite {name} (N, 3) of at least one pose, not {values.shape}"
                )
            values.flags.writeable = False
            object.__setattr__(self, name, values)

    @classmethod
    def of(cls, poses: RigidTransform) -> Route:
        """Make the route of camera poses T_n_c (N,)."""
        if poses.single or len(poses) == 0:
            raise DataError("a route needs an array of at least one pose")
        return cls(poses.translation, poses.rotation.as_matrix()[:, :, 2])

    @property
    def digest(self) -> str:
        """SHA-256 of positions and directions, hexadecimal."""
        return hashlib.sha256(self.positions_m.tobytes() + self.forward.tobytes()).hexdigest()

    def __reduce__(self) -> tuple[Any, ...]:
        return Route, (self.positions_m, self.forward)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Route) and self._bytes == other._bytes

    def __hash__(self) -> int:
        return hash(self._bytes)

    @cached_property
    def _bytes(self) -> bytes:
        return self.positions_m.tobytes() + self.forward.tobytes()


@dataclass(frozen=True, eq=False)
class Line:
    """A smooth line in plan with points every metre.

    Attributes
    ----------
    points : array (K, 2)
        (x, z) [m].
    heights : array (K,)
        y of the road there [m].
    """

    points: Array
    heights: Array

    def __len__(self) -> int:
        return len(self.points)

    @cached_property
    def along(self) -> Array:
        """Unit tangents (K, 2)."""
        tangents = np.gradient(self.points, axis=0)
        return np.asarray(tangents / np.linalg.norm(tangents, axis=1, keepdims=True))

    @cached_property
    def right(self) -> Array:
        """Unit vectors (K, 2) to the right of the tangents."""
        return self.along[:, ::-1] * [1.0, -1.0]

    @cached_property
    def arc_m(self) -> Array:
        """Length of the line up to each point (K,) [m]."""
        steps = np.linalg.norm(np.diff(self.points, axis=0), axis=1)
        return np.concatenate([[0.0], np.cumsum(steps)])

    def shifted(self, right_m: float) -> Line:
        """Line beside this one, to its right [m]."""
        return Line(self.points + right_m * self.right, self.heights)

    def part(self, first: int, last: int) -> Line:
        """Line of points first to last, exclusive."""
        return Line(self.points[first:last], self.heights[first:last])

    def reversed(self) -> Line:
        """Line in the opposite direction."""
        return Line(self.points[::-1].copy(), self.heights[::-1].copy())

    def around(self, points: Array, margin_m: float) -> NDArray[np.bool_]:
        """Which points (N, 2) lie in the line's bounding box, widened by a margin [m]."""
        low, high = self._box
        return np.asarray(((points > low - margin_m) & (points < high + margin_m)).all(axis=1))

    def at(self, arc_m: Array) -> tuple[Array, Array]:
        """Points (N, 2) and unit tangents (N, 2) at some lengths along the line (N,) [m]."""
        points, along = (
            np.column_stack([np.interp(arc_m, self.arc_m, values[:, i]) for i in (0, 1)])
            for values in (self.points, self.along)
        )
        return points, along / np.linalg.norm(along, axis=1, keepdims=True)

    def nearest(self, points: Array) -> tuple[Array, Array]:
        """Distance (N,) [m] of points (N, 2), and length along the line (N,) [m] of the nearest place."""
        _, i = self._tree.query(points)
        found = [self._on_segment(points, np.clip(i + k, 0, len(self) - 2)) for k in (-1, 0)]
        (before, arc_before), (after, arc_after) = found
        return np.minimum(before, after), np.where(before < after, arc_before, arc_after)

    def _on_segment(self, points: Array, i: NDArray[np.int64]) -> tuple[Array, Array]:
        step = self.points[i + 1] - self.points[i]
        share = ((points - self.points[i]) * step).sum(axis=1) / (step**2).sum(axis=1)
        share = np.clip(share, 0, 1)
        distance = np.linalg.norm(points - self.points[i] - share[:, None] * step, axis=1)
        return distance, self.arc_m[i] + share * (self.arc_m[i + 1] - self.arc_m[i])

    @cached_property
    def _box(self) -> tuple[Array, Array]:
        return self.points.min(axis=0), self.points.max(axis=0)

    @cached_property
    def _tree(self) -> KDTree:
        return KDTree(self.points)


@dataclass(frozen=True, eq=False)
class Drive:
    """The route as a line, with extensions before its start and after its end.

    Attributes
    ----------
    line : Line
        The camera's lane.
    arc_m : array (N,)
        Length along the line [m] at which each pose of the route stands.
    """

    line: Line
    arc_m: Array


def drive_of(route: Route) -> Drive:
    """Smooth line along a route of any length; a route that stands still gives a straight road."""
    plan = route.positions_m[:, [0, 2]]
    kept = _thinned(plan, 0.5)
    steps = np.linalg.norm(np.diff(plan[kept], axis=0), axis=1)
    arc = np.concatenate([[0.0], np.cumsum(steps)])
    length = float(arc[-1])
    even = np.linspace(0.0, length, max(2, round(length / STEP_M) + 1)) if length else np.zeros(1)
    points = np.column_stack([np.interp(even, arc, plan[kept, i]) for i in (0, 1)])
    heights = np.interp(even, arc, route.positions_m[kept, 1] + CAMERA_HEIGHT_M)
    start, end = (_direction(points[:6], route.forward[0]), _direction(points[-6:], route.forward[-1]))
    beyond = np.arange(STEP_M, EXTENSION_M + STEP_M / 2, STEP_M)
    plan_line = np.concatenate(
        [points[0] - beyond[::-1, None] * start, points, points[-1] + beyond[:, None] * end]
    )
    slopes = [
        float(np.clip(np.diff(part).mean(), -0.06, 0.06)) if len(part) > 2 else 0.0
        for part in (heights[:10], heights[-10:])
    ]
    fading = 40.0 * (1 - np.exp(-beyond / 40.0))
    height_line = np.concatenate(
        [heights[0] - slopes[0] * fading[::-1], heights, heights[-1] + slopes[1] * fading]
    )
    line = Line(
        gaussian_filter1d(plan_line, 2.0, axis=0, mode="nearest"),
        gaussian_filter1d(height_line, 3.0, mode="nearest"),
    )
    of_pose = np.interp(np.arange(len(plan)), kept, arc)
    start_m = line.arc_m[len(beyond)]
    reach = line.arc_m[-len(beyond) - 1] - start_m
    return Drive(line, start_m + of_pose * (reach / length if length else 0.0))


def _thinned(points: Array, least_m: float) -> NDArray[np.int64]:
    """Numbers of points (N, 2) of which each is at least some way from the one before it."""
    kept = [0]
    for i in range(1, len(points)):
        if np.hypot(*(points[i] - points[kept[-1]])) >= least_m:
            kept.append(i)
    return np.array(kept)


def _direction(points: Array, forward: Array) -> Array:
    """Unit direction (2,) of a few points of a line, or else of the optical axis (3,)."""
    across = points[-1] - points[0]
    if np.linalg.norm(across) < 0.5:
        across = forward[[0, 2]]
    length = np.linalg.norm(across)
    if length < 1e-6:
        raise DataError("a route that stands still must not look straight up or down")
    return np.asarray(across / length)
