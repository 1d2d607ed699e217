"""Where things may stand beside roads: placing, and keeping apart."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from flowlik.simulation.render import Instances, Prototype
from flowlik.simulation.worlds.driving._ground import Ground
from flowlik.support.arrays import Array

_CELL_M = 32.0


@dataclass(frozen=True, eq=False)
class Places:
    """Places beside a street.

    Attributes
    ----------
    points : array (N, 2)
        Plan positions [m].
    outward : array (N, 2)
        Unit directions away from the street.
    along : array (N, 2)
        Unit directions of the street.
    """

    points: Array
    outward: Array
    along: Array

    def __getitem__(self, chosen: NDArray[np.bool_] | NDArray[np.int64]) -> Places:
        return Places(self.points[chosen], self.outward[chosen], self.along[chosen])

    def __len__(self) -> int:
        return len(self.points)


@dataclass(eq=False)
class Things:
    """Copies of drawings: their numbers and transforms, in parts."""

    numbers: list[NDArray[np.int64]] = field(default_factory=list)
    transforms: list[Array] = field(default_factory=list)

    def add(self, numbers: NDArray[np.int64], transforms: Array) -> None:
        """Add copies: indices of drawings (N,) and transforms (N, 3, 4)."""
        self.numbers.append(np.asarray(numbers, np.int64))
        self.transforms.append(transforms.reshape(-1, 3, 4))

    def extend(self, other: Things) -> None:
        """Add all copies of another list."""
        self.numbers += other.numbers
        self.transforms += other.transforms

    def instances(self) -> Instances:
        """All copies as instances."""
        return Instances(
            np.concatenate([np.empty(0, np.int64), *self.numbers]),
            np.concatenate([np.empty((0, 3, 4)), *self.transforms]),
        )


def beside(
    ground: Ground, street: int, arc_m: Array, right: NDArray[np.bool_], out_m: Array | float
) -> Places:
    """Places (N,) at lengths along a street, at distances from its roadway's edge [m]."""
    foot, along = ground.roads.streets[street].at(arc_m)
    outward = along[:, ::-1] * [1.0, -1.0] * np.where(right, 1.0, -1.0)[:, None]
    reach = ground.roads.profile.half_width_m + np.broadcast_to(out_m, len(foot))
    return Places(foot + reach[:, None] * outward, outward, along)


def evenly_beside(ground: Ground, street: int, right: bool, out_m: float, step_m: float) -> Places:
    """Places every step along a line at a distance from a street's roadway [m]."""
    reach = ground.roads.profile.half_width_m + out_m
    line = ground.roads.streets[street].shifted(reach if right else -reach)
    points, along = line.at(np.arange(step_m / 2, line.arc_m[-1], step_m))
    return Places(points, along[:, ::-1] * [1.0, -1.0] * (1.0 if right else -1.0), along)


def free(
    ground: Ground, places: Places, half_m: Array | float, out_m: Array | float, slack_m: float = 0.4
) -> NDArray[np.bool_]:
    """Whether at places (N,), and half_m to either side, no other roadway comes nearer than their own."""
    reach = np.broadcast_to(half_m, len(places))[:, None] * places.along
    ends = [places.points + s * reach for s in (-1.0, 0.0, 1.0)]
    edges = np.min([ground.roads.edge(end) for end in ends], axis=0)
    return np.asarray(edges > np.broadcast_to(out_m, len(edges)) - slack_m)


def standing(points: Array, along: Array, level: Array, lift_m: float, x_axis: bool) -> Array:
    """Transforms (N, 3, 4) of things at points (N, 2) whose x or z axis follows directions (N, 3).

    Parameters
    ----------
    points : array (N, 2)
        Plan positions [m].
    along : array (N, 3)
        Unit directions in {n}.
    level : array (N,)
        Heights y [m].
    lift_m : float
        Height above the level [m].
    x_axis : bool
        Whether x or z lies along the directions.
    """
    down = np.array([0.0, 1.0, 0.0]) - along * along[:, [1]]
    down /= np.linalg.norm(down, axis=1, keepdims=True)
    other = np.cross(along, down) if x_axis else np.cross(down, along)
    axes = [along, down, other] if x_axis else [other, down, along]
    position = np.column_stack([points[:, 0], level - lift_m, points[:, 1]])
    return np.stack([*axes, position], axis=-1)


def upright(points: Array, level: Array, facing: Array, scale: Array | float = 1.0) -> Array:
    """Transforms (N, 3, 4) of upright things at points (N, 2), z along plan directions (N, 2)."""
    size = np.broadcast_to(scale, len(points))
    zero, one = np.zeros(len(points)), np.ones(len(points))
    s, c = facing.T
    rows = np.array([[c, zero, s], [zero, one, zero], [-s, zero, c]]) * size
    position = np.array([points[:, 0], level, points[:, 1]])
    return np.concatenate([rows, position[:, None]], axis=1).transpose(2, 0, 1)


