"""The world `planes`: a closed hall with textured rectangles standing and hanging in it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np

from flowlik.errors import DataError
from flowlik.simulation.worlds.planes._hall import SIDES, HallWorld, Paint
from flowlik.simulation.worlds.planes._textures import CONTRAST_MAPS, TILES, make_textures


@dataclass(frozen=True)
class PlanesWorld(HallWorld):
    """Textured planes of exact depth: a hall of 32 x 9.5 x 125 m with rectangles in it.

    Parameters
    ----------
    seed : int
        Draws the rectangles and their textures.
    rectangles : int
        Number of rectangles in the hall.
    samples : int
        Rays averaged in a pixel.

    Raises
    ------
    DataError
        If `seed` or `rectangles` is negative or `samples` is less than 1.
    """

    name: ClassVar[str] = "planes"

    def __post_init__(self) -> None:
        if self.seed < 0 or self.rectangles < 0 or self.samples < 1:
            raise DataError(f"impossible {self}: seed and rectangles must be 0 or more, samples 1 or more")

    @cached_property
    def _paint(self) -> Paint:
        rng, count = np.random.default_rng([self.seed, 2]), len(self.surfaces)
        tiles = np.column_stack([rng.permutation(count) % TILES, rng.permutation(count) % CONTRAST_MAPS])
        # so that the six sides of the hall, most of every picture, differ
        tiles[:SIDES, 0] = rng.permutation(TILES)[:SIDES]
        is_hall = np.arange(count) < SIDES
        contrast = np.exp(rng.uniform(np.log(np.where(is_hall, 50, 25)), np.log(125)))
        mean = rng.uniform(1 + contrast, 254 - contrast)
        tile_period_m = np.where(is_hall, rng.uniform(4, 8, count), rng.uniform(2, 7, count))
        contrast_period_m = np.where(is_hall, rng.uniform(22, 40, count), rng.uniform(10, 20, count))
        phases = rng.random((count, 4))
        looks = [mean, contrast, 1 / tile_period_m, phases[:, :2], 1 / contrast_period_m, phases[:, 2:]]
        return Paint(make_textures(self.seed), tiles, np.column_stack(looks))
