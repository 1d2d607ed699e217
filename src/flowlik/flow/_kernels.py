"""Compiled kernels of flow: Horn-Schunck, patches tracked and where they stand; their twins are in tests."""

from __future__ import annotations

import numpy as np
from numba import njit

from flowlik.image.patches import copy_patch

# OpenCV's limits, in units of (intensity / px)^2: a patch below them says nothing of its motion
LEAST_EIGENVALUE, LEAST_DETERMINANT = 1.024e-4, 0.125
# two steps that cancel to this [px] go to and fro
TO_AND_FRO_PX = 0.01
LOST_AT = -(1 << 30)


@njit(cache=True, nogil=True)
def warp_cubic(image, flow, first, last, warped):  # type: ignore[no-untyped-def]
    """Image (H, W) at (u, v) + flow (H, W, 2) by Catmull-Rom's cubic, rows first to last; NaN outside."""
    height, width = image.shape
    for row in range(first, last):
        for column in range(width):
            u, v = column + flow[row, column, 0], row + flow[row, column, 1]
            if not (0 <= u <= width - 1 and 0 <= v <= height - 1):
                warped[row, column] = float("nan")
                continue
            u0, v0 = int(u), int(v)
            a, b = u - u0, v - v0
            wu = _cubic_weights(a)
            wv = _cubic_weights(b)
            total = 0.0
            for j in range(4):
                y = min(max(v0 + j - 1, 0), height - 1)
                line = 0.0
                for i in range(4):
                    line += wu[i] * image[y, min(max(u0 + i - 1, 0), width - 1)]
                total += wv[j] * line
            warped[row, column] = total


@njit(cache=True, nogil=True, inline="always")
def _cubic_weights(a):  # type: ignore[no-untyped-def]
    """Weights of the samples at -1, 0, 1, 2 for a position a in [0, 1]."""
    return (
        a * (-0.5 + a * (1.0 - 0.5 * a)),
        1.0 + a * a * (-2.5 + 1.5 * a),
        a * (0.5 + a * (2.0 - 1.5 * a)),
        a * a * (-0.5 + 0.5 * a),
    )


@njit(cache=True, nogil=True)
def relax(flow, gu, gv, residual, inverse, omega, colour, first, last):  # type: ignore[no-untyped-def]
    """Half a sweep of over-relaxation over the pixels of one colour of a chessboard, rows first to last.

    Each pixel's two equations ``(g gᵀ + 4 s) flow = s Σ neighbours - residual g`` are solved together, with
    ``inverse = 1 / (4 s + |g|²)``; a pixel at the border is its own neighbour beyond it. Pixels of one colour
    read only those of the other.
    """
    height, width = residual.shape
    quarter = np.float32(0.25)
    for row in range(first, last):
        here, above, below = flow[row], flow[max(row - 1, 0)], flow[min(row + 1, height - 1)]
        for column in range((row + colour) % 2, width, 2):
            left, right = max(column - 1, 0), min(column + 1, width - 1)
            mean_u = quarter * (here[left, 0] + here[right, 0] + above[column, 0] + below[column, 0])
            mean_v = quarter * (here[left, 1] + here[right, 1] + above[column, 1] + below[column, 1])
            a, b = gu[row, column], gv[row, column]
            step = (a * mean_u + b * mean_v + residual[row, column]) * inverse[row, column]
            here[column, 0] += omega * (mean_u - a * step - here[column, 0])
            here[column, 1] += omega * (mean_v - b * step - here[column, 1])


@njit(cache=True)
def stride(window):  # type: ignore[no-untyped-def]
    """Length of a row in which a patch and a border of 3 px lie: whole vectors of the processor."""
    return (window + 3 + 7) // 8 * 8


@njit(cache=True, nogil=True, fastmath={"contract", "reassoc"})
def _template(raw, a, b, window, width, mask, patch, smooth, gx, gy):  # type: ignore[no-untyped-def]
    """Patch at fractions (a, b) of a cell, its Scharr gradients, and the sums of their products.

    Rows are `width` long; what stands beyond the window is masked. `smooth` takes the patch and its border.
    """
    one = np.float32(1)
    w00, w01, w10, w11 = (one - a) * (one - b), a * (one - b), (one - a) * b, a * b
    n = (window + 2) * width
    p00, p01, p10, p11 = raw[:n], raw[1 : n + 1], raw[width : n + width], raw[width + 1 : n + width + 1]
    for k in range(n):
        smooth[k] = w00 * p00[k] + w01 * p01[k] + w10 * p10[k] + w11 * p11[k]
    n = window * width
    above, here, below = smooth, smooth[width:], smooth[2 * width :]
    above_l, above_m, above_r = above[:n], above[1 : n + 1], above[2 : n + 2]
    here_l, here_m, here_r = here[:n], here[1 : n + 1], here[2 : n + 2]
    below_l, below_m, below_r = below[:n], below[1 : n + 1], below[2 : n + 2]
    xx, xy, yy = np.float32(0), np.float32(0), np.float32(0)
    side, middle = np.float32(3 / 32), np.float32(10 / 32)
    for k in range(n):
        patch[k] = here_m[k]
        x = side * ((above_r[k] - above_l[k]) + (below_r[k] - below_l[k])) + middle * (here_r[k] - here_l[k])
        y = side * ((below_l[k] - above_l[k]) + (below_r[k] - above_r[k])) + middle * (
            below_m[k] - above_m[k]
        )
        x *= mask[k]
        y *= mask[k]
        gx[k], gy[k] = x, y
        xx += x * x
        xy += x * y
        yy += y * y
    return xx, xy, yy


