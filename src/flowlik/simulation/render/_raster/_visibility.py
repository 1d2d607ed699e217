"""Compiled: which triangle each of a pixel's samples sees, tile by tile of the picture."""

# mypy: disable-error-code=no-untyped-def

import math
from typing import NamedTuple

import numpy as np

from flowlik.simulation.render._compile import inlined, kernel
from flowlik.simulation.render._prototypes import Floats
from flowlik.simulation.render._raster.packed import Ints32
from flowlik.support.arrays import Array

TILE = 32
SAMPLES = 16

# triangles of at most so many pixels each way are looked at before they are set up; with slack for rounding
SMALL = 4
SLACK = 1e-4

# sixteen rooks: one sample in each of 16 columns and rows of the pixel
_ROOKS = np.array([
    (7, 2), (13, 5), (3, 8), (9, 11), (1, 1), (5, 14), (11, 0), (15, 9),
    (2, 12), (8, 6), (14, 13), (0, 5), (6, 9), (12, 3), (4, 4), (10, 15),
])  # fmt: skip
OFFSETS_X = ((_ROOKS[:, 0] + 0.5) / 16 - 0.5).astype(np.float32)
OFFSETS_Y = ((_ROOKS[:, 1] + 0.5) / 16 - 0.5).astype(np.float32)


# caches of compiled kernels name it: under another name they could not be read
class Buffers(NamedTuple):
    """What one thread writes on while it draws a tile of P pixels.

    Positive floats are ordered as their bits are, and the least of many whole numbers is found at once.
    """

    nearest: Floats  # (P, SAMPLES) inverse depth of every sample [1/m]
    nearest_bits: Ints32  # (P, SAMPLES) the same memory as whole numbers
    seen: Ints32  # (P, SAMPLES) triangle of every sample, -1 for none
    farthest: Floats  # (P,) least inverse depth over a pixel's samples: what lies behind it is hidden
    farthest_bits: Ints32  # (P,) the same memory as whole numbers
    centre_w: Array  # (P,) inverse depth of the pixel's centre [1/m]
    centre_seen: Ints32  # (P,) triangle of the pixel's centre, -1 for none
    who: Ints32  # (SAMPLES,) the triangles that one pixel sees,
    how_many: Array  # (SAMPLES,) in how many of its samples,
    mean_x: Array  # (SAMPLES,) and the sums of these samples' places
    mean_y: Array  # (SAMPLES,)


def make_buffers() -> Buffers:
    """Buffers for one thread."""
    nearest, farthest = np.empty((TILE * TILE, SAMPLES), np.float32), np.empty(TILE * TILE, np.float32)
    return Buffers(
        nearest,
        nearest.view(np.int32),
        np.empty((TILE * TILE, SAMPLES), np.int32),
        farthest,
        farthest.view(np.int32),
        np.empty(TILE * TILE),
        np.empty(TILE * TILE, np.int32),
        np.empty(SAMPLES, np.int32),
        *np.empty((3, SAMPLES)),
    )