def away_from(
    instances: Instances, prototypes: Sequence[Prototype], positions: Array, least_m: float
) -> Instances:
    """Those of some copies that keep a distance [m] from positions (N, 3), by their corners and leaves."""
    plan, kept = KDTree(positions[:, [0, 2]]), np.ones(len(instances), np.bool_)
    for number in np.unique(instances.prototypes):
        rows = np.flatnonzero(instances.prototypes == number)
        points = _points(prototypes[number])
        if not len(points):
            continue
        tree = KDTree(points)
        reach = float(np.linalg.norm(points[:, [0, 2]], axis=1).max())
        scales = np.linalg.norm(instances.transforms[rows, :, 0], axis=1)
        feet = instances.transforms[rows][:, [0, 2], 3]
        for row, scale, near in zip(rows, scales, plan.query_ball_point(feet, scales * reach + least_m)):
            if near:
                transform = instances.transforms[row]
                local = (positions[near] - transform[:, 3]) @ transform[:, :3] / scale**2
                kept[row] = tree.query(local)[0].min() * scale > least_m
    return Instances(instances.prototypes[kept], instances.transforms[kept])


def _points(prototype: Prototype) -> Array:
    """Corners and middles of triangles, and leaves, (K, 3) in a drawing's coordinates."""
    mesh = prototype.mesh
    parts = [mesh.vertices, mesh.vertices[mesh.triangles].mean(axis=1)]
    if prototype.foliage is not None:
        parts.append(prototype.foliage.centres)
    return np.concatenate(parts).astype(np.float64)


@dataclass(eq=False)
class Footprints:
    """Upright blocks that must not overlap: a growing list with a grid to find neighbours.

    Each is (x, z, direction of its own x axis (2), half sizes (2)).
    """

    rows: list[Array] = field(default_factory=list)
    cells: dict[tuple[int, int], list[int]] = field(default_factory=dict)

    def add(self, row: Array) -> None:
        """Add a footprint (6,)."""
        self.cells.setdefault(_cell(row[:2]), []).append(len(self.rows))
        self.rows.append(row)

    def near(self, point: Array) -> Array:
        """Footprints (K, 6) around a point (2,)."""
        column, row = _cell(point)
        around = [(column + a, row + b) for a in (-1, 0, 1) for b in (-1, 0, 1)]
        found = [self.rows[i] for cell in around for i in self.cells.get(cell, ())]
        return np.array(found).reshape(-1, 6)

    def overlaps(self, row: Array, margin_m: float = 0.0) -> bool:
        """Whether a footprint (6,), widened by a margin, overlaps one in the list."""
        others = self.near(row[:2])
        if not len(others):
            return False
        apart = np.zeros(len(others), np.bool_)
        offset = others[:, :2] - row[:2]
        mine = _axes(row[None])[0]
        theirs = _axes(others)
        for k in range(2):
            reach = row[4 + k] + margin_m + (np.abs(theirs @ mine[k]) * others[:, 4:]).sum(axis=1)
            apart |= np.abs(offset @ mine[k]) > reach
            reach = others[:, 4 + k] + margin_m + np.abs(theirs[:, k] @ mine.T) @ row[4:]
            apart |= np.abs((offset * theirs[:, k]).sum(axis=1)) > reach
        return bool((~apart).any())

    def clear(self, points: Array, margin_m: Array | float) -> NDArray[np.bool_]:
        """Whether points (N, 2) lie outside all footprints by margins (N,) [m]."""
        outside = np.ones(len(points), np.bool_)
        margins = np.broadcast_to(margin_m, len(points))
        cells = np.floor(points / _CELL_M).astype(int)
        for cell in np.unique(cells, axis=0):
            here = (cells == cell).all(axis=1)
            rows = self.near((cell + 0.5) * _CELL_M)
            if len(rows):
                offset = points[here, None] - rows[:, :2]
                along = np.abs(np.einsum("nri,rki->nrk", offset, _axes(rows)))
                beyond = along > rows[:, 4:] + margins[here, None, None]
                outside[here] = beyond.any(axis=-1).all(axis=-1)
        return outside


def _cell(point: Array) -> tuple[int, int]:
    column, row = np.floor(np.asarray(point) / _CELL_M).astype(int)
    return int(column), int(row)


def _axes(rows: Array) -> Array:
    """Unit axes (N, 2, 2) of footprints (N, 6)."""
    a, b = rows[:, 2], rows[:, 3]
    return np.stack([np.stack([a, b], axis=1), np.stack([-b, a], axis=1)], axis=1)
