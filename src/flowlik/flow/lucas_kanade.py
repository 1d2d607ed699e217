"""Pyramidal Lucas-Kanade flow with the paper's Table I parameters, by our own kernels or OpenCV's."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import partial
from typing import ClassVar

import cv2
import numpy as np

from flowlik.flow import _kernels
from flowlik.flow.base import ZERO_ALLOWED, FlowAt, Image, TwoWay, Windowed, check_pair, inside_image
from flowlik.flow.tracking import Pyramid, Tracker
from flowlik.image.texture import Gradients
from flowlik.support.arrays import Array
from flowlik.support.threads import in_bands

PATCHES = 500


@dataclass(frozen=True)
class LucasKanade(Windowed, TwoWay):
    """Sparse flow of image patches; defaults are the paper's Table I.

    Its own choice of pixels is Shi-Tomasi's corners; they are not part of what a model records as
    parameters of the flow, since a likelihood holds wherever the flow is measured.

    Lucas and Kanade's least squares weighs the motions within a patch by their gradients, and where motion
    varies evenly over the patch what it finds is the motion at the centre of its gradient energy. A vector
    is placed there and not in the patch's middle, unless ``anchor`` asks for the latter.

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
    anchor : {"energy", "middle"}
        Where in its patch a vector is placed: the centre of gradient energy, or the middle as in the paper.
    solver : {"flowlik", "opencv"}
        Who solves it: `flowlik.flow.tracking`, or OpenCV as in the paper, which takes three times as long.
        Vectors agree to 1e-4 px in the median. A model's file that does not say is of OpenCV's.
    """

    name: ClassVar[str] = "lucas-kanade"
    window: int = 21
    max_level: int = field(default=3, metadata=ZERO_ALLOWED)
    iterations: int = 30
    epsilon_px: float = 0.01
    anchor: str = field(default="energy", metadata={"choices": ("energy", "middle")})
    solver: str = field(default="flowlik", metadata={"choices": ("flowlik", "opencv")})

    def measure(self, previous: Image, current: Image) -> tuple[Array, Array]:
        """Detect corners (N, 2) and track them: their flow (N, 2) [px]; NaN where lost."""
        pixels = self.choose(previous)
        return pixels, self.measure_at(previous, current, pixels)

    def measure_at(self, previous: Image, current: Image, pixels: Array) -> Array:
        """Flow (N, 2) [px] at given pixels (N, 2); NaN where lost, or outside the image.

        Raises
        ------
        DataError
            If the images differ in size, or are not grey uint8.
        """
        check_pair(previous, current)
        if self.solver == "flowlik":
            return self.both_ways(previous, current)[0](pixels)
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

    def choose(self, previous: Image) -> Array:
        """Shi-Tomasi's corners (N, 2) [px]."""
        return detect_corners(previous)

    def both_ways(self, previous: Image, current: Image) -> tuple[FlowAt, FlowAt]:
        """Flow as functions of pixels, there and back; our own solver's share the images' pyramids.

        Raises
        ------
        DataError
            If the images are not grey uint8 or differ in size.
        """
        if self.solver == "opencv":
            return partial(self.measure_at, previous, current), partial(self.measure_at, current, previous)
        check_pair(previous, current)
        first, second = (Pyramid.of(image, self.window, self.max_level) for image in (previous, current))
        track = self.tracker.track
        return partial(track, first, second), partial(track, second, first)

    @property
    def tracker(self) -> Tracker:
        """How its patches are tracked."""
        return Tracker(self.window, self.iterations, self.epsilon_px)

    def anchors(self, gradients: Gradients, pixels: Array) -> Array:
        """Centres (N, 2) [px] of the gradient energy in the patches around pixels (N, 2)."""
        if self.anchor == "middle" or len(pixels) == 0:
            return pixels
        gx, gy = gradients
        centres = np.empty((len(pixels), 2))
        in_bands(
            lambda first, last: _kernels.energy_centres(
                gx, gy, pixels, self.window // 2, first, last, centres
            ),
            len(pixels),
            PATCHES,
        )
        return centres


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