@njit(cache=True, nogil=True, fastmath={"contract", "reassoc"})
def _cell_sums(raw, window, width, patch, gx, gy):  # type: ignore[no-untyped-def]
    """Sums of gradient times difference at the four corners of a cell, along u and along v."""
    n = window * width
    p00, p01, p10, p11 = raw[:n], raw[1 : n + 1], raw[width : n + width], raw[width + 1 : n + width + 1]
    x00 = x01 = x10 = x11 = np.float32(0)
    y00 = y01 = y10 = y11 = np.float32(0)
    for k in range(n):
        d00, d01, d10, d11 = p00[k] - patch[k], p01[k] - patch[k], p10[k] - patch[k], p11[k] - patch[k]
        x00 += d00 * gx[k]
        x01 += d01 * gx[k]
        x10 += d10 * gx[k]
        x11 += d11 * gx[k]
        y00 += d00 * gy[k]
        y01 += d01 * gy[k]
        y10 += d10 * gy[k]
        y11 += d11 * gy[k]
    return (x00, x01, x10, x11), (y00, y01, y10, y11)


@njit(cache=True, inline="always")
def _within(sums, a, b):  # type: ignore[no-untyped-def]
    """Value at fractions (a, b) of a cell of what its corners have."""
    return (1 - b) * ((1 - a) * sums[0] + a * sums[1]) + b * ((1 - a) * sums[2] + a * sums[3])


@njit(cache=True, inline="always")
def _mask(mask, u, v, shape, window, width):  # type: ignore[no-untyped-def]
    """Ones where a patch, whose first pixel is at (u, v), lies in the image."""
    for y in range(window):
        row = 0 <= v + y <= shape[0] - 1
        for x in range(window):
            mask[y * width + x] = row and 0 <= u + x <= shape[1] - 1


@njit(cache=True, nogil=True)
def follow_patches(  # type: ignore[no-untyped-def]
    templates, targets, border, shape, pixels, level, window, iterations, epsilon, first, last, flow, lost
):
    """Flow (N, 2) [px] of patches first to last, made better at one level; those lost there are marked.

    Images are those of the level, with their borders; pixels and flow are of the image itself.
    """
    width, scale, half = stride(window), 0.5**level, 0.5 * (window - 1)
    n = (window + 4) * width
    raw, smooth, patch = np.zeros(n, np.float32), np.zeros(n, np.float32), np.zeros(n, np.float32)
    gx, gy, whole, part = (
        np.zeros(n, np.float32),
        np.zeros(n, np.float32),
        np.zeros(n, np.float32),
        np.zeros(n, np.float32),
    )
    _mask(whole, 0, 0, (window, window), window, width)
    height, columns = shape
    for i in range(first, last):
        if lost[i]:
            continue
        u, v = pixels[i, 0] * scale - half, pixels[i, 1] * scale - half
        u0, v0 = int(np.floor(u)), int(np.floor(v))
        mask = whole
        if u < 0 or v < 0 or u + window > columns or v + window > height:
            mask = part
            _mask(part, u, v, shape, window, width)
        copy_patch(templates, v0 + border - 1, u0 + border - 1, window + 3, width, raw)
        a, b = np.float32(u - u0), np.float32(v - v0)
        xx, xy, yy = _template(raw, a, b, window, width, mask, patch, smooth, gx, gy)
        determinant = float(xx) * yy - float(xy) * xy
        least = (xx + yy - np.sqrt((xx - yy) * (xx - yy) + 4 * xy * xy)) / (2 * window * window)
        if least < LEAST_EIGENVALUE or determinant < LEAST_DETERMINANT:
            lost[i] = level == 0
            continue
        x, y, last_x, last_y = u + scale * flow[i, 0], v + scale * flow[i, 1], 0.0, 0.0
        cell_u = cell_v = LOST_AT
        for k in range(iterations):
            u0, v0 = int(np.floor(x)), int(np.floor(y))
            if not (-window <= u0 < columns and -window <= v0 < height):
                break
            if u0 != cell_u or v0 != cell_v:
                cell_u, cell_v = u0, v0
                copy_patch(targets, v0 + border, u0 + border, window + 1, width, raw)
                along_u, along_v = _cell_sums(raw, window, width, patch, gx, gy)
            s, t = _within(along_u, x - u0, y - v0), _within(along_v, x - u0, y - v0)
            step_x, step_y = (xy * t - yy * s) / determinant, (xy * s - xx * t) / determinant
            x += step_x
            y += step_y
            if step_x * step_x + step_y * step_y <= epsilon * epsilon:
                break
            if k > 0 and abs(step_x + last_x) < TO_AND_FRO_PX and abs(step_y + last_y) < TO_AND_FRO_PX:
                x -= 0.5 * step_x
                y -= 0.5 * step_y
                break
            last_x, last_y = step_x, step_y
        flow[i, 0], flow[i, 1] = (x - u) / scale, (y - v) / scale
        # where the search left the image
        lost[i] = level == 0 and not (-window <= x < columns and -window <= y < height)


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
