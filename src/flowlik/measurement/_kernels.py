"""Compiled kernels of signals; their plain numpy twins stand in the tests."""

from __future__ import annotations

import numpy as np
from numba import njit

from flowlik.image.patches import copy_patch

# intensity^2/px^2 added to a patch's S: where it is flat, rounding of grey levels alone gives 9 px
FLAT = 1e-3


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


@njit(cache=True, inline="always")
def _inside(image, u, v, half):  # type: ignore[no-untyped-def]
    """Whether a patch around (u, v) and the pixel beyond it lie in an image."""
    return half <= u < image.shape[1] - half - 1 and half <= v < image.shape[0] - half - 1


@njit(cache=True, inline="always")
def _grey_row(image, u, v, size, row):  # type: ignore[no-untyped-def]
    """Bilinear grey values at `size` pixels from (u, v) on to the right, all within the image."""
    u0, v0 = int(u), int(v)
    a, b = u - u0, v - v0
    above, below = image[v0, u0 : u0 + size + 1], image[v0 + 1, u0 : u0 + size + 1]
    above_next, below_next = above[1:], below[1:]
    for k in range(size):
        top = (1 - a) * above[k] + a * above_next[k]
        bottom = (1 - a) * below[k] + a * below_next[k]
        row[k] = (1 - b) * top + b * bottom


@njit(cache=True, nogil=True)
def patch_residual(previous, current, pixels, flow, window, first, last, residual):  # type: ignore[no-untyped-def]
    """Mean absolute difference of the patches at both ends of vectors first to last, but their means'."""
    half, size = window // 2, window * window
    differences, start, end = np.empty(size), np.empty(window), np.empty(window)
    for i in range(first, last):
        u, v = pixels[i, 0], pixels[i, 1]
        x, y = u + flow[i, 0], v + flow[i, 1]
        whole = _inside(previous, u, v, half) and _inside(current, x, y, half)
        mean, k = 0.0, 0
        for dv in range(-half, half + 1):
            if whole:
                _grey_row(previous, u - half, v + dv, window, start)
                _grey_row(current, x - half, y + dv, window, end)
            else:
                for du in range(-half, half + 1):
                    start[du + half] = _grey(previous, u + du, v + dv)
                    end[du + half] = _grey(current, x + du, y + dv)
            for j in range(window):
                differences[k] = end[j] - start[j]
                mean += differences[k]
                k += 1
        mean /= size
        total = 0.0
        for k in range(size):
            total += abs(differences[k] - mean)
        residual[i] = total / size


@njit(cache=True, nogil=True, fastmath={"contract", "reassoc"})
def _scores(end, a, b, start, gx, gy, width, scores_x, scores_y):  # type: ignore[no-untyped-def]
    """Gradient times residual of every pixel of a patch, at fractions (a, b) of `end`, in rows of `width`."""
    n = len(scores_x)
    e00, e01, e10, e11 = end[:n], end[1 : n + 1], end[width : n + width], end[width + 1 : n + width + 1]
    for k in range(n):
        top, bottom = (1 - a) * e00[k] + a * e01[k], (1 - a) * e10[k] + a * e11[k]
        residual = (1 - b) * top + b * bottom - start[k]
        scores_x[k], scores_y[k] = gx[k] * residual, gy[k] * residual


