"""Compiled: mip-mapped look-ups of tiles, and the reflectance and relief of surfaces."""

# mypy: disable-error-code=no-untyped-def

import math

import numpy as np

from flowlik.simulation.render._compile import inlined, kernel

_SIZE = 1024
_LEVELS = 11
_MOST_TAPS = 4
# a little sharper than a box filter asks for: the samples of a pixel blur the rest
_SHARPER = 0.84
_SCALE = np.float32(1.0 / 255.0)
_TURNS = np.array([[1.0, 0.0], [0.94, 0.35], [0.21, -0.98]])


@inlined
def _bilinear(pyramids, tile, offset, level, s, t):
    """Value 0 to 255 at (s, t) in periods on one level of a periodic tile."""
    n = _SIZE >> level
    x, y = s * n - 0.5, t * n - 0.5
    x0, y0 = math.floor(x), math.floor(y)
    fx, fy = np.float32(x - x0), np.float32(y - y0)
    i0, j0 = int(x0) & (n - 1), int(y0) & (n - 1)
    i1, j1 = (i0 + 1) & (n - 1), (j0 + 1) & (n - 1)
    upper, lower = offset + j0 * n, offset + j1 * n
    a, b = np.float32(pyramids[tile, upper + i0]), np.float32(pyramids[tile, upper + i1])
    c, d = np.float32(pyramids[tile, lower + i0]), np.float32(pyramids[tile, lower + i1])
    top = a + (b - a) * fx
    return top + (c + (d - c) * fx - top) * fy


@kernel
def look_up(pyramids, offsets, tile, rate, u, v, ux, vx, uy, vy):
    """Value 0 to 1 of a tile averaged over a pixel's footprint, long and thin if need be.

    rate is in tiles a metre; (u, v) in metres, and their steps to the next column (ux, vx) and row (uy, vy).
    """
    gain = rate * _SIZE
    along_x, along_y = math.sqrt(ux * ux + vx * vx) * gain, math.sqrt(uy * uy + vy * vy) * gain
    if along_x >= along_y:
        longer, shorter, du, dv = along_x, along_y, ux, vx
    else:
        longer, shorter, du, dv = along_y, along_x, uy, vy
    # a footprint within one texel needs one look-up
    taps = int(min(_MOST_TAPS, max(1.0, math.ceil(min(longer, longer / max(shorter, 1e-3))))))
    level = math.log2(max(_SHARPER * longer / taps, shorter, 1.0))
    if level >= _LEVELS - 1:
        return np.float32(pyramids[tile, offsets[_LEVELS - 1]]) * _SCALE
    fine = int(level)
    share = np.float32(level - fine)
    total = np.float32(0.0)
    for k in range(taps):
        step = (k + 0.5) / taps - 0.5
        s, t = (u + du * step) * rate, (v + dv * step) * rate
        value = _bilinear(pyramids, tile, offsets[fine], fine, s, t)
        if share > 0:
            value += share * (_bilinear(pyramids, tile, offsets[fine + 1], fine + 1, s, t) - value)
        total += value
    return total * (_SCALE / np.float32(taps))


@kernel
def slopes(pyramids, offsets, tile, rate, u, v, footprint):
    """Slopes (along u, along v) [1/m] of a tile's value 0 to 1, over a footprint [m]."""
    step = max(footprint, 1.0 / (rate * _SIZE))
    n = int(min(max(math.log2(step * rate * _SIZE), 0.0), _LEVELS - 3.0))
    offset, half = offsets[n], 0.5 * step * rate
    s, t = u * rate, v * rate
    along_u = _bilinear(pyramids, tile, offset, n, s + half, t) - _bilinear(
        pyramids, tile, offset, n, s - half, t
    )
    along_v = _bilinear(pyramids, tile, offset, n, s, t + half) - _bilinear(
        pyramids, tile, offset, n, s, t - half
    )
    return along_u * _SCALE / step, along_v * _SCALE / step


@inlined
def reflectance(looks, surface, u, v, ux, vx, uy, vy):
    """Reflectance of a surface at (u, v) [m]: its mean times the factor of every layer."""
    value = looks.reflectance[surface]
    for k in range(3):
        tile = looks.layer_tile[surface, k]
        if tile < 0:
            break
        # each layer is turned against the first, so that their periods do not line up
        c, s = _TURNS[k, 0], _TURNS[k, 1]
        tone = look_up(
            looks.pyramids, looks.level_offsets, tile, looks.layers[surface, k, 0],
            c * u + s * v, c * v - s * u, c * ux + s * vx, c * vx - s * ux, c * uy + s * vy, c * vy - s * uy,
        )  # fmt: skip
        value *= 1.0 + looks.layers[surface, k, 1] * (2.0 * tone - 1.0)
    return value
