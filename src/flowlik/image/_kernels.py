"""Compiled kernels of texture and of maps read between pixels; their plain numpy twins stand in the tests."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from flowlik.support.arrays import Array


@njit(cache=True, nogil=True)
def box_products(gx, gy, window, first, last, S):  # type: ignore[no-untyped-def]
    """Mean over a window of gradient products, rows first to last of S (H, W, 3).

    gx, gy are int16, padded by window // 2, 32 times the derivative. Sums run along columns and rows in
    integers, so that they are exact.
    """
    width = gx.shape[1] - window + 1
    scale = 1.0 / (window * window * 32.0 * 32.0)
    columns = np.zeros((gx.shape[1], 3), np.int64)
    for v in range(first, first + window - 1):
        for u in range(gx.shape[1]):
            a, b = np.int64(gx[v, u]), np.int64(gy[v, u])
            columns[u, 0] += a * a
            columns[u, 1] += a * b
            columns[u, 2] += b * b
    for v in range(first, last):
        for u in range(gx.shape[1]):
            a, b = np.int64(gx[v + window - 1, u]), np.int64(gy[v + window - 1, u])
            columns[u, 0] += a * a
            columns[u, 1] += a * b
            columns[u, 2] += b * b
        xx, xy, yy = np.int64(0), np.int64(0), np.int64(0)
        for u in range(window - 1):
            xx += columns[u, 0]
            xy += columns[u, 1]
            yy += columns[u, 2]
        for u in range(width):
            xx += columns[u + window - 1, 0]
            xy += columns[u + window - 1, 1]
            yy += columns[u + window - 1, 2]
            S[v, u, 0] = xx * scale
            S[v, u, 1] = xy * scale
            S[v, u, 2] = yy * scale
            xx -= columns[u, 0]
            xy -= columns[u, 1]
            yy -= columns[u, 2]
        for u in range(gx.shape[1]):
            c, d = np.int64(gx[v, u]), np.int64(gy[v, u])
            columns[u, 0] -= c * c
            columns[u, 1] -= c * d
            columns[u, 2] -= d * d


@njit(cache=True, inline="always")
def _mirrored(i, size):  # type: ignore[no-untyped-def]
    """Index within an axis mirrored at its outermost pixels, for one not far beyond them."""
    i = abs(i)
    return i if i < size else 2 * (size - 1) - i


@njit(cache=True, nogil=True)
def tensors_at(gx, gy, pixels, window, first, last, S):  # type: ignore[no-untyped-def]
    """`box_products` and `bilinear` of it at pixels first to last: S (N, 3), the same to the last bit.

    gx, gy are without a border.
    """
    height, width = gx.shape
    half, scale = window // 2, 1.0 / (window * window * 32.0 * 32.0)
    sums, corners = np.empty((window + 1, 2, 3), np.int64), np.empty((2, 2, 3))
    rows, columns = np.empty(window + 1, np.int64), np.empty(window + 1, np.int64)
    for i in range(first, last):
        u = min(max(pixels[i, 0], 0.0), width - 1.0)
        v = min(max(pixels[i, 1], 0.0), height - 1.0)
        u0, v0 = min(int(u), width - 2), min(int(v), height - 2)
        for k in range(window + 1):
            rows[k], columns[k] = _mirrored(v0 - half + k, height), _mirrored(u0 - half + k, width)
        for k in range(window + 1):
            xx, xy, yy = np.int64(0), np.int64(0), np.int64(0)
            for j in range(window):
                a, b = np.int64(gx[rows[k], columns[j]]), np.int64(gy[rows[k], columns[j]])
                xx += a * a
                xy += a * b
                yy += b * b
            sums[k, 0, 0], sums[k, 0, 1], sums[k, 0, 2] = xx, xy, yy
            # one column further
            a, b = np.int64(gx[rows[k], columns[0]]), np.int64(gy[rows[k], columns[0]])
            e, f = np.int64(gx[rows[k], columns[window]]), np.int64(gy[rows[k], columns[window]])
            sums[k, 1, 0] = xx - a * a + e * e
            sums[k, 1, 1] = xy - a * b + e * f
            sums[k, 1, 2] = yy - b * b + f * f
        for x in range(2):
            for c in range(3):
                total = np.int64(0)
                for k in range(window):
                    total += sums[k, x, c]
                corners[0, x, c] = total * scale
                corners[1, x, c] = (total - sums[0, x, c] + sums[window, x, c]) * scale
        for c in range(3):
            S[i, c] = _between(corners, 0, 0, u - u0, v - v0, c)


@njit(cache=True, nogil=True)
def eigen_2x2(S, first, last, t, R):  # type: ignore[no-untyped-def]
    """Eigenvalues t (N, 2), larger first, and rotations R (N, 2, 2) of rows of S (N, 3) = (xx, xy, yy)."""
    for i in range(first, last):
        xx, xy, yy = S[i, 0], S[i, 1], S[i, 2]
        half = 0.5 * (xx - yy)
        r = np.sqrt(half * half + xy * xy)
        larger = 0.5 * (xx + yy) + r
        c, s = 1.0, 0.0
        # half-angle formulas on the side that does not cancel
        if r > 1e-12 * larger:
            if half >= 0:
                c = np.sqrt(0.5 * (r + half) / r)
                s = 0.5 * xy / (r * c)
            else:
                s = np.sqrt(0.5 * (r - half) / r)
                c = 0.5 * xy / (r * s)
        t[i, 0] = larger
        t[i, 1] = min(max((xx * yy - xy * xy) / larger, 0.0), larger) if larger > 0 else 0.0
        R[i, 0, 0], R[i, 0, 1], R[i, 1, 0], R[i, 1, 1] = c, -s, s, c


@njit(cache=True, inline="always")
def _between(S, u0, v0, a, b, c):  # type: ignore[no-untyped-def]
    """Channel c at the fractions (a, b) of the cell whose first corner is (u0, v0)."""
    top = (1 - a) * S[v0, u0, c] + a * S[v0, u0 + 1, c]
    bottom = (1 - a) * S[v0 + 1, u0, c] + a * S[v0 + 1, u0 + 1, c]
    return (1 - b) * top + b * bottom


@njit(cache=True)
def bilinear(S: NDArray[np.floating], pixels: Array) -> Array:
    """Sample channels (H, W, C) at pixels (N, 2), clamped to the outermost pixel centres."""
    height, width, channels = S.shape
    out = np.empty((len(pixels), channels))
    for i in range(len(pixels)):
        u = min(max(pixels[i, 0], 0.0), width - 1.0)
        v = min(max(pixels[i, 1], 0.0), height - 1.0)
        u0, v0 = min(int(u), width - 2), min(int(v), height - 2)
        a, b = u - u0, v - v0
        for c in range(channels):
            out[i, c] = _between(S, u0, v0, a, b, c)
    return out


@njit(cache=True, nogil=True)
def surface(field, pixels, relative, absolute):  # type: ignore[no-untyped-def]
    """Sample channels (H, W, C) at pixels (N, 2), bilinear where the four around agree, else the nearest."""
    height, width, channels = field.shape
    out = np.empty((len(pixels), channels))
    for i in range(len(pixels)):
        u = min(max(pixels[i, 0], 0.0), width - 1.0)
        v = min(max(pixels[i, 1], 0.0), height - 1.0)
        u0, v0 = min(int(u), width - 2), min(int(v), height - 2)
        near = field[int(np.rint(v)), int(np.rint(u))]
        a, b = u - u0, v - v0
        size = 0.0
        for c in range(channels):
            size += near[c] * near[c]
        tolerance, agree = relative * np.sqrt(size) + absolute, True
        for c in range(channels):
            for y in range(v0, v0 + 2):
                for x in range(u0, u0 + 2):
                    # not ">": NaN agrees with nothing
                    agree = agree and abs(field[y, x, c] - near[c]) <= tolerance
        for c in range(channels):
            out[i, c] = _between(field, u0, v0, a, b, c) if agree else near[c]
    return out


@njit(cache=True, nogil=True, error_model="numpy")
def inverse_surface(depth, pixels, relative):  # type: ignore[no-untyped-def]
    """`surface` of 1 / depth (H, W), without an absolute tolerance: of the four pixels around each alone."""
    height, width = depth.shape
    out, corners = np.empty(len(pixels)), np.empty((2, 2, 1))
    for i in range(len(pixels)):
        u = min(max(pixels[i, 0], 0.0), width - 1.0)
        v = min(max(pixels[i, 1], 0.0), height - 1.0)
        u0, v0 = min(int(u), width - 2), min(int(v), height - 2)
        near = 1.0 / np.float64(depth[int(np.rint(v)), int(np.rint(u))])
        tolerance, agree = relative * np.sqrt(near * near), True
        for y in range(2):
            for x in range(2):
                corners[y, x, 0] = 1.0 / np.float64(depth[v0 + y, u0 + x])
                # not ">": NaN agrees with nothing
                agree = agree and abs(corners[y, x, 0] - near) <= tolerance
        out[i] = _between(corners, 0, 0, u - u0, v - v0, 0) if agree else near
    return out
