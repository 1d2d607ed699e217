"""Compiled kernels of Horn-Schunck; their plain numpy twins stand in the tests."""

from __future__ import annotations

import numpy as np
from numba import njit


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
