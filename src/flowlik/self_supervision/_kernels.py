"""Numba kernel: products of scalar scores over the image, by distance."""

import numpy as np
from numba import njit

from flowlik.calibration.distances import bin_of


@njit(cache=True, nogil=True)
def scalar_products(pixels, scores, n, along, size, first, per_octave, normal, right):  # type: ignore[no-untyped-def]
    """Add normal equations of the correlation of scalar scores, by distance; row 0 is each with itself.

    A pair's product of scores is expected to be ``rho n_i.n_j + rho_flow a_i a_j + rho_v v_i v_j`` with unit
    vectors n of the scores, a their components along the flow and v those down the image.
    """
    last = len(right) - 1
    features = np.empty(3)
    for i in range(len(pixels)):
        for j in range(i + 1):
            du, dv = pixels[i, 0] - pixels[j, 0], pixels[i, 1] - pixels[j, 1]
            b = 0 if i == j else bin_of(du * du + dv * dv, first, per_octave, last)
            features[0] = n[i, 0] * n[j, 0] + n[i, 1] * n[j, 1]
            features[1] = along[i] * along[j]
            features[2] = n[i, 1] * n[j, 1]
            w = size[i] * size[j]
            product = scores[i] * scores[j]
            for p in range(3):
                right[b, p] += w * features[p] * product
                for q in range(3):
                    normal[b, p, q] += w * features[p] * features[q]
