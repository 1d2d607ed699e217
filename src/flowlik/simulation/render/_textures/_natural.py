"""Tileable grey textures of nature: ground, bark, rock, leaves, crowns seen from afar, clouds.

Noise gives them detail at every scale, overlapping shapes their edges. Sizes in the comments are those of the
period that each tile is meant for.
"""

from __future__ import annotations

from collections.abc import Callable

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.fft import irfft2

from flowlik.simulation._noise import TILE_PX, Tile, noise, standardised
from flowlik.support.arrays import Array

_CENTRES = np.array([[i, j] for i in (-1, 0, 1) for j in (-1, 0, 1)]) * TILE_PX


def _litter(rng: np.random.Generator) -> Tile:
    """Fallen leaves of all greys over each other, with twigs; for a period of 1.5 to 2.5 m."""
    ground = 70 + 22 * noise(rng, TILE_PX, 1.2)
    count = 4600
    places, sizes, tilts = _strewn(rng, count, (11, 34), (0.3, 0.7))
    outlines = _turned(_LEAF, places, sizes, tilts)
    greys = 255 * rng.beta(1.5, 2.2, count)
    # each leaf: the shadow it casts, its two halves
    shapes = np.stack([outlines + np.array([2.0, 3.0]), outlines, _half(outlines)], axis=1)
    tones = np.stack([0.25 * greys, greys, greys * rng.uniform(0.65, 0.95, count)], axis=1)
    tile = _painted(ground, shapes.reshape(-1, *outlines.shape[1:]), tones.ravel())
    twigs = _turned(_BLADE, *_strewn(rng, 300, (25, 90), (0.02, 0.04)))
    tile = _painted(tile, twigs, rng.uniform(20, 170, 300))
    return _toned(tile + 12 * noise(rng, TILE_PX, 0.9), 0.55)


def _grass(rng: np.random.Generator) -> Tile:
    """Bent blades on dark ground, the lower ones darker; for a period of 1.5 to 2.5 m."""
    ground = 50 + 20 * noise(rng, TILE_PX, 1.3)
    count = 9000
    places, sizes, _ = _strewn(rng, count, (14, 50), (0.05, 0.1))
    tilts = rng.normal(0, 0.7, count) + rng.choice([0.0, 2.1, 4.2], count)
    greys = np.linspace(0, 130, count) + rng.uniform(0, 125, count)
    tile = _painted(ground, _turned(_BLADE, places, sizes, tilts), greys)
    return _toned(tile + 14 * noise(rng, TILE_PX, 1.2) + 6 * noise(rng, TILE_PX, 0.5), 0.5)


def _earth(rng: np.random.Generator) -> Tile:
    """Trodden soil: weak stains, few pebbles; for a period of 2 to 4 m."""
    soil = 128 + 14 * noise(rng, TILE_PX, 1.4) + 4 * noise(rng, TILE_PX, 0.5)
    pebbles = _turned(_stone(rng), *_strewn(rng, 420, (2, 9), (0.6, 1.0)))
    return _toned(_painted(soil, pebbles, rng.normal(128, 28, 420)), 0.28)


def _gravel(rng: np.random.Generator) -> Tile:
    """Stones on stones with a light and a dark side; for a period of 1 to 2 m."""
    ground = 70 + 20 * noise(rng, TILE_PX, 1.2)
    count = 6500
    places, sizes, tilts = _strewn(rng, count, (7, 32), (0.6, 1.0))
    outlines = _turned(_stone(rng), places, sizes, tilts)
    greys = rng.uniform(60, 215, count)
    # each stone: its shadow, its body, its lit top
    tops = outlines.mean(axis=1, keepdims=True) * 0.45 + outlines * 0.55 - 0.18 * sizes[:, None, :1]
    shapes = np.stack([outlines + 0.2 * sizes[:, None, :1], outlines, tops], axis=1)
    tones = np.stack([0.3 * greys, greys, np.minimum(1.18 * greys, 255)], axis=1)
    tile = _painted(ground, shapes.reshape(-1, *outlines.shape[1:]), tones.ravel())
    return _toned(tile + 10 * noise(rng, TILE_PX, 1.0), 0.5)


