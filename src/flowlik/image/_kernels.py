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


@njit(cache=True, inline="always")
def _copy(image, row, column, rows, width, out):  # type: ignore[no-untyped-def]
    """Copy a rectangle of an image into rows, one after the other."""
    # an index without a sign needs no check for one, which would keep processors from copying many at once
    first_row, first, k = np.uint64(row), np.uint64(column), np.uint64(0)
    for y in range(rows):
        for x in range(width):
            out[k + np.uint64(x)] = image[first_row + np.uint64(y), first + np.uint64(x)]
        k += np.uint64(width)


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
            _copy(current, int(y0) - half, int(x0) - half, size + 1, room, end)
            _copy(previous, v0 - half, u0 - half, size, room, start)
            _copy(gx, v0 - half, u0 - half, size, room, g_x)
            _copy(gy, v0 - half, u0 - half, size, room, g_y)
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


@njit(cache=True, nogil=True, fastmath={"contract", "reassoc"})
def _energies(gx, gy):  # type: ignore[no-untyped-def]
    """Sum of gx^2 + gy^2 along a row, and of that times the place; exact, since all are whole numbers."""
    total, along = 0.0, 0.0
    for k in range(len(gx)):
        a, b = float(gx[k]), float(gy[k])
        energy = a * a + b * b
        total += energy
        along += energy * k
    return total, along


@njit(cache=True, nogil=True)
def energy_centres(gx, gy, pixels, half, first, last, centres):  # type: ignore[no-untyped-def]
    """Centres of gx^2 + gy^2 in the windows around pixels first to last; the pixel where it is all zero."""
    height, width = gx.shape
    for i in range(first, last):
        u, v = int(np.rint(pixels[i, 0])), int(np.rint(pixels[i, 1]))
        left, right = max(u - half, 0), min(u + half + 1, width)
        total, along_u, along_v = 0.0, 0.0, 0.0
        for y in range(max(v - half, 0), min(v + half + 1, height)):
            row, row_u = _energies(gx[y, left:right], gy[y, left:right])
            total += row
            along_u += row_u + row * (left - u)
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
