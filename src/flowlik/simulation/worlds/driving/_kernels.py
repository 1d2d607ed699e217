"""Compiled: kernel averages of heights."""

# mypy: disable-error-code=no-untyped-def

import math

import numpy as np
from numba import njit


@njit(cache=True, nogil=True)
def average_heights(first, last, points, samples, radius_m, lowest_scale_m, heights, distances):
    """Average heights of samples (K, 3) = (x, z, y) around points first to last (N, 2), into (N,) arrays.

    Parameters
    ----------
    points, samples : arrays (N, 2), (K, 3)
        In plan [m], and heights y [m] downwards.
    radius_m : float
        Weights fall off as ``(1 + (r / radius)**2)**-3``.
    lowest_scale_m : float
        A sample so much lower than the average weighs e times as much.
    heights, distances : arrays (N,)
        Averages, and distances to the nearest sample [m].
    """
    weights = np.empty(len(samples))
    for i in range(first, last):
        total, middle, nearest = 0.0, 0.0, np.inf
        for k in range(len(samples)):
            dx, dz = samples[k, 0] - points[i, 0], samples[k, 1] - points[i, 1]
            squared = dx * dx + dz * dz
            nearest = min(nearest, squared)
            root = 1.0 / (1.0 + squared / (radius_m * radius_m))
            weights[k] = root * root * root
            total += weights[k]
            middle += weights[k] * samples[k, 2]
        middle /= total
        # what weighs next to nothing is left out of the second pass
        least = 1e-7 * total
        total, height = 0.0, 0.0
        for k in range(len(samples)):
            if weights[k] > least:
                lower = (samples[k, 2] - middle) / lowest_scale_m
                weight = weights[k] * math.exp(min(max(lower, -5.0), 5.0))
                total += weight
                height += weight * samples[k, 2]
        heights[i] = height / total
        distances[i] = math.sqrt(nearest)