def _bark(rng: np.random.Generator) -> Tile:
    """Ridges that split and join along the trunk, which runs down the rows; for a period of 0.8 to 1.2 m."""
    coarse, fine = _stretched_noise(rng, 1.9, 6.0, 14), _stretched_noise(rng, 1.5, 3.5, 30)
    furrows = np.sqrt(np.abs(coarse) + 0.02) + 0.35 * np.sqrt(np.abs(fine) + 0.02)
    return _toned(standardised(furrows) + 0.3 * fine + 0.45 * noise(rng, TILE_PX, 1.1), 0.6)


def _bark_conifer(rng: np.random.Generator) -> Tile:
    """Plates, longer along the trunk, between dark cracks; for a period of 0.8 to 1.2 m."""
    plate, inside = _cells(rng, 520, stretch=2)
    tone = rng.uniform(-1, 1, 521)[plate]
    soft = noise(rng, TILE_PX, 1.3)
    cracks = np.exp(-((inside / (5.0 + 3.0 * np.tanh(soft))) ** 2)) * (0.75 + 0.45 * np.tanh(2 * soft))
    scales = _stretched_noise(rng, 1.1, 0.4, 6)
    return _toned(0.55 * tone - 1.6 * cracks + 0.3 * np.minimum(inside / 25, 1) + 0.45 * scales, 0.5)


def _rock(rng: np.random.Generator) -> Tile:
    """Weathered stone with cracks and lichen; for a period of 1 to 2 m."""
    grain = noise(rng, TILE_PX, 1.15)
    block, inside = _cells(rng, 30, stretch=1)
    cracks = np.exp(-((inside / 2.2) ** 2)) * np.clip(noise(rng, TILE_PX, 1.8) + 0.3, 0, 1)
    spots = _turned(_stone(rng), *_strewn(rng, 700, (3, 34), (0.6, 1.0)))
    lichen = _painted(np.full(grain.shape, 128), spots, rng.choice([100.0, 145.0, 190.0], 700)) - 128
    return _toned(grain + 0.3 * rng.uniform(-1, 1, 31)[block] - 1.8 * cracks + 0.012 * lichen, 0.5)


def _leaf(rng: np.random.Generator) -> Tile:
    """Weak veins; for a period of 0.1 to 0.3 m."""
    _, inside = _cells(rng, 900, stretch=1)
    return _toned(0.6 * np.exp(-((inside / 2.5) ** 2)) + noise(rng, TILE_PX, 1.4), 0.3)


def _moss(rng: np.random.Generator) -> Tile:
    """Cushions of small tufts; for a period of 0.8 to 2 m."""
    cushion, inside = _cells(rng, 240, stretch=1)
    height = np.minimum(inside / 30, 1) + 0.5 * rng.uniform(-1, 1, 241)[cushion]
    return _toned(height + 0.7 * noise(rng, TILE_PX, 0.75), 0.5)


def _canopy(rng: np.random.Generator) -> Tile:
    """Crowns of a wood seen from afar, lit from the top rows; for a period of 40 to 70 m."""
    count, boughs = 620, 22
    places, sizes, _ = _strewn(rng, count, (30, 60), (0.9, 1.3))
    # crowns further down the tile stand in front; each is a heap of boughs, lighter upwards
    order = np.argsort(places[:, 1])
    places, sizes = places[order], sizes[order]
    height = np.sort(rng.uniform(0, 1, (count, boughs)), axis=1)
    around = rng.uniform(-1, 1, (count, boughs)) * np.sqrt(1.05 - height)
    middles = places[:, None] + np.stack([around, 0.8 - 1.6 * height], axis=-1) * sizes[:, None]
    grey = rng.uniform(0.7, 1.3, (count, 1)) * (35 + 130 * height) * rng.uniform(0.75, 1.25, height.shape)
    size = np.repeat(sizes, boughs, axis=0) * rng.uniform(0.12, 0.34, (count * boughs, 1))
    tilts = rng.uniform(0, 2 * np.pi, count * boughs)
    shapes = _turned(_stone(rng), middles.reshape(-1, 2), size, tilts)
    tile = _painted(30 + 12 * noise(rng, TILE_PX, 1.2), shapes, np.clip(grey.ravel(), 0, 255))
    return _toned(tile + 20 * noise(rng, TILE_PX, 0.7), 0.5)


