"""Tileable grey textures of surfaces by name, mip-mapped, the same for the same seed."""

from __future__ import annotations

import zlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from flowlik.errors import DataError
from flowlik.simulation._noise import TILE_PX, pyramid
from flowlik.simulation.render._textures._built import BUILT_TILES
from flowlik.simulation.render._textures._natural import NATURAL_TILES
from flowlik.support.threads import in_bands

TILES: dict[str, Callable[[np.random.Generator], NDArray[np.float32]]] = {**NATURAL_TILES, **BUILT_TILES}
"""Makers of tiles (TILE_PX, TILE_PX) within 0 to 1, mean about a half, whose opposite borders match."""


@dataclass(frozen=True, eq=False)
class Tiles:
    """Tiles and their mip levels, flattened for the kernels.

    Attributes
    ----------
    names : tuple of str
        Name of each tile.
    pyramids : array (T, P) uint8
        Mip levels of each tile one after another, finest first; 0 to 255 stands for 0 to 1.
    level_offsets : array (levels,) int64
        Where each level starts in a row of `pyramids`; level l has ``(TILE_PX >> l)**2`` texels.
    """

    names: tuple[str, ...]
    pyramids: NDArray[np.uint8]
    level_offsets: NDArray[np.int64]


def make_tiles(seed: int, names: Sequence[str]) -> Tiles:
    """Make tiles by name; each is drawn from the seed and its own name, whichever others are made.

    Raises
    ------
    DataError
        If a name is unknown.
    """
    unknown = sorted(set(names) - set(TILES))
    if unknown:
        raise DataError(f"unknown texture {unknown[0]!r}: known are {', '.join(sorted(TILES))}")
    return _make_tiles(seed, tuple(names))


@lru_cache(maxsize=4)
def _make_tiles(seed: int, names: tuple[str, ...]) -> Tiles:
    sizes = np.array([(TILE_PX >> level) ** 2 for level in range(TILE_PX.bit_length())])
    offsets = np.concatenate([[0], np.cumsum(sizes)[:-1]]).astype(np.int64)
    pyramids = np.empty((len(names), sizes.sum()), np.uint8)

    def work(first: int, last: int) -> None:
        for i in range(first, last):
            rng = np.random.default_rng([seed, zlib.crc32(names[i].encode())])
            pyramids[i] = np.rint(pyramid(TILES[names[i]](rng)) * 255)

    in_bands(work, len(names), 1)
    return Tiles(names, pyramids, offsets)
