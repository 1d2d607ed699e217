"""Tileable grey textures of what people build: asphalt, paving, walls, facades, roofs, paint, signs.

Rows of a wall's tile run upwards, as v does on upright faces. Sizes in the comments are those of the period
that each tile is meant for.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter, uniform_filter

from flowlik.simulation._noise import TILE_PX, Tile, noise, standardised


def _asphalt(rng: np.random.Generator) -> Tile:
    """Fine aggregate with weak stains; for a period of 1.5 to 4 m."""
    stones = standardised(noise(rng, TILE_PX, 0.35) + noise(rng, TILE_PX, 0.8))
    return _toned(0.5 + 0.19 * stones + 0.05 * noise(rng, TILE_PX, 1.7))


def _road_wear(rng: np.random.Generator) -> Tile:
    """Patches, sealed cracks and stains of a whole road; for a period of 15 to 25 m."""
    tile = 0.52 + 0.035 * noise(rng, TILE_PX, 1.6)
    for _ in range(7):
        size = rng.integers(60, 330, 2)
        _patch(tile, rng.integers(0, TILE_PX, 2), size, float(rng.uniform(-0.2, 0.14)))
    for _ in range(22):
        _draw_wrapped(tile, _crack(rng), float(rng.uniform(0.05, 0.3)), int(rng.integers(1, 4)))
    return _toned(tile)


def _concrete(rng: np.random.Generator) -> Tile:
    """Weak stains and pores; for a period of 2 to 5 m."""
    pores = noise(rng, TILE_PX, 0.2)
    return _toned(
        0.5 + 0.09 * noise(rng, TILE_PX, 1.5) + 0.05 * noise(rng, TILE_PX, 0.6) - 0.12 * (pores > 2.6)
    )


def _paving(rng: np.random.Generator) -> Tile:
    """Slabs of two sizes in courses with dark joints; 3 m hold 10 courses."""
    grain = 0.05 * noise(rng, TILE_PX, 0.5) + 0.06 * noise(rng, TILE_PX, 1.6)
    return _toned(_courses(rng, 10, 10, joint=0.035, tone=0.16, joint_grey=0.12) + grain)


def _plaster(rng: np.random.Generator) -> Tile:
    """Nearly even rough-cast with faint streaks; for a period of 2 to 6 m."""
    streaks = uniform_filter(noise(rng, TILE_PX, 1.0), (161, 1), mode="wrap")
    return _toned(0.5 + 0.06 * noise(rng, TILE_PX, 0.5) + 0.06 * noise(rng, TILE_PX, 1.7) + 0.02 * streaks)


def _brick(rng: np.random.Generator) -> Tile:
    """Stretcher bond with light mortar; 2 m hold 8 by 26 bricks."""
    grain = 0.05 * noise(rng, TILE_PX, 0.7) + 0.05 * noise(rng, TILE_PX, 1.6)
    return _toned(_courses(rng, 26, 8, joint=0.09, tone=0.3, joint_grey=0.8) - 0.06 + grain)


def _roof_tiles(rng: np.random.Generator) -> Tile:
    """Overlapping pantiles, rows running up the roof; 3 m hold 9 by 12."""
    row, column = np.mgrid[0:TILE_PX, 0:TILE_PX] / TILE_PX * np.array([9, 12])[:, None, None]
    up, across = row % 1, column % 1
    tone = rng.uniform(-0.14, 0.14, (9, 12))[row.astype(int), column.astype(int)]
    tile = 0.52 + tone + 0.14 * np.sin(2 * np.pi * across) - 0.3 * np.exp(-up / 0.06) - 0.06 * up
    return _toned(tile + 0.06 * noise(rng, TILE_PX, 0.9) + 0.08 * noise(rng, TILE_PX, 1.7))


def _facade(rng: np.random.Generator, style: str) -> Tile:
    """Plastered or brick wall of 2 storeys by 2 bays of windows; for a period of 6 m."""
    wall = 0.56 + 0.025 * noise(rng, TILE_PX, 0.6) + 0.03 * noise(rng, TILE_PX, 1.7)
    if style == "c":
        wall = 0.42 + 0.6 * (
            np.tile(cv2.resize(_brick(rng), None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA), (2, 2))
            - 0.42
        )
    if style == "b":  # string courses between the storeys
        wall[::512], wall[1:30], wall[512:542] = 0.2, 0.72, 0.72
    width, height = {"a": (210, 250), "b": (190, 290), "c": (250, 240)}[style]
    for storey in range(2):
        for bay in range(2):
            left, foot = bay * 512 + 256 - width // 2, storey * 512 + 150
            _window(wall, rng, left, foot, width, height, shutters=style == "a" and rng.random() < 0.7)
    return _toned(wall)


def _shopfront(rng: np.random.Generator) -> Tile:
    """Show windows between pillars, under lettered boards; for a period of 4 m, a storey high."""
    tile = 0.5 + 0.03 * noise(rng, TILE_PX, 1.2)
    for left in (40, 552):
        _window(tile, rng, left, 110, 430, 600, shutters=False)
        goods = rng.integers([left + 30, 150], [left + 400, 420], (14, 2))
        for u, v in goods:
            size = rng.integers(15, 60, 2)
            tile[v : v + size[1], u : min(u + size[0], left + 410)] = rng.uniform(0.05, 0.95)
    tile[770:960] = rng.uniform(0.15, 0.8)
    _letters(tile, rng, 800, 930)
    return _toned(tile)


def _car_paint(rng: np.random.Generator) -> Tile:
    """Almost even, with soft reflections in bands of height; for a period of 3 m."""
    bands = uniform_filter(noise(rng, TILE_PX, 1.5), (9, 257), mode="wrap")
    return _toned(0.5 + 0.05 * standardised(bands) + 0.012 * noise(rng, TILE_PX, 0.4))


def _glass(rng: np.random.Generator) -> Tile:
    """Dark panes that mirror soft shapes of sky and trees; for a period of 3 m."""
    soft = np.tanh(2 * noise(rng, TILE_PX, 1.7))
    return _toned(0.45 + 0.2 * soft + 0.02 * noise(rng, TILE_PX, 0.7))


def _posters(rng: np.random.Generator) -> Tile:
    """Signs and posters, 4 by 4 different ones; a sign shows one quarter of the period."""
    tile = np.full((TILE_PX, TILE_PX), 0.85, np.float32)
    for row in range(4):
        for column in range(4):
            _poster(tile[row * 256 : row * 256 + 256, column * 256 : column * 256 + 256], rng)
    return _toned(tile)


def _fence(rng: np.random.Generator) -> Tile:
    """Upright boards with dark gaps and two rails; 2 m hold 16 boards."""
    column = np.arange(TILE_PX) / TILE_PX * 16
    tone = 0.55 + rng.uniform(-0.12, 0.12, 16)[column.astype(int)]
    boards = np.where(column % 1 < 0.16, 0.06, tone)[None].repeat(TILE_PX, axis=0)
    grain = uniform_filter(noise(rng, TILE_PX, 0.5), (41, 1), mode="wrap")
    return _toned(boards + 0.08 * standardised(grain) + 0.03 * noise(rng, TILE_PX, 1.5))


def _hedge(rng: np.random.Generator) -> Tile:
    """Clipped small leaves, bright on dark gaps; for a period of 1.5 to 2 m."""
    tile = np.full((TILE_PX, TILE_PX), 0.1, np.float32)
    for centre, size, tilt, grey in zip(
        rng.uniform(0, TILE_PX, (4200, 2)),
        rng.uniform(7, 17, 4200),
        rng.uniform(0, 180, 4200),
        rng.uniform(0.1, 1.0, 4200) ** 1.3,
    ):
        outline = cv2.ellipse2Poly((0, 0), (int(size), int(size * 0.5)), int(tilt), 0, 360, 40)
        _fill_wrapped(tile, outline + np.rint(centre).astype(np.int32), float(grey))
    return _toned(tile + 0.04 * noise(rng, TILE_PX, 1.2))


BUILT_TILES: dict[str, Callable[[np.random.Generator], NDArray[np.float32]]] = {
    "asphalt": _asphalt,
    "road-wear": _road_wear,
    "concrete": _concrete,
    "paving": _paving,
    "plaster": _plaster,
    "brick": _brick,
    "roof-tiles": _roof_tiles,
    "facade-a": partial(_facade, style="a"),
    "facade-b": partial(_facade, style="b"),
    "facade-c": partial(_facade, style="c"),
    "shopfront": _shopfront,
    "car-paint": _car_paint,
    "glass": _glass,
    "posters": _posters,
    "fence": _fence,
    "hedge": _hedge,
}
"""Makers of tiles (TILE_PX, TILE_PX) within 0 to 1, whose opposite borders match."""


def _toned(tile: NDArray[np.floating]) -> Tile:
    return np.clip(tile, 0, 1).astype(np.float32)


def _courses(
    rng: np.random.Generator, rows: int, columns: int, joint: float, tone: float, joint_grey: float
) -> Tile:
    """Blocks in courses, every other one shifted by half a block; `joint` in shares of a course."""
    y, x = np.mgrid[0:TILE_PX, 0:TILE_PX] / TILE_PX
    row = (y * rows).astype(int)
    column = x * columns + 0.5 * (row % 2)
    tones = 0.5 + rng.uniform(-tone, tone, (rows, columns))[row, column.astype(int) % columns]
    edge_y, edge_x = (np.abs((place + 0.5) % 1 - 0.5) for place in (y * rows, column))
    in_joint = (edge_y < joint) | (edge_x < joint * columns / rows)
    blocks = np.where(in_joint, joint_grey, tones).astype(np.float32)
    return gaussian_filter(blocks, 0.8, mode="wrap")


def _patch(tile: Tile, corner: NDArray[np.integer], size: NDArray[np.integer], lift: float) -> None:
    rows, columns = ((c + np.arange(s)) % TILE_PX for c, s in zip(corner, size))
    tile[np.ix_(rows, columns)] += lift


def _crack(rng: np.random.Generator) -> NDArray[np.int32]:
    """Points (N, 2) of a crooked line that mostly keeps its direction, along or across the road."""
    headings = rng.choice([0.0, 0.5]) * np.pi + np.cumsum(rng.normal(0, 0.35, rng.integers(8, 45)))
    steps = rng.uniform(6, 16) * np.column_stack([np.sin(headings), np.cos(headings)])
    return np.rint(rng.uniform(0, TILE_PX, 2) + np.cumsum(steps, axis=0)).astype(np.int32)


_SHIFTS = [np.array([i, j], np.int32) * TILE_PX for i in (-1, 0, 1) for j in (-1, 0, 1)]


def _draw_wrapped(tile: Tile, points: NDArray[np.int32], grey: float, width_px: int) -> None:
    for shift in _SHIFTS:
        cv2.polylines(tile, [points + shift], False, grey, width_px)


def _fill_wrapped(tile: Tile, outline: NDArray[np.int32], grey: float) -> None:
    for shift in _SHIFTS:
        moved = outline + shift
        if (moved.max(axis=0) >= 0).all() and (moved.min(axis=0) < TILE_PX).all():
            cv2.fillConvexPoly(tile, moved, grey)


def _window(
    tile: Tile, rng: np.random.Generator, left: int, foot: int, width: int, height: int, shutters: bool
) -> None:
    """Draw a window: reveal, frame, panes with reflections, curtains or a blind, a sill, shutters."""

    def fill(u: int, v: int, du: int, dv: int, grey: float) -> None:
        tile[v : v + dv, u : u + du] = grey

    if shutters:
        leaf, grey = width // 2 - 8, float(rng.uniform(0.1, 0.35))
        for u in (left - leaf - 6, left + width + 6):
            fill(u, foot, leaf, height, grey)
            for v in range(foot + 8, foot + height - 8, 14):
                fill(u + 8, v, leaf - 16, 5, grey * 0.4)
    fill(left - 12, foot - 24, width + 24, 18, 0.85)  # sill
    fill(left - 12, foot - 34, width + 24, 10, 0.2)  # and its shadow
    fill(left, foot, width, height, 0.9)  # frame
    pane = rng.uniform(0.04, 0.22)
    frame = max(10, width // 18)
    for half in range(2):
        u, du = left + frame + half * (width // 2 - frame // 2), width // 2 - 3 * frame // 2
        fill(u, foot + frame, du, height - 2 * frame, pane)
        mirrored = pane + 0.1 * noise(rng, 64, 1.6)[: min(64, du)]
        tile[foot + frame : foot + height - frame, u : u + du] += cv2.resize(
            np.asarray(mirrored - pane, np.float32), (du, height - 2 * frame)
        )
        if rng.random() < 0.5:  # curtain
            fold = 0.55 + 0.12 * np.sin(np.arange(du // 2) / 5.0)
            tile[foot + frame : foot + height - frame, u : u + du // 2] = fold
    if rng.random() < 0.4:  # blind
        drop = int(height * rng.uniform(0.2, 0.6))
        fill(left + frame, foot + height - frame - drop, width - 2 * frame, drop, 0.7)
        for v in range(foot + height - frame - drop, foot + height - frame, 12):
            fill(left + frame, v, width - 2 * frame, 3, 0.5)


def _letters(tile: Tile, rng: np.random.Generator, low: int, high: int) -> None:
    ink = 0.95 if tile[low, 0] < 0.5 else 0.05
    u = 60
    while u < TILE_PX - 120:
        du = int(rng.integers(25, 70))
        bars = rng.random((3, 2)) < 0.7
        for i, j in np.argwhere(bars):
            v = low + i * (high - low) // 3
            tile[v : v + (high - low) // 3 - 8, u + j * du // 2 : u + j * du // 2 + du // 2 - 6] = ink
        u += du + (60 if rng.random() < 0.2 else 10)


def _poster(part: Tile, rng: np.random.Generator) -> None:
    grounds = rng.permutation([0.05, 0.3, 0.6, 0.95])
    part[:] = grounds[0]
    cv2.rectangle(part, (14, 14), (241, 241), float(grounds[1]), -1)
    for _ in range(3):
        centre = tuple(int(c) for c in rng.integers(60, 196, 2))
        axes = tuple(int(a) for a in rng.integers(15, 70, 2))
        tilt, grey = float(rng.uniform(0, 180)), float(rng.choice(grounds[2:]))
        cv2.ellipse(part, centre, axes, tilt, 0, 360, grey, -1)
    for v in rng.integers(40, 210, 3):
        cv2.rectangle(part, (40, int(v)), (int(rng.integers(120, 215)), int(v) + 9), float(grounds[3]), -1)