def _macro(rng: np.random.Generator) -> Tile:
    """Soft spots of every size, 1/f^2; for a period of 10 to 100 m."""
    return _toned(noise(rng, TILE_PX, 1.6), 0.55)


def _clouds(rng: np.random.Generator) -> Tile:
    """Cover of the sky, 0 clear to 1 cloud."""
    return _toned(noise(rng, TILE_PX, 1.5) - 0.15 * np.abs(noise(rng, TILE_PX, 1.1)), 0.9)


NATURAL_TILES: dict[str, Callable[[np.random.Generator], Tile]] = {
    "litter": _litter,
    "grass": _grass,
    "earth": _earth,
    "gravel": _gravel,
    "bark": _bark,
    "bark-conifer": _bark_conifer,
    "rock": _rock,
    "leaf": _leaf,
    "moss": _moss,
    "canopy": _canopy,
    "macro": _macro,
    "clouds": _clouds,
}
"""Makers of tiles (TILE_PX, TILE_PX) within 0 to 1, whose opposite borders match."""

_TURN = np.linspace(0, 2 * np.pi, 13)[:-1]
# outlines in units of a half length along the first axis and a half width along the second
_LEAF = np.column_stack(
    [np.cos(_TURN), np.sin(_TURN) * (1 - 0.3 * np.cos(_TURN)) * np.sqrt(np.abs(np.sin(_TURN)) + 0.02)]
)
_ALONG = np.linspace(-1, 1, 6)
_BLADE = np.concatenate(
    [
        np.column_stack([_ALONG, (1 - _ALONG) / 2 + 1.6 * _ALONG**2]),
        np.column_stack([_ALONG, -(1 - _ALONG) / 2 + 1.6 * _ALONG**2])[::-1],
    ]
)


def _toned(values: NDArray[np.floating], contrast: float) -> Tile:
    """Tile of mean a half; tanh bounds the values without clipping much."""
    tile = 0.5 * np.tanh(contrast * standardised(values))
    return np.clip(tile - tile.mean() + 0.5, 0, 1).astype(np.float32)


def _stone(rng: np.random.Generator) -> Array:
    """Irregular outline (12, 2) about 1 in radius."""
    waves = rng.normal(0, 0.09, (3, 2))
    orders = np.arange(2, 5)[:, None] * _TURN
    radius = 1 + waves[:, 0] @ np.cos(orders) + waves[:, 1] @ np.sin(orders)
    return radius[:, None] * np.column_stack([np.cos(_TURN), np.sin(_TURN)])


def _strewn(
    rng: np.random.Generator, count: int, size_px: tuple[float, float], flatness: tuple[float, float]
) -> tuple[Array, Array, Array]:
    """Places (N, 2) [px], half lengths and half widths (N, 2) [px], mostly small, and tilts (N,) [rad]."""
    low, high = size_px
    length = 1 / np.sqrt(rng.uniform(1 / high**2, 1 / low**2, count))
    sizes = np.column_stack([length, length * rng.uniform(*flatness, count)])
    return rng.uniform(0, TILE_PX, (count, 2)), sizes, rng.uniform(0, 2 * np.pi, count)


def _turned(outline: Array, places: Array, sizes: Array, tilts: Array) -> Array:
    """Copies (N, K, 2) [px] of an outline (K, 2), scaled, turned and moved."""
    x, y = np.moveaxis(outline * sizes[:, None], -1, 0)
    c, s = np.cos(tilts)[:, None], np.sin(tilts)[:, None]
    return np.stack([c * x - s * y, s * x + c * y], axis=-1) + places[:, None]


