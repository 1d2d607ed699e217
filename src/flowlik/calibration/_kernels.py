"""Numba kernels of calibration: counts of a sketch, products of scores."""

from numba import njit

from flowlik.calibration.distances import bin_of
from flowlik.likelihood.tables import magnitude_position


@njit(cache=True)
def count(x, ln_t, z, sign, x_first, x_scale, t_first, t_scale, counts, by_level, errors):  # type: ignore[no-untyped-def]
    """Count components in the bins of x, texture, sign and abs(z); the outer bins hold what is beyond."""
    for i in range(len(z)):
        row = min(max(int((x[i] - x_first) * x_scale), 0), counts.shape[0] - 1)
        level = min(max(int((ln_t[i] - t_first) * t_scale), 0), by_level.shape[0] - 1)
        column, _ = magnitude_position(abs(z[i]))
        side = 0 if z[i] * sign[i] < 0 else 1
        counts[row, side, column] += 1
        by_level[level, row] += 1
        errors[level, side, column] += 1


@njit(cache=True, nogil=True)
def products(pixels, scores, n, size, first, per_octave, dot, along, down, norm, cosine, steep):  # type: ignore[no-untyped-def]
    """Add products of the scores of every pair of vectors, by distance; row 0 is each vector with itself."""
    last = len(norm) - 1
    for i in range(len(pixels)):
        for j in range(i + 1):
            du, dv = pixels[i, 0] - pixels[j, 0], pixels[i, 1] - pixels[j, 1]
            b = 0 if i == j else bin_of(du * du + dv * dv, first, per_octave, last)
            w = size[i] * size[j]
            dot[b] += w * (scores[i, 0] * scores[j, 0] + scores[i, 1] * scores[j, 1])
            along_i = n[i, 0] * scores[i, 0] + n[i, 1] * scores[i, 1]
            along[b] += w * along_i * (n[j, 0] * scores[j, 0] + n[j, 1] * scores[j, 1])
            down[b] += w * scores[i, 1] * scores[j, 1]
            norm[b] += w
            cosine[b] += w * (n[i, 0] * n[j, 0] + n[i, 1] * n[j, 1])
            steep[b] += w * n[i, 1] * n[j, 1]
