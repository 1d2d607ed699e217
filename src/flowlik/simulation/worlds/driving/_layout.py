"""Everything that stands along a route, by squares."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from flowlik.simulation.render import Instances
from flowlik.simulation.worlds.driving._ground import SQUARE_M, Square, square_of
from flowlik.simulation.worlds.driving._kinds import Kinds
from flowlik.simulation.worlds.driving._open import furnish_open_road
from flowlik.simulation.worlds.driving._places import Footprints, Things, away_from, upright
from flowlik.simulation.worlds.driving._street import furnish_street, put_plants
from flowlik.simulation.worlds.driving._surface import GroundSurface
from flowlik.support.arrays import Array

CLEAR_M = 1.3
"""Nothing stands nearer to the camera's positions."""

SMALL_KINDS = ("tuft", "bush", "bollard", "railing", "sign")
"""What is drawn in squares near the camera only."""

TALL_KINDS = ("house", "block", "avenue", "garden", "tree", "conifer", "gantry")
"""What is drawn in the squares farthest from the camera."""

_MARGINS_M = {"tree": (5.5, 2.5), "conifer": (5.0, 2.5), "bush": (2.5, 1.2), "tuft": (0.8, 0.4)}
"""How far plants keep from pavements and from houses."""


@dataclass(frozen=True, eq=False)
class Layout:
    """What stands where along a route.

    Attributes
    ----------
    surface : GroundSurface
        The roads and the ground.
    kinds : Kinds
        Drawings.
    seed : int
        Draws everything.
    beside_roads : dict of square to Instances
        What stands along the streets.
    taken : Footprints
        Where houses stand.
    """

    surface: GroundSurface
    kinds: Kinds
    seed: int
    beside_roads: dict[Square, Instances]
    taken: Footprints

    @classmethod
    def of(cls, surface: GroundSurface, kinds: Kinds, seed: int, positions: Array) -> Layout:
        """Lay out everything along the streets, off the camera's positions (N, 3)."""
        things, taken = Things(), Footprints()
        profile = surface.ground.roads.profile
        for street in range(len(surface.ground.roads.streets)):
            for right in (False, True):
                if profile.name == "street":
                    things.extend(furnish_street(surface, kinds, seed, street, right, taken))
                else:
                    things.extend(furnish_open_road(surface, kinds, seed, street, right))
        clear = away_from(things.instances(), kinds.prototypes, positions, CLEAR_M)
        return cls(surface, kinds, seed, _by_square(clear), taken)

    def square(self, square: Square, detail: int) -> Instances:
        """Copies that stand in a square: 2 everything, 1 without what is small, 0 only what is tall."""
        along = self.beside_roads.get(square)
        wild = self._wild(square)
        instances = wild if along is None else Instances.joined([along, wild])
        if detail == 2:
            return instances
        kinds = SMALL_KINDS if detail == 1 else TALL_KINDS
        chosen = np.isin(instances.prototypes, [n for kind in kinds for n in self.kinds.numbers[kind]])
        shown = ~chosen if detail == 1 else chosen
        return Instances(instances.prototypes[shown], instances.transforms[shown])

    def _wild(self, square: Square) -> Instances:
        """Trees, bushes and tufts away from the roads, and houses of other streets: of this square only."""
        rng = np.random.default_rng([self.seed, 51, square[0] + 2**20, square[1] + 2**20])
        ground, things = self.surface.ground, Things()
        low = np.array(square) * SQUARE_M
        profile = ground.roads.profile
        verge = profile.verge_m
        woods = float(ground.waves(low[None] + SQUARE_M / 2)[1, 0])
        own = Footprints()
        if profile.name == "street":
            self._far_houses(things, own, low, rng)
            counts = {"tree": 8, "conifer": 3, "bush": 12, "tuft": 25}
        else:
            density = float(np.clip(0.5 + 1.2 * woods, 0.05, 1.0))
            counts = {"tree": round(30 * density), "conifer": round(16 * density), "bush": 16, "tuft": 60}
        names = np.repeat(np.array(list(counts)), list(counts.values()))
        points = low + rng.random((len(names), 2)) * SQUARE_M
        margins = np.array([_MARGINS_M[name] for name in names])
        kept = ground.roads.edge(points) > verge + margins[:, 0]
        kept &= self.taken.clear(points, margins[:, 1]) & own.clear(points, margins[:, 1])
        numbers = np.array([self.kinds.pick(rng, name) for name in names[kept]], np.int64)
        put_plants(things, self.surface, numbers, points[kept], rng)
        return things.instances()

    def _far_houses(self, things: Things, own: Footprints, low: Array, rng: np.random.Generator) -> None:
        """Up to four houses wholly inside the square, in line with the nearest street."""
        ground, numbers, points = self.surface.ground, np.empty(4, np.int64), np.empty((4, 2))
        for i in range(4):
            numbers[i] = self.kinds.pick(rng, "house")
            reach = float(np.linalg.norm(self.kinds.half_sizes_m[numbers[i]]))
            points[i] = low + rng.uniform(reach, SQUARE_M - reach, 2)
        edges, levels = ground.roads.edge(points), ground.surface(points)
        streets, arcs, right = ground.roads.nearest_street(points)
        for i in range(4):
            half = self.kinds.half_sizes_m[numbers[i]]
            if edges[i] < np.linalg.norm(half) + 14.0:
                continue
            _, along = ground.roads.streets[streets[i]].at(arcs[[i]])
            facing = along[0, ::-1] * [1.0, -1.0] * (1.0 if right[i] else -1.0)
            row = np.array([*points[i], facing[1], -facing[0], *half])
            if self.taken.overlaps(row, 3.0) or own.overlaps(row, 3.0):
                continue
            own.add(row)
            things.add(numbers[[i]], upright(points[[i]], levels[[i]], facing[None]))


def _by_square(instances: Instances) -> dict[Square, Instances]:
    """Instances of each square, by where their feet stand."""
    found: dict[Square, list[int]] = {}
    for i, point in enumerate(instances.transforms[:, [0, 2], 3]):
        found.setdefault(square_of(point), []).append(i)
    return {
        square: Instances(instances.prototypes[rows], instances.transforms[rows])
        for square, rows in found.items()
    }