@njit(cache=True, nogil=True, fastmath={"contract", "reassoc"})
def _block_products(scores_x, scores_y, gx, gy, blocks, width):  # type: ignore[no-untyped-def]
    """Sums of products: of the scores of 3 x 3 px blocks, and of gradients, each as (xx, xy, yy)."""
    B_xx = B_xy = B_yy = xx = xy = yy = 0.0
    column_x, column_y = np.empty(width), np.empty(width)
    for row in range(blocks):
        first = 3 * row * width
        for k in range(width):
            i, j, m = first + k, first + width + k, first + 2 * width + k
            column_x[k] = scores_x[i] + scores_x[j] + scores_x[m]
            column_y[k] = scores_y[i] + scores_y[j] + scores_y[m]
        for k in range(0, 3 * blocks, 3):
            x = column_x[k] + column_x[k + 1] + column_x[k + 2]
            y = column_y[k] + column_y[k + 1] + column_y[k + 2]
            B_xx += x * x
            B_xy += x * y
            B_yy += y * y
    for k in range(3 * blocks * width):
        xx += gx[k] * gx[k]
        xy += gx[k] * gy[k]
        yy += gy[k] * gy[k]
    return (B_xx, B_xy, B_yy), (xx, xy, yy)


@njit(cache=True, nogil=True)
def standard_errors(previous, current, gx, gy, pixels, flow, blocks, first, last, M):  # type: ignore[no-untyped-def]
    """Sandwich S^-1 (sum_b s_b s_b^T + S / 12) S^-1 of vectors first to last of M (N, 3) = (xx, xy, yy).

    s_b are sums of gradient times residual over `blocks` x `blocks` squares of 3 x 3 px around the nearest
    whole pixel, S the sum of gradient products; gx, gy are 32 times the derivative.
    """
    height, width = previous.shape
    size, half = 3 * blocks, 3 * blocks // 2
    # rows of whole vectors of the processor; gradients beyond the blocks are 0
    room = (size + 1 + 7) // 8 * 8
    n = size * room
    end, start, x, y = np.zeros(n + room + 1), np.zeros(n), np.zeros(n), np.zeros(n)
    g_x, g_y = np.zeros(n), np.zeros(n)
    for i in range(first, last):
        u0, v0 = int(np.rint(pixels[i, 0])), int(np.rint(pixels[i, 1]))
        x0, y0 = u0 + flow[i, 0], v0 + flow[i, 1]
        if _inside(previous, u0, v0, room - half) and _inside(current, x0, y0, room - half):
            a, b = x0 - int(x0), y0 - int(y0)
            copy_patch(current, int(y0) - half, int(x0) - half, size + 1, room, end)
            copy_patch(previous, v0 - half, u0 - half, size, room, start)
            copy_patch(gx, v0 - half, u0 - half, size, room, g_x)
            copy_patch(gy, v0 - half, u0 - half, size, room, g_y)
            for row in range(size):
                for k in range(row * room + size, (row + 1) * room):
                    g_x[k] = g_y[k] = 0.0
            _scores(end, a, b, start, g_x, g_y, room, x, y)
        else:
            for row in range(size):
                v = min(max(v0 - half + row, 0), height - 1)
                for column in range(size):
                    u, k = min(max(u0 - half + column, 0), width - 1), row * room + column
                    residual = _grey(current, x0 - half + column, y0 - half + row) - previous[v, u]
                    g_x[k], g_y[k] = gx[v, u], gy[v, u]
                    x[k], y[k] = g_x[k] * residual, g_y[k] * residual
                for k in range(row * room + size, (row + 1) * room):
                    g_x[k] = g_y[k] = x[k] = y[k] = 0.0
        B, S = _block_products(x, y, g_x, g_y, blocks, room)
        # gradients were 32 times too large
        xx, xy, yy = S[0] / 1024 + FLAT, S[1] / 1024, S[2] / 1024 + FLAT
        B_xx, B_xy, B_yy = B[0] / 1024 + xx / 12, B[1] / 1024 + xy / 12, B[2] / 1024 + yy / 12
        determinant = xx * yy - xy * xy
        # rows of the inverse
        p, q, r = yy / determinant, -xy / determinant, xx / determinant
        M[i, 0] = p * p * B_xx + 2 * p * q * B_xy + q * q * B_yy
        M[i, 1] = p * q * B_xx + (p * r + q * q) * B_xy + q * r * B_yy
        M[i, 2] = q * q * B_xx + 2 * q * r * B_xy + r * r * B_yy