def _half(outlines: Array) -> Array:
    """One side of leaves (N, K, 2), K even, as outlines of as many points."""
    side = np.arange(outlines.shape[1])
    return outlines[:, np.minimum(side, outlines.shape[1] // 2)]


def _painted(ground: NDArray[np.floating], outlines: Array, greys: Array) -> NDArray[np.float32]:
    """Ground (TILE_PX, TILE_PX), 0 to 255, with outlines (N, K, 2) [px] filled over it in their order."""
    # OpenCV's smooth edges are wrong at the picture's border, so that is cut off
    rim, shift_bits = 4, 4
    image = np.pad(np.clip(ground, 0, 255).astype(np.uint8), rim, mode="wrap")
    low, high = outlines.min(axis=1)[:, None] + _CENTRES, outlines.max(axis=1)[:, None] + _CENTRES
    fixed_point = np.rint((outlines + rim) * 2**shift_bits).astype(np.int32)
    shifts = (_CENTRES * 2**shift_bits).astype(np.int32)
    # what crosses a border is drawn again a tile further, so that opposite borders match
    for shape, shift in np.argwhere(((low < TILE_PX + rim) & (high > -rim)).all(axis=-1)):
        points = fixed_point[shape] + shifts[shift]
        cv2.fillPoly(image, [points], int(greys[shape]), cv2.LINE_AA, shift_bits)
    return image[rim:-rim, rim:-rim].astype(np.float32)


def _cells(rng: np.random.Generator, count: int, stretch: int) -> tuple[NDArray[np.int32], Tile]:
    """Cell 1 to N of every texel and the distance [px] to its border; cells are longer down the rows."""
    rows, margin = TILE_PX // stretch, 128
    seeds = np.ones((rows, TILE_PX), np.uint8)
    places = rng.choice(rows * TILE_PX, count, replace=False)
    seeds.ravel()[places] = 0
    numbers = np.zeros(seeds.shape, np.int32)
    numbers.ravel()[places] = np.arange(1, count + 1)
    waver = 9 * np.stack([noise(rng, TILE_PX // 4, 1.6) for _ in range(2)])
    wide = np.pad(seeds, margin, mode="wrap")
    _, nearest = cv2.distanceTransformWithLabels(wide, cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL)
    # OpenCV numbers the seeds of the padded picture in its own order; ours repeat with the tile
    own = np.zeros(nearest.max() + 1, np.int32)
    own[nearest[wide == 0]] = np.pad(numbers, margin, mode="wrap")[wide == 0]
    labels = own[nearest][margin:-margin, margin:-margin]
    labels = cv2.resize(labels.astype(np.float32), (TILE_PX, TILE_PX), interpolation=cv2.INTER_NEAREST)
    x, y = np.meshgrid(np.arange(TILE_PX), np.arange(TILE_PX))
    shift_x, shift_y = (_enlarged(part) for part in waver)
    labels = labels[(y + shift_y.astype(int)) % TILE_PX, (x + shift_x.astype(int)) % TILE_PX].astype(np.int32)
    border = (labels != np.roll(labels, 1, axis=0)) | (labels != np.roll(labels, 1, axis=1))
    wide = np.pad(np.where(border, 0, 1).astype(np.uint8), margin, mode="wrap")
    inside = cv2.distanceTransform(wide, cv2.DIST_L2, 5)[margin:-margin, margin:-margin]
    return labels, inside.astype(np.float32)


def _enlarged(small: Tile) -> Tile:
    """Tile of full size by interpolation of a small one that repeats."""
    factor, margin = TILE_PX // len(small), 2
    wide = np.pad(small, margin, mode="wrap")
    size = len(wide) * factor
    large = cv2.resize(wide, (size, size), interpolation=cv2.INTER_LINEAR)
    return np.asarray(
        large[margin * factor : -margin * factor, margin * factor : -margin * factor], np.float32
    )


def _stretched_noise(rng: np.random.Generator, exponent: float, stretch: float, lowest: int) -> Tile:
    """Gaussian field as `noise`, `stretch` times longer down the rows, without less than `lowest` cycles."""
    cycles = np.arange(TILE_PX // 2 + 1, dtype=np.float32)
    down = np.concatenate([cycles[:-1], -cycles[:0:-1]]) * np.float32(stretch)
    squared = (down**2)[:, None] + cycles**2
    amplitude = np.where(squared >= lowest**2, np.maximum(squared, 1) ** np.float32(-exponent / 2), 0)
    parts = rng.standard_normal((*squared.shape, 2), dtype=np.float32)
    return standardised(irfft2((parts[..., 0] + 1j * parts[..., 1]) * amplitude, s=(TILE_PX, TILE_PX)))