@inlined
def _tile_range(screen, i, size, axis):
    """First and last tile that triangle i touches along an axis (0 column, 1 row) of some size [px]."""
    low = min(screen[i, axis], min(screen[i, axis + 3], screen[i, axis + 6]))
    high = max(screen[i, axis], max(screen[i, axis + 3], screen[i, axis + 6]))
    # clipped before the conversion: corners near the camera may be millions of pixels away
    first = math.floor(min(max(low, 0.0), size - 1.0) + 0.5) // TILE
    last = math.floor(min(max(high, 0.0), size - 1.0) + 0.5) // TILE
    return first, min(last, (size - 1) // TILE)


@kernel
def count_in_tiles(first, last, screen, width, height, counts):
    """Count triangles first to last in each tile (counts: (tiles,))."""
    across = (width + TILE - 1) // TILE
    for i in range(first, last):
        x0, x1 = _tile_range(screen, i, width, 0)
        y0, y1 = _tile_range(screen, i, height, 1)
        for y in range(y0, y1 + 1):
            for x in range(x0, x1 + 1):
                counts[y * across + x] += 1


@kernel
def list_in_tiles(first, last, screen, width, height, places, lists):
    """Write triangles first to last into the lists of their tiles, from places (tiles,) on."""
    across = (width + TILE - 1) // TILE
    for i in range(first, last):
        x0, x1 = _tile_range(screen, i, width, 0)
        y0, y1 = _tile_range(screen, i, height, 1)
        for y in range(y0, y1 + 1):
            for x in range(x0, x1 + 1):
                tile = y * across + x
                lists[places[tile]] = i
                places[tile] += 1


@kernel
def clear(buffers):
    """Empty a tile: nothing is seen."""
    buffers.nearest[:], buffers.seen[:], buffers.farthest[:] = 0.0, -1, 0.0
    buffers.centre_w[:], buffers.centre_seen[:] = 0.0, -1


@inlined
def draw(i, screen, left, top, columns, rows, buffers, samples):
    """Draw triangle i into a tile whose first pixel is (left, top).

    Without `samples`, only what the pixels' centres see.
    """
    nearest, seen, farthest = buffers.nearest, buffers.seen, buffers.farthest
    nearest_bits, farthest_bits = buffers.nearest_bits, buffers.farthest_bits
    centre_w, centre_seen = buffers.centre_w, buffers.centre_seen
    who = np.int32(i)
    x0, y0, w0 = np.float64(screen[i, 0]), np.float64(screen[i, 1]), np.float64(screen[i, 2])
    x1, y1, w1 = np.float64(screen[i, 3]), np.float64(screen[i, 4]), np.float64(screen[i, 5])
    x2, y2, w2 = np.float64(screen[i, 6]), np.float64(screen[i, 7]), np.float64(screen[i, 8])
    u_first = max(0, math.floor(max(min(x0, min(x1, x2)) - left, -1.0) + 0.5))
    u_last = min(columns - 1, math.floor(min(max(x0, max(x1, x2)) - left, columns + 1.0) + 0.5))
    v_first = max(0, math.floor(max(min(y0, min(y1, y2)) - top, -1.0) + 0.5))
    v_last = min(rows - 1, math.floor(min(max(y0, max(y1, y2)) - top, rows + 1.0) + 0.5))
    if u_first > u_last or v_first > v_last:
        return
    if u_last - u_first < SMALL and v_last - v_first < SMALL:
        # most triangles are small and lie behind what is there already
        nearest_w, hidden = max(w0, max(w1, w2)) * (1.0 + SLACK), True
        for v in range(v_first, v_last + 1):
            for u in range(u_first, u_last + 1):
                pixel = v * TILE + u
                hidden &= (nearest_w < farthest[pixel]) & (nearest_w < centre_w[pixel])
        if hidden:
            return
    area = (x1 - x0) * (y2 - y0) - (x2 - x0) * (y1 - y0)
    if area == 0.0:
        return
    # barycentric coordinates and inverse depth are linear on the screen
    inverse = 1.0 / area
    a0, c0 = (y1 - y2) * inverse, (x2 - x1) * inverse
    a1, c1 = (y2 - y0) * inverse, (x0 - x2) * inverse
    a2, c2 = (y0 - y1) * inverse, (x1 - x0) * inverse
    aw, cw = a0 * w0 + a1 * w1 + a2 * w2, c0 * w0 + c1 * w1 + c2 * w2
    e0, e1, e2 = 0.5 * (abs(a0) + abs(c0)), 0.5 * (abs(a1) + abs(c1)), 0.5 * (abs(a2) + abs(c2))
    ew = 0.5 * (abs(aw) + abs(cw))
    A0, A1, A2, AW = np.float32(a0), np.float32(a1), np.float32(a2), np.float32(aw)
    C0, C1, C2, CW = np.float32(c0), np.float32(c1), np.float32(c2), np.float32(cw)
    zero = np.float32(0.0)
    for v in range(v_first, v_last + 1):
        y = v + top
        for u in range(u_first, u_last + 1):
            x = u + left
            b0 = a0 * (x - x1) + c0 * (y - y1)
            b1 = a1 * (x - x2) + c1 * (y - y2)
            b2 = a2 * (x - x0) + c2 * (y - y0)
            if b0 < -e0 or b1 < -e1 or b2 < -e2:
                continue
            pixel = v * TILE + u
            w = w0 + aw * (x - x0) + cw * (y - y0)
            if b0 >= 0.0 and b1 >= 0.0 and b2 >= 0.0 and w > centre_w[pixel]:
                centre_w[pixel], centre_seen[pixel] = w, i
            if not samples or w + ew < farthest[pixel]:
                continue
            B0, B1, B2, W = np.float32(b0), np.float32(b1), np.float32(b2), np.float32(w)
            for k in range(SAMPLES):
                dx, dy = OFFSETS_X[k], OFFSETS_Y[k]
                ww = W + AW * dx + CW * dy
                covered = (
                    (B0 + A0 * dx + C0 * dy >= zero)
                    & (B1 + A1 * dx + C1 * dy >= zero)
                    & (B2 + A2 * dx + C2 * dy >= zero)
                    & (ww > nearest[pixel, k])
                )
                nearest[pixel, k] = ww if covered else nearest[pixel, k]
                seen[pixel, k] = who if covered else seen[pixel, k]
            least = nearest_bits[pixel, 0]
            for k in range(1, SAMPLES):
                least = min(least, nearest_bits[pixel, k])
            farthest_bits[pixel] = least
