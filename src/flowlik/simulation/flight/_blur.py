"""Compiled kernel of the motion blur; no fastmath, so that every machine computes the same."""

# mypy: disable-error-code=no-untyped-def

import math

import numpy as np
from numba import njit

SHORTEST_PX = 0.1
"""A shorter way blurs by less than a thousandth of a squared pixel: the pixel is kept."""

MOST_TAPS = 64


@njit(cache=True, error_model="numpy")
def _cubic_weights(f):
    """Catmull-Rom weights of the four samples around a fraction f between the middle two."""
    first = ((-0.5 * f + 1.0) * f - 0.5) * f
    last = (0.5 * f - 0.5) * f * f
    third = ((-1.5 * f + 2.0) * f + 0.5) * f
    return first, 1.0 - first - third - last, third, last


@njit(cache=True, error_model="numpy")
def _cubic(image, u, v):
    """Value at (u, v), which unlike a bilinear one is not blurred by the interpolation itself."""
    height, width = image.shape
    u0, v0 = math.floor(u), math.floor(v)
    across, down = _cubic_weights(u - u0), _cubic_weights(v - v0)
    i0, i1, i2, i3 = u0 - 1, u0, u0 + 1, u0 + 2
    j0, j1, j2, j3 = v0 - 1, v0, v0 + 1, v0 + 2
    if i0 < 0 or i3 >= width or j0 < 0 or j3 >= height:
        i0, i1, i2, i3 = _within(i0, width), _within(i1, width), _within(i2, width), _within(i3, width)
        j0, j1, j2, j3 = _within(j0, height), _within(j1, height), _within(j2, height), _within(j3, height)
    return (
        down[0] * _line(image, j0, i0, i1, i2, i3, across)
        + down[1] * _line(image, j1, i0, i1, i2, i3, across)
        + down[2] * _line(image, j2, i0, i1, i2, i3, across)
        + down[3] * _line(image, j3, i0, i1, i2, i3, across)
    )


@njit(cache=True, error_model="numpy")
def _line(image, j, i0, i1, i2, i3, weights):
    return (
        weights[0] * image[j, i0]
        + weights[1] * image[j, i1]
        + weights[2] * image[j, i2]
        + weights[3] * image[j, i3]
    )


@njit(cache=True, error_model="numpy")
def _within(i, size):
    return min(max(i, 0), size - 1)


@njit(cache=True, nogil=True, error_model="numpy")
def blur_rows(first, last, radiance, depth, movers, camera, rotations, translations, blurred):
    """Average rows first to last of radiance (H, W) along each pixel's way, into blurred (H, W).

    Parameters
    ----------
    first, last : int
        First row, and the row after the last.
    radiance, depth, movers : arrays (H, W)
        As in `flowlik.simulation._base.Frame`; movers -1 everywhere if nothing moves.
    camera : array (4,)
        fx, fy, cx, cy [px].
    rotations, translations : arrays (1 + M, 3, 3), (1 + M, 3)
        Motion of points in the camera [m] over the exposure: of the static world, then of each mover.
    blurred : array (H, W)
        Written. Where the way has no end in front of the camera, the pixel is kept.
    """
    fx, fy, cx, cy = camera
    for v in range(first, last):
        for u in range(radiance.shape[1]):
            R, t = rotations[movers[v, u] + 1], translations[movers[v, u] + 1]
            x, y, w = (u - cx) / fx, (v - cy) / fy, 1.0 / depth[v, u]
            Z = R[2, 0] * x + R[2, 1] * y + R[2, 2] + t[2] * w
            way_u = fx * (R[0, 0] * x + R[0, 1] * y + R[0, 2] + t[0] * w) / Z + cx - u
            way_v = fy * (R[1, 0] * x + R[1, 1] * y + R[1, 2] + t[1] * w) / Z + cy - v
            length = math.sqrt(way_u * way_u + way_v * way_v)
            if not (Z > 0 and SHORTEST_PX < length < np.inf):
                blurred[v, u] = radiance[v, u]
                continue
            count = min(math.ceil(length) + 1, MOST_TAPS)
            # so spaced, the taps have the variance of the whole line, way^2 / 12
            step = 1.0 / math.sqrt(count * count - 1.0)
            total = 0.0
            for i in range(count):
                along = (i - 0.5 * (count - 1)) * step
                total += _cubic(radiance, u + along * way_u, v + along * way_v)
            blurred[v, u] = total / count
