"""How natural pictures are: spectrum, gradients, texture and depth edges, as numbers to set side by side."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt, maximum_filter, minimum_filter

from flowlik.errors import DataError
from flowlik.image.texture import eigenbasis, structure_tensor
from flowlik.support.arrays import Array

SLOPE_BAND = (0.02, 0.4)
"""Frequencies [cycles/px] over which `spectral_slope` is fitted."""

EDGE_RATIO = 1.1
"""Largest over smallest depth within 3x3 pixels from which on there is a depth edge."""


def amplitude_spectrum(image: NDArray, bins_per_octave: int = 4) -> tuple[Array, Array]:
    """Amplitude of an image over spatial frequency, whatever the direction.

    The mean is removed and a Hann window applied, so that the borders add nothing of their own. The amplitude
    is the root of the mean power of a ring; scaled so that white noise of standard deviation s gives s.

    Parameters
    ----------
    image : array (H, W)
        Grey picture, at least 16 pixels either way.
    bins_per_octave : int
        Rings an octave of frequency.

    Returns
    -------
    frequency : array (B,)
        Mean frequency of each ring [cycles/px], up to 0.5.
    amplitude : array (B,)
        [grey levels].

    Raises
    ------
    DataError
        If the image is not two-dimensional, or too small.
    """
    if image.ndim != 2 or min(image.shape) < 16:
        raise DataError(f"a spectrum needs an image (H, W) of at least 16 x 16, not {image.shape}")
    height, width = image.shape
    window = np.hanning(height)[:, None] * np.hanning(width)
    centred = image - np.average(image, weights=window)
    power = np.abs(np.fft.rfft2(centred * window)) ** 2 / np.sum(window**2)
    frequency = np.hypot(np.fft.fftfreq(height)[:, None], np.fft.rfftfreq(width))
    lowest = 2 / min(height, width)
    ring = np.floor(bins_per_octave * np.log2(np.maximum(frequency, 1e-9) / lowest)).astype(np.int64)
    counted = (ring >= 0) & (frequency <= 0.5)
    size = np.bincount(ring[counted])
    filled = size > 0
    mean_frequency = np.bincount(ring[counted], frequency[counted])[filled] / size[filled]
    mean_power = np.bincount(ring[counted], power[counted])[filled] / size[filled]
    return mean_frequency, np.sqrt(mean_power)


def spectral_slope(image: NDArray, band: tuple[float, float] = SLOPE_BAND) -> float:
    """Slope of ln amplitude over ln frequency within a band [cycles/px]; natural images have about -1.

    Raises
    ------
    DataError
        If the image is too small, or has no contrast.
    """
    frequency, amplitude = amplitude_spectrum(image)
    inside = (frequency >= band[0]) & (frequency <= band[1])
    if not (amplitude[inside] > 0).all():
        raise DataError("an image without contrast has no spectral slope")
    return float(np.polyfit(np.log(frequency[inside]), np.log(amplitude[inside]), 1)[0])


def gradients(image: NDArray[np.uint8]) -> Array:
    """Derivatives along both axes (2 H W,) [grey levels/px]: Scharr / 32, as in the structure tensor."""
    return np.concatenate(
        [(cv2.Scharr(image, cv2.CV_64F, dx, dy) / 32).ravel() for dx, dy in ((1, 0), (0, 1))]
    )


def kurtosis(values: Array) -> float:
    """Fourth moment about 0 over the squared second: 3 for a Gaussian, more for rare large values.

    Raises
    ------
    DataError
        If all values are 0.
    """
    power = float(np.mean(np.square(values)))
    if power == 0:
        raise DataError("values that are all 0 have no kurtosis")
    return float(np.mean(np.square(np.square(values))) / power**2)


def texture_levels(image: NDArray[np.uint8]) -> tuple[Array, Array]:
    """Eigenvalues t1 >= t2 of the structure tensor, each (H W,) [intensity^2/px^2]."""
    t, _ = eigenbasis(structure_tensor(image))
    return t[..., 0].ravel(), t[..., 1].ravel()


def depth_edges(depth: Array) -> NDArray[np.bool_]:
    """Depth edges (H, W): the largest depth of the 3x3 is more than 1.1 times the smallest.

    Parameters
    ----------
    depth : array (H, W)
        Depth [m]; inf is sky, behind everything; NaN is unknown and makes no edge.
    """
    unknown = np.isnan(depth)
    largest = maximum_filter(np.where(unknown, -np.inf, depth), 3, mode="nearest")
    smallest = minimum_filter(np.where(unknown, np.inf, depth), 3, mode="nearest")
    return np.asarray(largest > EDGE_RATIO * smallest)


def near_depth_edge(depth: Array, radius_px: float) -> NDArray[np.bool_]:
    """Pixels (H, W) whose distance to a depth edge is at most a radius [px]; arguments as `depth_edges`."""
    edges = depth_edges(depth)
    if not edges.any():
        return np.zeros(depth.shape, bool)
    return np.asarray(distance_transform_edt(~edges) <= radius_px)


def depth_smooth(depth: Array) -> NDArray[np.bool_]:
    """Pixels (H, W) of known, finite depth without a depth edge within 10 px."""
    return np.isfinite(depth) & ~near_depth_edge(depth, 10)


def depth_edge_share(depth: Array, radius_px: float = 5.0) -> float:
    """Share of the pixels of known depth, sky included, that lie within a radius [px] of a depth edge.

    Raises
    ------
    DataError
        If no depth is known.
    """
    known = ~np.isnan(depth)
    if not known.any():
        raise DataError("no depth is known, so there is no share of depth edges")
    return float(near_depth_edge(depth, radius_px)[known].mean())
