"""Horn and Schunck's flow, coarse to fine with warping."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import ClassVar

import cv2
import numpy as np
from numpy.typing import NDArray

from flowlik.errors import ModelError
from flowlik.flow import _kernels
from flowlik.flow.base import DenseFlow, Image, check_pair
from flowlik.support.threads import in_bands

Grid = NDArray[np.float32]

ROWS = 90
MEDIANS = (1, 3, 5)
SMALLEST = 16
"""Shorter side [px] below which the pyramid ends."""
DERIVATIVE = np.array([[1, -8, 0, 8, -1]], np.float32) / 12


@dataclass(frozen=True)
class HornSchunck(DenseFlow):
    r"""Dense flow that is as smooth as the images allow.

    It minimises, over all pixels x,

    .. math:: \sum (I_k(x + f) - I_{k-1}(x))^2 + \alpha^2 (|\nabla f_u|^2 + |\nabla f_v|^2)

    by linearising about the flow so far (a warp), and solving the linear equations by red-black
    over-relaxation. Horn and Schunck, *Determining optical flow*, 1981; pyramid and warping as in
    Meinhardt-Llopis, Sánchez, Kondermann, *Horn-Schunck Optical Flow with a Multi-Scale Strategy*, IPOL 2013.
    Gradients are the mean of the first image's and the warped second's, and a median filter follows each
    warp, as in Sun, Roth, Black, *Secrets of Optical Flow*, CVPR 2010. Where the flow leaves the image,
    smoothness alone fills it in.

    Parameters
    ----------
    alpha : float
        Weight of smoothness [intensity/px].
    levels : int
        Most pyramid levels, the image among them, each of half the size; none has a side under 16 px.
    warps : int
        Linearisations a level.
    iterations : int
        Sweeps of over-relaxation a warp.
    relaxation : float
        Factor of over-relaxation, below 2.
    sigma : float
        Gaussian that both images are smoothed with, at each level [px].
    median : int
        Side of the median filter [px]: 3 or 5; 1 is none.

    Raises
    ------
    ModelError
        If a parameter is out of its range.
    """

    name: ClassVar[str] = "horn-schunck"
    alpha: float = 10.0
    levels: int = 6
    warps: int = 5
    iterations: int = 20
    relaxation: float = 1.9
    sigma: float = 0.5
    median: int = 5

    def __post_init__(self) -> None:
        if not (self.relaxation < 2 and self.median in MEDIANS):
            raise ModelError(
                f"flow method {self.name}: relaxation must be below 2 and median 1, 3 or 5, "
                f"not {self.relaxation} and {self.median}"
            )

    def dense(self, previous: Image, current: Image) -> NDArray[np.float32]:
        """Flow (H, W, 2) [px] of every pixel.

        Raises
        ------
        DataError
            If the images differ in size, or are not grey uint8.
        """
        check_pair(previous, current)
        pyramid = [(previous.astype(np.float32), current.astype(np.float32))]
        while len(pyramid) < self.levels and min(pyramid[-1][0].shape) >= 2 * SMALLEST:
            pyramid.append((_halved(pyramid[-1][0]), _halved(pyramid[-1][1])))
        flow = np.zeros((*pyramid[-1][0].shape, 2), np.float32)
        for first, second in reversed(pyramid):
            flow = _enlarged(flow, first.shape)
            self._refine(self._smoothed(first), self._smoothed(second), flow)
        return flow

    def _smoothed(self, image: Grid) -> Grid:
        return np.asarray(cv2.GaussianBlur(image, (0, 0), self.sigma), dtype=np.float32)

    def _refine(self, first: Grid, second: Grid, flow: Grid) -> None:
        """Improve the flow (H, W, 2) of one level in place."""
        gradient = _gradient(first)
        warped = np.empty_like(first)
        for _ in range(self.warps):
            in_bands(lambda a, b: _kernels.warp_cubic(second, flow, a, b, warped), len(flow), ROWS)
            outside = np.isnan(warped)
            warped[outside] = first[outside]
            gu, gv = (0.5 * (g + h) for g, h in zip(gradient, _gradient(warped)))
            gu[outside] = gv[outside] = 0
            residual = warped - first - gu * flow[..., 0] - gv * flow[..., 1]
            self._solve(flow, gu, gv, residual)
            if self.median > 1:
                flow[:] = cv2.merge([cv2.medianBlur(part, self.median) for part in cv2.split(flow)])

    def _solve(self, flow: Grid, gu: Grid, gv: Grid, residual: Grid) -> None:
        """Relax the flow (H, W, 2), in place, towards zero of ``residual + gᵀ flow`` and smoothness."""
        omega = np.float32(self.relaxation)
        inverse = 1 / (np.float32(4 * self.alpha**2) + gu * gu + gv * gv)
        for colour in (0, 1) * self.iterations:
            half_sweep = partial(_kernels.relax, flow, gu, gv, residual, inverse, omega, colour)
            in_bands(half_sweep, len(flow), ROWS)


def _halved(image: Grid) -> Grid:
    """Image of half the size, rounded up; pixels are means over areas."""
    height, width = image.shape
    size = ((width + 1) // 2, (height + 1) // 2)
    return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), dtype=np.float32)


def _enlarged(flow: Grid, shape: tuple[int, ...]) -> Grid:
    """Flow of a coarser level at the size (H, W), in its pixels."""
    if flow.shape[:2] == shape:
        return flow
    height, width = shape
    scale = np.array([width / flow.shape[1], height / flow.shape[0]], np.float32)
    return np.asarray(cv2.resize(flow, (width, height), interpolation=cv2.INTER_LINEAR) * scale, np.float32)


def _gradient(image: Grid) -> tuple[Grid, Grid]:
    """Derivatives along u and v [intensity/px], of fourth order, mirrored at the border."""
    along_u = cv2.filter2D(image, cv2.CV_32F, DERIVATIVE, borderType=cv2.BORDER_REFLECT_101)
    along_v = cv2.filter2D(image, cv2.CV_32F, DERIVATIVE.T, borderType=cv2.BORDER_REFLECT_101)
    return np.asarray(along_u, np.float32), np.asarray(along_v, np.float32)
