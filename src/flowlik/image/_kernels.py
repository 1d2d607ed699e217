"""Compiled kernels of texture and signals; their plain numpy twins stand in the tests."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from flowlik.support.arrays import Array

# intensity^2/px^2 added to a patch's S: where it is flat, rounding of grey levels alone gives 9 px
FLAT = 1e-3


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


@njit(cache=True, inline="always")
def _grey(image, u, v):  # type: ignore[no-untyped-def]
    """Bilinear grey value, clamped to the outermost pixel centres."""
    u = min(max(u, 0.0), image.shape[1] - 1.0)
    v = min(max(v, 0.0), image.shape[0] - 1.0)
    u0, v0 = min(int(u), image.shape[1] - 2), min(int(v), image.shape[0] - 2)
    a, b = u - u0, v - v0
    top = (1 - a) * image[v0, u0] + a * image[v0, u0 + 1]
    bottom = (1 - a) * image[v0 + 1, u0] + a * image[v0 + 1, u0 + 1]
    return (1 - b) * top + b * bottom


@njit(cache=True, nogil=True)
def patch_residual(previous, current, pixels, flow, window, first, last, residual):  # type: ignore[no-untyped-def]
    """Mean absolute difference of the patches at both ends of vectors first to last, but their means'."""
    half, size = window // 2, window * window
    differences = np.empty(size)
    for i in range(first, last):
        mean, k = 0.0, 0
        for dv in range(-half, half + 1):
            for du in range(-half, half + 1):
                u, v = pixels[i, 0] + du, pixels[i, 1] + dv
                end = _grey(current, u + flow[i, 0], v + flow[i, 1])
                differences[k] = end - _grey(previous, u, v)
                mean += differences[k]
                k += 1
        mean /= size
        total = 0.0
        for k in range(size):
            total += abs(differences[k] - mean)
        residual[i] = total / size


@njit(cache=True, nogil=True)
def standard_errors(previous, current, gx, gy, pixels, flow, blocks, first, last, M):  # type: ignore[no-untyped-def]
    """Sandwich S^-1 (sum_b s_b s_b^T + S / 12) S^-1 of vectors first to last of M (N, 3) = (xx, xy, yy).

    s_b are sums of gradient times residual over `blocks` x `blocks` squares of 3 x 3 px around the nearest
    whole pixel, S the sum of gradient products; gx, gy are 32 times the derivative.
    """
    height, width = previous.shape
    half = 3 * blocks // 2
    for i in range(first, last):
        u0, v0 = int(np.rint(pixels[i, 0])), int(np.rint(pixels[i, 1]))
        xx, xy, yy = FLAT, 0.0, FLAT
        B_xx, B_xy, B_yy = 0.0, 0.0, 0.0
        for block in range(blocks * blocks):
            first_u, first_v = 3 * (block % blocks) - half, 3 * (block // blocks) - half
            x, y = 0.0, 0.0
            for dv in range(first_v, first_v + 3):
                v = min(max(v0 + dv, 0), height - 1)
                for du in range(first_u, first_u + 3):
                    u = min(max(u0 + du, 0), width - 1)
                    end = _grey(current, u0 + du + flow[i, 0], v0 + dv + flow[i, 1])
                    residual = end - previous[v, u]
                    g_x, g_y = gx[v, u] / 32.0, gy[v, u] / 32.0
                    xx += g_x * g_x
                    xy += g_x * g_y
                    yy += g_y * g_y
                    x += g_x * residual
                    y += g_y * residual
            B_xx += x * x
            B_xy += x * y
            B_yy += y * y
        B_xx += xx / 12
        B_xy += xy / 12
        B_yy += yy / 12
        determinant = xx * yy - xy * xy
        # rows of the inverse
        p, q, r = yy / determinant, -xy / determinant, xx / determinant
        M[i, 0] = p * p * B_xx + 2 * p * q * B_xy + q * q * B_yy
        M[i, 1] = p * q * B_xx + (p * r + q * q) * B_xy + q * r * B_yy
        M[i, 2] = q * q * B_xx + 2 * q * r * B_xy + r * r * B_yy


@njit(cache=True, nogil=True)
def energy_centres(gx, gy, pixels, half, first, last, centres):  # type: ignore[no-untyped-def]
    """Centres of gx^2 + gy^2 in the windows around pixels first to last; the pixel where it is all zero."""
    height, width = gx.shape
    for i in range(first, last):
        u, v = int(np.rint(pixels[i, 0])), int(np.rint(pixels[i, 1]))
        total, along_u, along_v = 0.0, 0.0, 0.0
        for y in range(max(v - half, 0), min(v + half + 1, height)):
            row, row_u = 0.0, 0.0
            for x in range(max(u - half, 0), min(u + half + 1, width)):
                energy = float(gx[y, x]) ** 2 + float(gy[y, x]) ** 2
                row += energy
                row_u += energy * (x - u)
            total += row
            along_u += row_u
            along_v += row * (y - v)
        scale = 1.0 / total if total > 0 else 0.0
        centres[i, 0] = min(max(pixels[i, 0] + along_u * scale, 0.0), width - 1.0)
        centres[i, 1] = min(max(pixels[i, 1] + along_v * scale, 0.0), height - 1.0)


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
