"""Farnebäck's polynomial-expansion flow (OpenCV), with the paper's Table I parameters."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

import cv2
import numpy as np
from numpy.typing import NDArray

from flowlik.flow.base import ZERO_ALLOWED, DenseFlow, Image, check_pair


@dataclass(frozen=True)
class Farneback(DenseFlow):
    """Dense flow by polynomial expansion; defaults are the paper's Table I in OpenCV's argument order.

    Parameters
    ----------
    pyramid_scale : float
        Ratio of successive pyramid levels.
    levels : int
        Pyramid levels above the image itself.
    window : int
        Averaging window [px].
    iterations : int
        Iterations a level.
    poly_n : int
        Neighbourhood of the polynomial expansion [px].
    poly_sigma : float
        Gaussian of the expansion [px].
    """

    name: ClassVar[str] = "farneback"
    pyramid_scale: float = 0.5
    levels: int = field(default=5, metadata=ZERO_ALLOWED)
    window: int = 5
    iterations: int = 5
    poly_n: int = 15
    poly_sigma: float = 1.5

    def dense(self, previous: Image, current: Image) -> NDArray[np.float32]:
        """Flow (H, W, 2) [px] of every pixel.

        Raises
        ------
        DataError
            If the images differ in size, or are not grey uint8.
        """
        check_pair(previous, current)
        start = np.zeros((*previous.shape, 2), np.float32)
        flow = cv2.calcOpticalFlowFarneback(
            previous, current, start, self.pyramid_scale, self.levels, self.window, self.iterations,
            self.poly_n, self.poly_sigma, 0,
        )  # fmt: skip
        return np.asarray(flow, dtype=np.float32)
