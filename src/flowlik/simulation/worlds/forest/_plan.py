"""Which things stand where in the forest, how large, how dense, how far from the paths."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from flowlik.simulation.render import Prototype
from flowlik.simulation.worlds.forest._layout import Density, Hull, Sort, strewn
from flowlik.simulation.worlds.forest._terrain import CENTRE_M, Terrain, waves
from flowlik.support.arrays import Array

_NEAR_M = 11.0
"""Trees up to this distance from the paths are built down to their twigs."""

_EDGE_M = 14.0
"""Width of the denser strip along the border of the world, which hides the foot of the hills."""

_SORTS = {
    "house": Sort(scale=(1.0, 1.0), apart_m=26.0, disc_m=7.0, sunk_m=0.15),
    "tree": Sort(scale=(0.65, 1.2), apart_m=2.2, disc_m=0.9),
    "far tree": Sort(scale=(0.7, 1.35), apart_m=2.6, disc_m=0.9),
    "rock": Sort(scale=(0.6, 2.6), apart_m=1.2, disc_m=0.5),
    "stone": Sort(scale=(0.12, 0.5), apart_m=0.3, disc_m=0.2, free_m=1.3),
    "bush": Sort(scale=(0.5, 1.5), apart_m=1.0, disc_m=0.2),
    "fern": Sort(scale=(0.6, 1.4), apart_m=0.5, disc_m=0.1, free_m=1.3),
    "grass": Sort(scale=(0.7, 1.5), apart_m=0.0, disc_m=0.0, free_m=1.2),
}
"""In the order in which they choose their places."""


def planted(
    seed: int, terrain: Terrain, counts: Mapping[str, int], kinds: Mapping[str, Sequence[Prototype]]
) -> dict[str, list[tuple[int, Array]]]:
    """Copies (number within the kind, transform) of every kind of thing.

    Parameters
    ----------
    seed : int
        Draws everything.
    terrain : Terrain
        Ground.
    counts : mapping
        How many of each kind.
    kinds : mapping
        Prototypes of each kind.

    Raises
    ------
    DataError
        If there is no room for all.
    """
    rng, discs = np.random.default_rng([seed, 20]), np.empty((0, 3))
    densities = _Habitat(seed, terrain).densities()
    stand = {}
    for name, sort in _SORTS.items():
        hulls = [Hull.of(prototype) for prototype in kinds[name]]
        stand[name], discs = strewn(rng, terrain, sort, counts[name], hulls, densities[name], discs)
    return stand


@dataclass(frozen=True, eq=False)
class _Habitat:
    """Where things like to stand: functions of x and z [m], from 0 never to 1."""

    seed: int
    terrain: Terrain

    def densities(self) -> dict[str, Density]:
        """For every kind of thing."""
        path_m = self.terrain.path_distance_m
        return {
            "house": lambda x, z: self._beside(x, z, 11.0, 22.0) * self._level(x, z),
            "tree": lambda x, z: self._beside(x, z, 2.4, _NEAR_M) * self._groves(x, z),
            "far tree": lambda x, z: self._beside(x, z, _NEAR_M, np.inf) * self._woods(x, z),
            "rock": lambda x, z: np.where(path_m(x, z) < 14, 1.0, 0.06),
            "stone": lambda x, z: self._beside(x, z, 0.0, 14.0),
            "bush": lambda x, z: np.where(path_m(x, z) < 12, 1.0, 0.08),
            "fern": lambda x, z: (
                self._beside(x, z, 0.0, 18.0) * np.maximum(1 - self.terrain.paint_at(x, z), 0)
            ),
            "grass": lambda x, z: self._meadow(x, z) * np.where(path_m(x, z) < 14, 1.0, 0.04),
        }

    def _beside(self, x: Array, z: Array, low_m: float, high_m: float) -> Array:
        distance_m = self.terrain.path_distance_m(x, z)
        return np.where((distance_m >= low_m) & (distance_m < high_m), 1.0, 0.0)

    def _groves(self, x: Array, z: Array) -> Array:
        return np.clip(0.65 + 0.4 * waves([self.seed, 21], x, z, (15.0, 60.0)), 0.15, 1)

    def _woods(self, x: Array, z: Array) -> Array:
        """Groves, and a dense edge of the world."""
        inside_m = self.terrain.extent_m / 2 - np.maximum(np.abs(x - CENTRE_M[0]), np.abs(z - CENTRE_M[1]))
        return np.where(inside_m < _EDGE_M, 1.0, 0.6 * self._groves(x, z))

    def _meadow(self, x: Array, z: Array) -> Array:
        """Where grass is painted, but not on the track."""
        paint = self.terrain.paint_at(x, z)
        return np.where(paint <= 1, paint, np.maximum(1.0 - 2.5 * (paint - 1), 0.0))

    def _level(self, x: Array, z: Array) -> Array:
        """Whether a house can stand there."""
        corners = [self.terrain.ground_m(x + dx, z + dz) for dx in (-5.0, 5.0) for dz in (-4.0, 4.0)]
        return np.where(np.ptp(corners, axis=0) < 1.1, 1.0, 0.0)
