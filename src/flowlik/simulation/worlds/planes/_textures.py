"""Procedural, tileable, mip-mapped grey textures, the same for the same seed."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

from flowlik.simulation._noise import TILE_PX, noise, pyramid, standardised

CONTRAST_PX = 256
TILES = 6
CONTRAST_MAPS = 3


@dataclass(frozen=True, eq=False)
class Textures:
    """Texture tiles and contrast maps, flattened for the rendering kernels.

    Attributes
    ----------
    pyramids : array (tiles, P) float32
        Mip levels of each tile one after another, finest first; values within -1 to 1.
    level_offsets : array (levels,) int64
        Where each level starts in a row of `pyramids`; level l has ``(tile_px >> l)**2`` texels.
    contrasts : array (maps, CONTRAST_PX**2) float32
        Smooth factors within 0 to 1, over two decades: where they are small, texture fades to almost nothing.
    tile_px : int
        Size of the finest level, a power of two.
    """

    pyramids: NDArray[np.float32]
    level_offsets: NDArray[np.int64]
    contrasts: NDArray[np.float32]
    tile_px: int


@lru_cache(maxsize=2)
def make_textures(seed: int) -> Textures:
    """Textures of a seed: each tile mixes 1/f noise, overlapping shapes and warped stripes its own way."""
    rng = np.random.default_rng(seed)
    tiles = [_tile(rng, kind % 3) for kind in range(TILES)]
    return pack_textures(tiles, [_contrast_map(rng) for _ in range(CONTRAST_MAPS)])


def pack_textures(tiles: list[NDArray[np.float32]], contrasts: list[NDArray[np.float32]]) -> Textures:
    """Textures of tiles of one size, a power of two, and of contrast maps (CONTRAST_PX, CONTRAST_PX)."""
    tile_px = len(tiles[0])
    sizes = np.array([(tile_px >> level) ** 2 for level in range(tile_px.bit_length())])
    offsets = np.concatenate([[0], np.cumsum(sizes)[:-1]]).astype(np.int64)
    pyramids = np.stack([pyramid(tile) for tile in tiles])
    return Textures(pyramids, offsets, np.stack([m.ravel() for m in contrasts]), tile_px)


def _tile(rng: np.random.Generator, kind: int) -> NDArray[np.float32]:
    """Tile (TILE_PX, TILE_PX) within -1 to 1; mostly of one kind: 0 noise, 1 shapes, 2 stripes."""
    shares = rng.dirichlet(np.where(np.arange(3) == kind, 6.0, 1.5))
    where_striped = 1 / (1 + np.exp(-3 * noise(rng, TILE_PX, exponent=2.5)))
    mixture = shares[0] * noise(rng, TILE_PX, exponent=rng.uniform(0.9, 1.3)) + shares[1] * _shapes(rng)
    mixture += shares[2] * where_striped * _stripes(rng)
    # tanh bounds the values without clipping, so no pixel ever saturates
    return np.tanh(standardised(mixture)).astype(np.float32)


def _shapes(rng: np.random.Generator, count: int = 3000) -> NDArray[np.float32]:
    """Opaque rectangles and ellipses, one over another, of power-law sizes: edges of every orientation."""
    radius_px = 4.0 / np.sqrt(rng.uniform((4 / 200) ** 2, 1, count))
    flatness, tilt = rng.uniform(0.1, 1, count), rng.uniform(0, np.pi, count)
    corners = np.where(rng.random(count) < 0.6, 4, 24)
    grey = rng.integers(0, 256, count)
    # every outline has 24 points; a rectangle's corners are repeated
    turn = (np.arange(24) * corners[:, None] // 24 + 0.5) * 2 * np.pi / corners[:, None]
    outline = (
        radius_px[:, None]
        * (np.cos(turn) + 1j * flatness[:, None] * np.sin(turn))
        * np.exp(1j * tilt)[:, None]
    )
    points = np.stack([outline.real, outline.imag], axis=-1) + rng.uniform(0, TILE_PX, (count, 1, 2))
    image, shift_bits = np.full((TILE_PX, TILE_PX), 128, dtype=np.uint8), 4
    # what crosses a border is drawn again a tile further, so that opposite borders match
    shifts = TILE_PX * np.array([[i, j] for i in (-1, 0, 1) for j in (-1, 0, 1)])
    low, high = points.min(axis=1)[:, None] + shifts, points.max(axis=1)[:, None] + shifts
    for shape, shift in np.argwhere(((low < TILE_PX) & (high > 0)).all(axis=-1)):
        fixed_point = np.rint((points[shape] + shifts[shift]) * 2**shift_bits).astype(np.int32)
        cv2.fillPoly(image, [fixed_point], int(grey[shape]), cv2.LINE_AA, shift_bits)
    return standardised(image)


def _stripes(rng: np.random.Generator) -> NDArray[np.float32]:
    """Slightly warped stripes of one random orientation, soft or with sharp edges."""
    cycles, direction = np.exp(rng.uniform(*np.log([10, 80]))), rng.uniform(0, np.pi)
    # whole numbers of cycles across the tile, so that opposite borders match
    cycles_x, cycles_y = np.rint([cycles * np.cos(direction), cycles * np.sin(direction)])
    place = 2 * np.pi * np.arange(TILE_PX) / TILE_PX
    phase = (cycles_y * place)[:, None] + cycles_x * place + 1.5 * noise(rng, TILE_PX, exponent=2.5)
    return standardised(np.tanh(rng.uniform(0.5, 6) * np.sin(phase)))


def _contrast_map(rng: np.random.Generator) -> NDArray[np.float32]:
    """Contrast (CONTRAST_PX, CONTRAST_PX), near 1 over most of the map and falling smoothly to 5e-3."""
    field = noise(rng, CONTRAST_PX, exponent=2.2)
    return (10 ** (-2.3 / (1 + np.exp(-4 * (field - 0.8))))).astype(np.float32)
