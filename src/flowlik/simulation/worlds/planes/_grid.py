"""The world `grid`: the hall of `planes` covered with patterns that repeat exactly.

Self-similar texture is the limitation that the paper names: a flow that is off by whole periods looks as good
as the right one.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np

from flowlik.errors import DataError
from flowlik.simulation.worlds.planes._hall import SIDES, HallWorld, Paint
from flowlik.simulation.worlds.planes._textures import CONTRAST_PX, Textures, pack_textures
from flowlik.support.arrays import Array

PATTERN_PX = 256


@dataclass(frozen=True)
class GridWorld(HallWorld):
    """Checkers, bars and dots of one period on every side and rectangle of the hall; no other texture.

    Parameters
    ----------
    seed : int
        Draws the rectangles, and which pattern and contrast each side and rectangle has.
    period_m : float
        Period of all patterns [m].
    rectangles : int
        Number of rectangles in the hall.
    samples : int
        Rays averaged in a pixel.

    Raises
    ------
    DataError
        If `seed` or `rectangles` is negative, `period_m` is not positive or `samples` is less than 1.
    """

    period_m: float = 0.5

    name: ClassVar[str] = "grid"

    def __post_init__(self) -> None:
        if self.seed < 0 or self.rectangles < 0 or self.samples < 1 or not 0 < self.period_m < np.inf:
            raise DataError(
                f"impossible {self}: seed and rectangles must be 0 or more, samples 1 or more, "
                "the period positive"
            )

    @cached_property
    def _paint(self) -> Paint:
        rng, count = np.random.default_rng([self.seed, 3]), len(self.surfaces)
        # every pattern is on two sides of the hall
        sides = rng.permutation(SIDES) % len(PATTERNS)
        patterns = np.concatenate([sides, rng.integers(0, len(PATTERNS), count - SIDES)])
        contrast = np.exp(rng.uniform(np.log(25), np.log(110), count))
        mean = rng.uniform(1 + contrast, 254 - contrast)
        tiles = np.column_stack([patterns, np.zeros_like(patterns)])
        # a contrast map of ones: its period and phase do not matter
        zero = np.zeros((count, 2))
        looks = [mean, contrast, np.full(count, 1 / self.period_m), zero, np.ones(count), zero]
        return Paint(_textures(), tiles, np.column_stack(looks))


def _checkers(s: Array, t: Array) -> Array:
    return np.where((s < 0.5) == (t < 0.5), 1.0, -1.0)


def _bars(s: Array, t: Array) -> Array:
    # aslant, so that they repeat along every side of the hall
    return np.where(np.mod(s + t, 1) < 0.5, 1.0, -1.0)


def _dots(s: Array, t: Array) -> Array:
    return np.where(np.hypot(s - 0.5, t - 0.5) < 0.3, 1.0, -1.0)


PATTERNS = (_checkers, _bars, _dots)
"""One period of each pattern, -1 to 1, over s and t within 0 to 1."""


def _textures() -> Textures:
    place = (np.arange(PATTERN_PX) + 0.5) / PATTERN_PX
    tiles = [pattern(place[None, :], place[:, None]).astype(np.float32) for pattern in PATTERNS]
    return pack_textures(tiles, [np.ones((CONTRAST_PX, CONTRAST_PX), np.float32)])
