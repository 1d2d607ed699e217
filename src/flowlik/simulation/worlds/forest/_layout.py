"""Where things stand in the forest: at chance, but clear of the paths and of each other."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from flowlik.errors import DataError
from flowlik.simulation.render import Prototype, placed
from flowlik.simulation.worlds.forest._terrain import CENTRE_M, Terrain
from flowlik.simulation.worlds.paths import FREE_RADIUS_M
from flowlik.support.arrays import Array

Density = Callable[[Array, Array], Array]
"""Chance, 0 to 1, that something stands at points x, z [m]."""

_MARGIN_M = 0.15
"""Because points stand for the triangles between them."""

_TRIES, _ROUNDS = 8000, 40
"""Places drawn at a time, and how often before giving up."""


@dataclass(frozen=True, eq=False)
class Hull:
    """Points that stand for all of a prototype when its distance to something is measured.

    Attributes
    ----------
    points : array (N, 3)
        Vertices and leaf centres [m].
    radii : array (N,)
        Half lengths of the leaves, 0 for vertices [m].
    reach_m, height_m : float
        Greatest distance from the y axis, and height.
    """

    points: Array
    radii: Array
    reach_m: float
    height_m: float

    @classmethod
    def of(cls, prototype: Prototype) -> Hull:
        """Collect the points of a prototype."""
        points, radii = [prototype.mesh.vertices], [np.zeros(len(prototype.mesh.vertices))]
        if prototype.foliage is not None:
            points.append(prototype.foliage.centres)
            radii.append(np.linalg.norm(prototype.foliage.along, axis=1))
        all_points, all_radii = np.concatenate(points).astype(float), np.concatenate(radii).astype(float)
        reach = np.hypot(all_points[:, 0], all_points[:, 2]) + all_radii
        return cls(all_points, all_radii, float(reach.max()), float((all_radii - all_points[:, 1]).max()))

    def clears_paths(self, transform: Array, path_m: float, terrain: Terrain, free_m: float) -> bool:
        """Whether a copy, its foot so far from the centre lines, stays at least free_m from all of them."""
        scale = float(np.linalg.norm(transform[:, 0]))
        below_m = transform[1, 3] - scale * self.height_m
        if max(path_m - scale * self.reach_m, below_m) > free_m + _MARGIN_M:
            return True
        points = self.points @ transform[:, :3].T + transform[:, 3]
        radii = scale * self.radii
        near = np.abs(points[:, 1]) - radii < free_m + _MARGIN_M
        points, radii = points[near], radii[near]
        level = terrain.path_distance_m(points[:, 0], points[:, 2])
        return bool((np.hypot(level, points[:, 1]) - radii > free_m + _MARGIN_M).all())


@dataclass(frozen=True)
class Sort:
    """A sort of thing to be strewn.

    Parameters
    ----------
    scale : tuple of two float
        Least and greatest size.
    apart_m : float
        Least distance between two of the sort, centre to centre.
    disc_m : float
        Radius of the disc that a copy of scale 1 takes up among other things.
    free_m : float
        Distance to be kept from the centre lines.
    sunk_m : float
        How deep the foot is in the ground.
    """

    scale: tuple[float, float]
    apart_m: float
    disc_m: float
    free_m: float = FREE_RADIUS_M
    sunk_m: float = 0.0


def strewn(
    rng: np.random.Generator,
    terrain: Terrain,
    sort: Sort,
    count: int,
    hulls: Sequence[Hull],
    density: Density,
    discs: Array,
) -> tuple[list[tuple[int, Array]], Array]:
    """Copies (index of the hull, transform) strewn over the ground, and the discs (N, 3) now taken up.

    Parameters
    ----------
    rng : Generator
        Draws everything.
    terrain : Terrain
        Ground.
    sort : Sort
        What is strewn.
    count : int
        How many.
    hulls : sequence of Hull
        One of them stands at each place.
    density : callable
        Where.
    discs : array (N, 3)
        x, z and radius [m] of what stands already.

    Raises
    ------
    DataError
        If there is no room for all.
    """
    copies: list[tuple[int, Array]] = []
    if count == 0:
        return copies, discs
    taken = np.concatenate([discs, np.empty((count, 3))])
    for _ in range(_ROUNDS):
        places = _places(rng, terrain, _TRIES, density)
        which, yaws = rng.integers(len(hulls), size=len(places)), rng.uniform(0, 2 * np.pi, len(places))
        scales = np.exp(rng.uniform(np.log(sort.scale[0]), np.log(sort.scale[1]), len(places)))
        y = terrain.ground_m(*places.T) + sort.sunk_m * scales
        path_m = terrain.path_distance_m(*places.T)
        for i, (x, z) in enumerate(places):
            now = taken[: len(discs) + len(copies)]
            room = now[:, 2] + scales[i] * sort.disc_m
            room[len(discs) :] = sort.apart_m
            if ((now[:, 0] - x) ** 2 + (now[:, 1] - z) ** 2 < room**2).any():
                continue
            transform = placed(np.array([x, y[i], z]), yaws[i], scales[i])
            if hulls[which[i]].clears_paths(transform, path_m[i], terrain, sort.free_m):
                taken[len(now)] = x, z, scales[i] * sort.disc_m
                copies.append((int(which[i]), transform))
                if len(copies) == count:
                    return copies, taken
    raise DataError(f"the forest has room for {len(copies)} of {count} things: ask for fewer")


def _places(rng: np.random.Generator, terrain: Terrain, count: int, density: Density) -> Array:
    """At most `count` places (N, 2) drawn from a density over the world."""
    half = terrain.extent_m / 2 - 2.0
    places = CENTRE_M + rng.uniform(-half, half, (count, 2))
    return places[rng.random(count) < density(*places.T)]
