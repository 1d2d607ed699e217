"""Wood: branches that grow out of branches, and their bark."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from flowlik.simulation.render import Mesh, lattice
from flowlik.simulation.things._vectors import UP, unit
from flowlik.support.arrays import Array

_GOLDEN_ANGLE = np.pi * (3 - np.sqrt(5))


@dataclass(frozen=True, eq=False)
class Branches:
    """Branches of one order.

    Attributes
    ----------
    points : array (B, N, 3)
        Points along their axes [m].
    radii : array (B, N)
        [m].
    """

    points: Array
    radii: Array

    def __len__(self) -> int:
        return len(self.points)

    @property
    def lengths(self) -> Array:
        """Lengths (B,) [m]."""
        return np.linalg.norm(np.diff(self.points, axis=1), axis=2).sum(axis=1)

    def every(self, step: int) -> Branches:
        """One of every `step` branches."""
        return Branches(self.points[::step], self.radii[::step])

    def coarser(self, step: int) -> Branches:
        """Branches with one of every `step` points, and the last."""
        kept = np.unique(np.append(np.arange(0, self.points.shape[1], step), self.points.shape[1] - 1))
        return Branches(self.points[:, kept], self.radii[:, kept])

    def at(self, share: Array) -> tuple[Array, Array, Array]:
        """Points (B, K, 3), unit tangents (B, K, 3) and radii (B, K) at shares (B, K) of the way along."""
        last = self.points.shape[1] - 1
        first = np.minimum((share * last).astype(int), last - 1)
        rest = share * last - first
        row = np.arange(len(self))[:, None]
        a, b = self.points[row, first], self.points[row, first + 1]
        radius = self.radii[row, first] * (1 - rest) + self.radii[row, first + 1] * rest
        return a + (b - a) * rest[..., None], unit(b - a), radius


def grow(
    rng: np.random.Generator,
    starts: Array,
    directions: Array,
    lengths: Array,
    radii: Array,
    points: int,
    lift: float,
    wander: float,
) -> Branches:
    """Branches from starts (B, 3) that bend up by `lift` and waver by `wander` at each point."""
    path, heading = [starts], unit(directions)
    for _ in range(points - 1):
        path.append(path[-1] + (lengths / (points - 1))[:, None] * heading)
        heading = unit(heading + lift * UP + wander * rng.standard_normal(heading.shape))
    taper = np.linspace(1, 0.25, points)
    return Branches(np.stack(path, axis=1), np.maximum(radii[:, None] * taper, 0.003))


@dataclass(frozen=True)
class Habit:
    """How branches grow out of others; pairs hold from the lowest to the highest of them.

    Parameters
    ----------
    count : int
        Branches out of every parent.
    share : tuple of two float
        Part of the parent along which they stand, at even distances but for chance.
    angle : tuple of two float
        Angle with the parent [rad].
    length : tuple of two float
        Length as a share of the parent's.
    points : int
        Points along each.
    lift, wander : float
        How much they bend upwards and waver at each point.
    thickness : float
        Radius as a share of the parent's there.
    """

    count: int
    share: tuple[float, float]
    angle: tuple[float, float]
    length: tuple[float, float]
    points: int
    lift: float = 0.0
    wander: float = 0.0
    thickness: float = 0.6


def side_branches(rng: np.random.Generator, parents: Branches, habit: Habit) -> Branches:
    """Branches out of every parent, turning around it."""
    shape = (len(parents), habit.count)
    place = (np.arange(habit.count) + rng.uniform(0.1, 0.9, shape)) / habit.count
    start, tangent, radius = parents.at(_between(habit.share, place))
    azimuth = np.arange(habit.count) * _GOLDEN_ANGLE + rng.uniform(0, 2 * np.pi, (shape[0], 1))
    azimuth = azimuth + rng.normal(0, 0.3, shape)
    first = unit(np.cross(tangent, np.array([0.83, 0.11, 0.55])))
    second = np.cross(tangent, first)
    side = first * np.cos(azimuth)[..., None] + second * np.sin(azimuth)[..., None]
    open_angle = _between(habit.angle, place) + rng.normal(0, 0.12, shape)
    direction = np.cos(open_angle)[..., None] * tangent + np.sin(open_angle)[..., None] * side
    long = parents.lengths[:, None] * _between(habit.length, place) * rng.uniform(0.75, 1.25, shape)
    return grow(
        rng,
        start.reshape(-1, 3),
        direction.reshape(-1, 3),
        long.ravel(),
        (habit.thickness * radius).ravel(),
        habit.points,
        habit.lift,
        habit.wander,
    )


def trunk(rng: np.random.Generator, height_m: float, radius_m: float, bend: float, top: float) -> Branches:
    """One trunk from 0.6 m below the ground, its radius at the top `top` times that above the roots."""
    heights = np.concatenate([[-0.6, -0.15, 0.12, 0.4, 0.9], np.linspace(1.7, height_m, 11)])
    wander = (
        np.cumsum(rng.normal(0, bend, (len(heights), 2)), axis=0) * np.sqrt(np.gradient(heights))[:, None]
    )
    wander -= np.array([np.interp(0, heights, column) for column in wander.T])
    lean = rng.normal(0, 0.4 * bend, 2) * heights[:, None]
    across = np.where(heights[:, None] < 0, 0, wander + lean)
    radii = radius_m * np.interp(heights, [0, height_m], [1.0, top])
    return Branches(np.column_stack([across[:, 0], -heights, across[:, 1]])[None], radii[None])


def roots(rng: np.random.Generator, stem: Branches, sides: int) -> Array:
    """Radii (1, N, sides) [m] of a trunk that is not quite round and spreads into roots below."""
    height = -stem.points[0, :, 1]
    around = np.arange(sides) * 2 * np.pi / sides
    orders = np.arange(2, 6)[:, None]
    phases = rng.uniform(0, 2 * np.pi, (4, 1))
    wave = (rng.uniform(0.3, 1.0, (4, 1)) * np.cos(orders * around + phases)).sum(axis=0) / 2
    flare = np.exp(-np.maximum(height + 0.1, 0) / 0.28)[:, None]
    radii = stem.radii[0][:, None] * (1 + flare * (0.75 + 0.75 * wave) + 0.05 * wave)
    return radii[None]


def bark_of(branches: Branches, sides: int, material: int, radii: Array | None = None) -> Mesh:
    """Round tubes along branches; `radii` (B, N, sides) replaces theirs [m]."""
    centres = branches.points
    count, points = centres.shape[:2]
    tangents = unit(np.gradient(centres, axis=1))
    overall = unit(centres[:, -1] - centres[:, 0])
    helper = np.eye(3)[np.argmin(np.abs(overall), axis=1)]
    first = unit(np.cross(tangents, helper[:, None]))
    second = np.cross(tangents, first)
    angles = np.linspace(0, 2 * np.pi, sides + 1)
    normals = first[:, :, None] * np.cos(angles)[:, None] + second[:, :, None] * np.sin(angles)[:, None]
    around = branches.radii[..., None] if radii is None else np.concatenate([radii, radii[..., :1]], axis=-1)
    around = np.broadcast_to(around, (count, points, sides + 1))
    vertices = centres[:, :, None] + around[..., None] * normals
    steps = np.linalg.norm(np.diff(centres, axis=1), axis=2)
    v = np.concatenate([np.zeros((count, 1)), np.cumsum(steps, axis=1)], axis=1)
    u = angles * branches.radii.mean(axis=1)[:, None]
    # each branch starts elsewhere on the tile
    offset = 0.37 * np.arange(count)
    uv = np.stack(
        [
            np.broadcast_to((u + offset[:, None])[:, None], around.shape),
            np.broadcast_to((v + 1.7 * offset[:, None])[..., None], around.shape),
        ],
        axis=-1,
    )
    one = lattice(points, sides + 1)
    triangles = one + (np.arange(count) * points * (sides + 1))[:, None, None]
    return Mesh.of(
        vertices.reshape(-1, 3), normals.reshape(-1, 3), uv.reshape(-1, 2), triangles.reshape(-1, 3), material
    )


def _between(ends: tuple[float, float], share: Array) -> Array:
    return ends[0] + (ends[1] - ends[0]) * share
