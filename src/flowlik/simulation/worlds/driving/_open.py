"""A motorway or a country road: rails, posts, signs and plants beside it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flowlik.simulation.worlds.driving._kinds import SEGMENT_M, Kinds
from flowlik.simulation.worlds.driving._places import (
    Places,
    Things,
    beside,
    evenly_beside,
    free,
    standing,
    upright,
)
from flowlik.simulation.worlds.driving._street import put_plants
from flowlik.simulation.worlds.driving._surface import GroundSurface
from flowlik.support.arrays import Array

_GANTRIES_EVERY_M = 420.0


@dataclass(frozen=True, eq=False)
class _Side:
    """One side of a carriageway, and what has been put there."""

    surface: GroundSurface
    kinds: Kinds
    street: int
    right: bool
    rng: np.random.Generator
    things: Things

    @property
    def length_m(self) -> float:
        return float(self.surface.ground.roads.streets[self.street].arc_m[-1])

    def places(self, arc_m: Array, out_m: Array | float, half_m: float, slack_m: float = 0.2) -> Places:
        """Places at lengths along the street and distances from its edge, where no other road runs."""
        ground = self.surface.ground
        found = beside(ground, self.street, arc_m, np.full(len(arc_m), self.right), out_m)
        return found[free(ground, found, half_m, out_m, slack_m)]

    def put(self, numbers: NDArray[np.int64], places: Places, facing: Array, scale: float = 1.0) -> None:
        """Put upright things on the ground, their fronts against the direction they face."""
        self.things.add(
            numbers, upright(places.points, self.surface.ground.surface(places.points), facing, scale)
        )

    def plant(self, kind: str, places: Places, scales: tuple[float, float] = (0.75, 1.15)) -> None:
        """Put plants of a kind."""
        numbers = self.kinds.picks(self.rng, kind, len(places))
        put_plants(self.things, self.surface, numbers, places.points, self.rng, scales)


def furnish_open_road(surface: GroundSurface, kinds: Kinds, seed: int, street: int, right: bool) -> Things:
    """Everything on one side of a motorway's carriageway or of a country road."""
    rng = np.random.default_rng([seed, 43, street, right])
    side = _Side(surface, kinds, street, right, rng, Things())
    if surface.ground.roads.profile.name == "motorway":
        _rails(side)
        if right:
            _gantries(side)
    else:
        _avenue(side)
    _posts_and_signs(side)
    arcs = rng.uniform(0, side.length_m, int(side.length_m / 12))
    side.plant("bush", side.places(arcs, rng.uniform(2.5, 7.0, len(arcs)), 0.5), (0.4, 1.0))
    return side.things


def _rails(side: _Side) -> None:
    ground, step = side.surface.ground, SEGMENT_M["guard-rail"]
    places = evenly_beside(ground, side.street, side.right, 1.0, step)
    places = places[free(ground, places, step / 2, 1.0, 0.4)]
    # a rail's face looks along -x: with z so, x points away from the road
    ahead = np.column_stack([-places.outward[:, 1], places.outward[:, 0]])
    side.things.add(
        np.full(len(places), side.kinds.numbers["guard-rail"][0]),
        standing(places.points, ground.slope(places.points, ahead), ground.level(places.points), 0.0, False),
    )


def _gantries(side: _Side) -> None:
    ground = side.surface.ground
    arcs = np.arange(side.rng.uniform(80, 160), side.length_m, _GANTRIES_EVERY_M)
    middle = -ground.roads.profile.half_width_m
    places = beside(ground, side.street, arcs, np.full(len(arcs), True), middle)
    side.put(side.kinds.picks(side.rng, "gantry", len(arcs)), places, places.along)


def _avenue(side: _Side) -> None:
    rng = side.rng
    arcs = np.arange(9.0, side.length_m, 18.0) + rng.normal(0, 1.0)
    side.plant("avenue", side.places(arcs[rng.random(len(arcs)) < 0.5], 3.2, 2.0, 0.4))
    arcs = np.arange(5.0, side.length_m, 6.0)
    side.plant("bush", side.places(arcs[np.sin(arcs / 40.0) > 0.2], 6.0, 1.0, 1.0))


def _posts_and_signs(side: _Side) -> None:
    places = side.places(np.arange(25.0, side.length_m, 50.0), 0.7, 0.5, 0.1)
    side.put(np.full(len(places), side.kinds.numbers["bollard"][0]), places, places.along)
    places = side.places(side.rng.uniform(0, side.length_m, int(side.length_m / 160)), 1.9, 0.5, 0.1)
    facing = places.along * (1.0 if side.right else -1.0)
    side.put(side.kinds.picks(side.rng, "sign", len(places)), places, facing, 1.3)
