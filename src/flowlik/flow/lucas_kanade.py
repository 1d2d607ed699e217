"""Pyramidal Lucas-Kanade flow (OpenCV), with the paper's Table I parameters."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

import cv2
import numpy as np

from flowlik.camera import Array
from flowlik.flow.base import ZERO_ALLOWED, Image, check_pair, inside_image


@dataclass(frozen=True)
class LucasKanade:
    """Sparse flow of image patches; defaults are the paper's Table I.

    Its own choice of pixels is Shi-Tomasi's corners; they are not part of what a model records as
    parameters of the flow, since a likelihood holds wherever the flow is measured.

    Parameters
    ----------
    window : int
        Side of the patch [px].
    max_level : int
        Highest pyramid level.
    iterations : int
        Most iterations a level.
    epsilon_px : float
        Step below which a level has converged [px].
    """

    name: ClassVar[str] = "lucas-kanade"
    window: int = 21
    max_level: int = field(default=3, metadata=ZERO_ALLOWED)
    iterations: int = 30
    epsilon_px: float = 0.01

    def measure(self, previous: Image, current: Image) -> tuple[Array, Array]:
        """Detect corners (N, 2) and track them: their flow (N, 2) [px]; NaN where lost."""
        pixels = detect_corners(previous)
        return pixels, self.measure_at(previous, current, pixels)

    def measure_at(self, previous: Image, current: Image, pixels: Array) -> Array:
        """Flow (N, 2) [px] at given pixels (N, 2); NaN where lost, or outside the image."""
        check_pair(previous, current)
        inside = inside_image(pixels, previous.shape)
        start = np.where(inside[:, None], pixels, 0).astype(np.float32).reshape(-1, 1, 2)
        if len(start) == 0:
            return np.empty((0, 2))
        criteria = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, self.iterations, self.epsilon_px)
        # the threshold keeps every patch with any gradient at all: texture decides how far to trust it
        end, status, _ = cv2.calcOpticalFlowPyrLK(
            previous, current, start, np.empty_like(start), winSize=(self.window, self.window),
            maxLevel=self.max_level, criteria=criteria, minEigThreshold=1e-7,
        )  # fmt: skip
        flow = end.reshape(-1, 2).astype(np.float64) - start.reshape(-1, 2)
        flow[(status.ravel() == 0) | ~inside] = np.nan
        return flow


def detect_corners(image: Image, most: int = 4000, quality: float = 0.001, spacing_px: float = 7.0) -> Array:
    """Shi-Tomasi corners (N, 2) [px] of a grey image, strongest first; empty where there is none.

    Parameters
    ----------
    image : uint8 array (H, W)
        Grey image.
    most : int
        Most corners returned.
    quality : float
        Least smaller eigenvalue, as a share of the image's largest.
    spacing_px : float
        Least distance between corners [px].
    """
    corners = cv2.goodFeaturesToTrack(image, most, quality, spacing_px, blockSize=5)
    if corners is None:
        return np.empty((0, 2))
    return corners.reshape(-1, 2).astype(np.float64)
