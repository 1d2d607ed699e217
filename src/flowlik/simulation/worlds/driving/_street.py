"""A residential street: vehicles, trees and lamps on its strips, gardens and houses behind its pavements."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flowlik.simulation.worlds.driving._kinds import SEGMENT_M, Kinds
from flowlik.simulation.worlds.driving._places import (
    Footprints,
    Places,
    Things,
    beside,
    evenly_beside,
    free,
    standing,
    upright,
)
from flowlik.simulation.worlds.driving._surface import BLOCK_M, GREEN, PAVED, GroundSurface
from flowlik.support.arrays import Array

_STYLES = ("villa", "row", "green")
_VILLA, _ROW, _GREEN = range(3)
_BOUNDARIES = ("hedge", "fence", "wall", "railing")
_STYLE_SHARES = (0.55, 0.25, 0.2)
_PARKED = 0.62
_PARKED_OUT_M = 1.2


@dataclass(frozen=True, eq=False)
class _Lots:
    """Lots on one side of a street: (N,) lengths along it, widths [m], styles, and houses (-1 for none)."""

    starts: Array
    widths: Array
    styles: NDArray[np.int64]
    houses: NDArray[np.int64]


def furnish_street(
    surface: GroundSurface, kinds: Kinds, seed: int, street: int, right: bool, taken: Footprints
) -> Things:
    """Everything on one side of a street; houses are added to the footprints taken."""
    things = Things()
    rng = np.random.default_rng([seed, 41, street, right])
    lots = _lots(rng, kinds, float(surface.ground.roads.streets[street].arc_m[-1]))
    _houses(things, surface, kinds, street, right, lots, rng, taken)
    _boundaries(things, surface, kinds, street, right, lots, rng, taken)
    _gardens(things, surface, kinds, street, right, lots, rng, taken)
    _strips(things, surface, kinds, street, right, rng)
    return things


def _lots(rng: np.random.Generator, kinds: Kinds, length_m: float) -> _Lots:
    """Lots side by side, in runs of one style of 60 to 140 m."""
    rows, start, run_end, style = [], 0.0, 0.0, 0
    while start < length_m:
        if start >= run_end:
            style, run_end = int(rng.choice(len(_STYLES), p=_STYLE_SHARES)), start + rng.uniform(60, 140)
        number = -1
        if style == _GREEN:
            width = 15.0
        else:
            number = kinds.pick(rng, "house" if style == _VILLA else "block")
            own = 2 * float(kinds.half_sizes_m[number, 0])
            gap = rng.uniform(4.0, 9.0) if style == _VILLA else 4.0 * (rng.random() < 0.15)
            width = own + gap
        rows.append((start, width, style, number))
        start += width
    starts, widths, styles, houses = zip(*rows)
    return _Lots(np.array(starts), np.array(widths), np.array(styles), np.array(houses))


def _houses(
    things: Things,
    surface: GroundSurface,
    kinds: Kinds,
    street: int,
    right: bool,
    lots: _Lots,
    rng: np.random.Generator,
    taken: Footprints,
) -> None:
    """Houses where nothing else stands and no street runs; the others are left out."""
    ground, verge = surface.ground, surface.ground.roads.profile.verge_m
    setback = np.where(lots.styles == _VILLA, rng.uniform(3.5, 7.0, len(lots.starts)), 0.5)
    built = np.flatnonzero(lots.houses >= 0)
    numbers, half = lots.houses[built], kinds.half_sizes_m[lots.houses[built]]
    middle = (lots.starts + lots.widths / 2)[built]
    out = verge + setback[built] + half[:, 1]
    places = beside(ground, street, middle, np.full(len(built), right), out)
    corners = np.stack(
        [
            places.points + a * half[:, [0]] * places.along + b * half[:, [1]] * places.outward
            for a in (-1.0, 0.0, 1.0)
            for b in (-1.0, 1.0)
        ],
        axis=1,
    )
    edges = ground.roads.edge(corners.reshape(-1, 2)).reshape(corners.shape[:2]).min(axis=1)
    # the house's x axis, with its front towards the street
    x_axis = np.column_stack([places.outward[:, 1], -places.outward[:, 0]])
    rows = np.column_stack([places.points, x_axis, half - 0.05])
    kept = []
    for i in np.flatnonzero(edges > verge + 0.2):
        if not taken.overlaps(rows[i]):
            taken.add(rows[i])
            kept.append(i)
    standing_ = places[np.array(kept, np.int64)]
    # on a slope the house stands on the mean ground; its walls reach below
    things.add(numbers[kept], upright(standing_.points, ground.surface(standing_.points), standing_.outward))


def _boundaries(
    things: Things,
    surface: GroundSurface,
    kinds: Kinds,
    street: int,
    right: bool,
    lots: _Lots,
    rng: np.random.Generator,
    taken: Footprints,
) -> None:
    """Hedges, fences, walls or railings between pavement and gardens, with a gate in each lot."""
    ground = surface.ground
    out = ground.roads.profile.verge_m + 0.45
    count = len(lots.starts)
    chosen = rng.choice(len(_BOUNDARIES), count, p=(0.5, 0.2, 0.2, 0.1))
    chosen[(lots.styles == _ROW) | ((lots.styles == _GREEN) & (rng.random(count) < 0.4))] = -1
    gates = lots.starts + lots.widths * rng.uniform(0.3, 0.7, count)
    for i, kind in enumerate(_BOUNDARIES):
        numbers, step = kinds.picks(rng, kind, count), SEGMENT_M[kind]
        places = evenly_beside(ground, street, right, out, step)
        _, arc = ground.roads.streets[street].nearest(places.points)
        lot = np.clip(np.searchsorted(lots.starts, arc, side="right") - 1, 0, count - 1)
        kept = (chosen[lot] == i) & (np.abs(arc - gates[lot]) > 1.2 + step / 2)
        kept &= free(ground, places, step / 2, out, 0.3) & taken.clear(places.points, 0.8)
        _put_along(things, surface, places[kept], numbers[lot[kept]])


def _gardens(
    things: Things,
    surface: GroundSurface,
    kinds: Kinds,
    street: int,
    right: bool,
    lots: _Lots,
    rng: np.random.Generator,
    taken: Footprints,
) -> None:
    """Bushes and trees in front gardens and on greens."""
    verge = surface.ground.roads.profile.verge_m
    for kind, counts, nearest_m, farthest_m, margin_m in (
        ("bush", (7, 0, 9), (1.3, 0.0, 1.3), (9.0, 0.0, 18.0), 0.9),
        ("garden", (1, 0, 4), (3.0, 0.0, 3.5), (9.0, 0.0, 24.0), 1.8),
        ("conifer", (1, 0, 1), (3.0, 0.0, 4.0), (9.0, 0.0, 24.0), 1.8),
    ):
        lot = np.repeat(np.arange(len(lots.starts)), np.array(counts)[lots.styles])
        if not len(lot):
            continue
        lot = lot[rng.random(len(lot)) < 0.75]
        style = lots.styles[lot]
        arcs = lots.starts[lot] + rng.random(len(lot)) * lots.widths[lot]
        low, high = np.array(nearest_m)[style], np.array(farthest_m)[style]
        out = verge + low + rng.random(len(lot)) * (high - low)
        places = beside(surface.ground, street, arcs, np.full(len(lot), right), out)
        places = places[free(surface.ground, places, 1.0, verge + 1.0)]
        places = places[taken.clear(places.points, margin_m)]
        put_plants(things, surface, kinds.picks(rng, kind, len(places.points)), places.points, rng)


def _strips(
    things: Things, surface: GroundSurface, kinds: Kinds, street: int, right: bool, rng: np.random.Generator
) -> None:
    """Parked vehicles on paved blocks, trees on green ones, lamps and signs between them."""
    ground, blocks = surface.ground, surface.blocks[street][:, int(right)]
    begins = BLOCK_M * np.arange(len(blocks))

    slots = (begins[blocks == PAVED][:, None] + np.array([3.0, 9.0])).ravel()
    slots = slots[rng.random(len(slots)) < _PARKED]
    slots = slots + rng.normal(0, 0.25, len(slots))
    out = _PARKED_OUT_M + rng.normal(0, 0.05, len(slots))
    numbers = np.array([kinds.pick(rng, "car" if rng.random() < 0.88 else "van") for _ in slots], np.int64)
    places = beside(ground, street, slots, np.full(len(slots), right), out)
    kept = free(ground, places, 2.6, out, 0.15) & ~_spoilt(surface, places, 2.3, GREEN)
    # most stand in the direction of traffic on their side
    heading = np.where(rng.random(len(slots)) < 0.85, 1.0, -1.0) * (1.0 if right else -1.0)
    turn = rng.normal(0, 0.02, len(slots))[:, None]
    direction = heading[:, None] * (places.along + turn * places.outward)
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    points, direction = places.points[kept], direction[kept]
    things.add(
        numbers[kept],
        standing(points, ground.slope(points, direction), ground.level(points), _kerb(surface), False),
    )

    trees = np.asarray(begins[blocks == GREEN] + BLOCK_M / 2, np.float64)
    trees = trees[rng.random(len(trees)) < 0.65]
    places = beside(ground, street, trees, np.full(len(trees), right), 1.35)
    places = places[free(ground, places, 1.0, 1.35, 0.2)]
    put_plants(things, surface, kinds.picks(rng, "avenue", len(places.points)), places.points, rng)

    starts = np.repeat(begins[blocks == GREEN], 5)
    plants = starts + rng.uniform(1.0, BLOCK_M - 1.0, len(starts))
    out = rng.uniform(0.6, 1.9, len(plants))
    places = beside(ground, street, plants, np.full(len(plants), right), out)
    places = places[free(ground, places, 0.5, out, 0.2)]
    split = rng.random(len(places)) < 0.12
    put_plants(
        things,
        surface,
        kinds.picks(rng, "bush", len(places.points[split])),
        places.points[split],
        rng,
        (0.35, 0.7),
    )
    put_plants(
        things, surface, kinds.picks(rng, "tuft", len(places.points[~split])), places.points[~split], rng
    )

    lamps = np.asarray(begins[int(right) * 2 :: 3], np.float64)
    places = beside(ground, street, lamps, np.full(len(lamps), right), 0.5)
    places = places[free(ground, places, 0.3, 0.5, 0.1)]
    things.add(
        np.full(len(places), kinds.numbers["lamp"][0]),
        upright(places.points, ground.surface(places.points), places.outward),
    )

    signs = np.asarray(begins[rng.random(len(begins)) < 0.22] + 0.3, np.float64)
    places = beside(ground, street, signs, np.full(len(signs), right), 0.45)
    places = places[free(ground, places, 0.5, 0.45, 0.1)]
    facing = places.along * (1.0 if right else -1.0)
    numbers = kinds.picks(rng, "sign", len(places))
    things.add(numbers, upright(places.points, ground.surface(places.points), facing))


def _spoilt(surface: GroundSurface, places: Places, half_m: float, paint: float) -> NDArray[np.bool_]:
    """Whether the strip shows some paint half_m before or behind places (N,)."""
    ends = [surface.strip_paint(places.points + s * half_m * places.along) == paint for s in (-1.0, 1.0)]
    return np.asarray(ends[0] | ends[1])


def _put_along(things: Things, surface: GroundSurface, places: Places, numbers: NDArray[np.int64]) -> None:
    """Pieces of a boundary, their x axis along the ground and their front towards the street."""
    x_axis = np.column_stack([places.outward[:, 1], -places.outward[:, 0]])
    directions = surface.ground.slope(places.points, x_axis)
    things.add(
        numbers,
        standing(places.points, directions, surface.ground.level(places.points), _kerb(surface), True),
    )


def put_plants(
    things: Things,
    surface: GroundSurface,
    numbers: NDArray[np.int64],
    points: Array,
    rng: np.random.Generator,
    scales: tuple[float, float] = (0.75, 1.15),
) -> None:
    """Plants (N,) at plan points (N, 2), turned and scaled at random."""
    turn = rng.uniform(0, 2 * np.pi, len(points))
    facing = np.column_stack([np.sin(turn), np.cos(turn)])
    level = surface.ground.surface(points)
    things.add(numbers, upright(points, level, facing, rng.uniform(*scales, len(points))))


def _kerb(surface: GroundSurface) -> float:
    return surface.ground.roads.profile.kerb_m
