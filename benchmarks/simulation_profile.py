"""Where a picture's time goes: stages timed from outside, and the tiles' kernel taken apart."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np

from flowlik.simulation import SimulatedSequence
from flowlik.simulation.render import _scene as scene
from flowlik.simulation.render._compile import kernel
from flowlik.simulation.render._raster import frame as raster
from flowlik.simulation.render._raster._visibility import SAMPLES, TILE, clear, draw

STAGES = [
    ("image", SimulatedSequence, "image"),
    ("frame", SimulatedSequence, "frame"),
    ("selection", scene.Scene, "drawn"),
    ("projection", raster, "_project"),
    ("binning", raster, "_bin"),
    ("raster", scene, "render_frame"),
]


def profile(sequence: SimulatedSequence, frames: range) -> dict[str, float]:
    """Shares of a picture's time, and how much there is to draw, over frames next to one another."""
    sequence.image(frames[0] - 1)
    seconds: dict[str, float] = {}
    with timed_stages(seconds):
        for k in frames:
            sequence.image(k)
    tiles = seconds["raster"] - seconds["projection"] - seconds["binning"]
    tile_work(sequence, frames[:1])  # compiles
    work = tile_work(sequence, frames[:3])
    own = {
        "selection": seconds["selection"],
        "geometry": seconds["projection"],
        "tiling": seconds["binning"],
        "visibility": tiles * work["visibility"],
        "shading": tiles * (1 - work["visibility"]),
        "sensor": seconds["image"] - seconds["frame"],
    }
    own["world"] = seconds["image"] - sum(own.values())
    shares = {f"share_{name}": value / seconds["image"] for name, value in own.items()}
    return {**shares, **{name: value for name, value in work.items() if name != "visibility"}}


@contextmanager
def timed_stages(seconds: dict[str, float]) -> Iterator[None]:
    """Add up the seconds spent in the stages of a picture; some run inside others."""
    kept = [(owner, name, getattr(owner, name)) for _, owner, name in STAGES]

    def timed(stage, function):
        def call(*arguments, **named):
            start = time.perf_counter()
            try:
                return function(*arguments, **named)
            finally:
                seconds[stage] = seconds.get(stage, 0.0) + time.perf_counter() - start

        return call

    for (stage, owner, name), (_, _, function) in zip(STAGES, kept):
        setattr(owner, name, timed(stage, function))
    try:
        yield
    finally:
        for owner, name, function in kept:
            setattr(owner, name, function)


def tile_work(sequence: SimulatedSequence, frames: range) -> dict[str, float]:
    """Share of the tiles' time that visibility takes, by doing it again alone, and what there is to draw."""
    whole, lock = raster.render_tiles, threading.Lock()
    totals = np.zeros(5)  # seconds of visibility and of all; fragments, list entries, triangles

    def apart(first, last, buffers, starts, lists, screen, *others):
        height, width = others[-1].shape
        start = time.perf_counter()
        fragments = only_visible(first, last, buffers, starts, lists, screen, height, width)
        middle = time.perf_counter()
        whole(first, last, buffers, starts, lists, screen, *others)
        end = time.perf_counter()
        with lock:
            entries = starts[last] - starts[first]
            totals[:4] += middle - start, end - middle, fragments, entries
            if first == 0:
                totals[4] += len(np.unique(lists))

    raster.render_tiles = apart
    try:
        pixels = 0
        for k in frames:
            pixels += sequence.world.render(sequence.T_n_c(k), sequence.camera).depth.size
    finally:
        raster.render_tiles = whole
    return {
        "visibility": totals[0] / totals[1],
        "fragments_per_pixel": totals[2] / pixels,
        "triangles_per_tile_mean": totals[3] * TILE**2 / pixels,
        "triangles_in_view": totals[4] / len(frames),
    }


@kernel
def only_visible(first, last, buffers, starts, lists, screen, height, width):
    """Do what `render_tiles` does before it shades; return how many shadings the pixels would need."""
    across = (width + TILE - 1) // TILE
    fragments, seen = 0, buffers.seen
    for tile in range(first, last):
        left, top = (tile % across) * TILE, (tile // across) * TILE
        columns, rows = min(TILE, width - left), min(TILE, height - top)
        clear(buffers)
        for j in range(starts[tile], starts[tile + 1]):
            draw(lists[j], screen, left, top, columns, rows, buffers, True)
        for v in range(rows):
            for u in range(columns):
                for k in range(SAMPLES):
                    is_new = True
                    for j in range(k):
                        is_new &= seen[v * TILE + u, j] != seen[v * TILE + u, k]
                    fragments += is_new
    return fragments
