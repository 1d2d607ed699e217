"""Noise from which tiles are made, and their mip levels."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.fft import irfft2

TILE_PX = 1024
"""Size of a tile, a power of two."""

Tile = NDArray[np.float32]
"""Grey tile (TILE_PX, TILE_PX) whose opposite borders match."""


def noise(rng: np.random.Generator, size_px: int, exponent: float) -> NDArray[np.float32]:
    """Gaussian field whose amplitude spectrum falls as frequency to the power -exponent."""
    cycles = np.arange(size_px // 2 + 1, dtype=np.float32)
    squared = (np.concatenate([cycles[:-1], -cycles[:0:-1]]) ** 2)[:, None] + cycles**2
    squared[0, 0] = np.inf
    parts = rng.standard_normal((*squared.shape, 2), dtype=np.float32)
    spectrum = (parts[..., 0] + 1j * parts[..., 1]) * squared ** np.float32(-exponent / 2)
    return standardised(irfft2(spectrum, s=(size_px, size_px)))


def standardised(values: NDArray[np.floating] | NDArray[np.uint8]) -> NDArray[np.float32]:
    """Values of mean 0 and standard deviation 1, as float32."""
    return ((values - values.mean()) / values.std()).astype(np.float32)


def pyramid(tile: NDArray[np.float32]) -> NDArray[np.float32]:
    """All levels of a square tile, halved by averaging 2x2 texels down to one, flattened into one row."""
    levels = [tile]
    while levels[-1].size > 1:
        fine = levels[-1]
        halved = (fine[::2, ::2] + fine[1::2, ::2] + fine[::2, 1::2] + fine[1::2, 1::2]) / 4
        levels.append(halved.astype(np.float32))
    return np.concatenate([level.ravel() for level in levels])
