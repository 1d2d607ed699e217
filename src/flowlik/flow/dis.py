"""Dense inverse search (OpenCV), with the parameters of OpenCV's preset MEDIUM."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

import cv2
import numpy as np
from numpy.typing import NDArray

from flowlik.errors import DataError
from flowlik.flow.base import ZERO_ALLOWED, DenseFlow, Image, check_pair


@dataclass(frozen=True)
class DIS(DenseFlow):
    """Dense flow from patches matched by inverse search, then refined by a variational method.

    Kroeger, Timofte, Dai, Van Gool, *Fast Optical Flow using Dense Inverse Search*, ECCV 2016. The pyramid's
    coarsest level is OpenCV's own choice by the size of image and patch.

    Parameters
    ----------
    finest_scale : int
        Finest pyramid level that is searched; 0 is the image, 1 half its size. Above it flow is enlarged.
    patch_size : int
        Side of a patch [px].
    patch_stride : int
        Distance between patches [px].
    iterations : int
        Gradient-descent iterations of a patch a level.
    refinement_iterations : int
        Fixed-point iterations of the variational refinement a level; 0 is none.
    refinement_alpha, refinement_gamma, refinement_delta : float
        Weights of smoothness, constancy of gradients and constancy of brightness in the refinement.
    refinement_epsilon : float
        Regularisation of its robust penalty.
    mean_normalization : bool
        Patches are compared less their mean.
    spatial_propagation : bool
        Good matches are offered to neighbouring patches.
    """

    name: ClassVar[str] = "dis"
    finest_scale: int = field(default=1, metadata=ZERO_ALLOWED)
    patch_size: int = 8
    patch_stride: int = 3
    iterations: int = 25
    refinement_iterations: int = field(default=5, metadata=ZERO_ALLOWED)
    refinement_alpha: float = 20.0
    refinement_gamma: float = field(default=10.0, metadata=ZERO_ALLOWED)
    refinement_delta: float = field(default=5.0, metadata=ZERO_ALLOWED)
    refinement_epsilon: float = 0.01
    mean_normalization: bool = True
    spatial_propagation: bool = True

    def dense(self, previous: Image, current: Image) -> NDArray[np.float32]:
        """Flow (H, W, 2) [px] of every pixel.

        Raises
        ------
        DataError
            If the images differ, or are too small or too narrow for the patches.
        """
        check_pair(previous, current)
        try:
            flow = self._search().calc(previous, current, None)  # type: ignore[call-overload]
        except cv2.error as error:
            size = f"{previous.shape[1]}x{previous.shape[0]}"
            raise DataError(f"images of {size} are too small for {self}") from error
        return np.asarray(flow, dtype=np.float32)

    def _search(self) -> cv2.DISOpticalFlow:
        """OpenCV's object with every parameter said; it keeps state, so that each call gets its own."""
        search = cv2.DISOpticalFlow.create(cv2.DISOPTICAL_FLOW_PRESET_MEDIUM)
        search.setFinestScale(self.finest_scale)
        search.setPatchSize(self.patch_size)
        search.setPatchStride(self.patch_stride)
        search.setGradientDescentIterations(self.iterations)
        search.setVariationalRefinementIterations(self.refinement_iterations)
        search.setVariationalRefinementAlpha(self.refinement_alpha)
        search.setVariationalRefinementGamma(self.refinement_gamma)
        search.setVariationalRefinementDelta(self.refinement_delta)
        search.setVariationalRefinementEpsilon(self.refinement_epsilon)
        search.setUseMeanNormalization(self.mean_normalization)
        search.setUseSpatialPropagation(self.spatial_propagation)
        return search
