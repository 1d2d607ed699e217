"""Where the length of a motion comes from, which flow alone does not tell: swappable scale sources."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

import cv2
import numpy as np
from scipy.spatial.transform import RigidTransform

from flowlik.datasets.base import ImageSequence, lacks
from flowlik.errors import DataError
from flowlik.flow.base import Image
from flowlik.geometry.camera import Pinhole
from flowlik.measurement.measurements import Measurements
from flowlik.support.arrays import Array

SCALES = ("truth-norm", "gps-norm", "camera-height", "stereo", "none")
LEAST_POINTS = 15
LEAST_PARALLAX_PX = 1.0
BELOW_HORIZON = 0.04
LANE = 2.0
KERNEL = 0.05
DISPARITIES = 128


class ScaleSource(Protocol):
    """Length of the motion from frame k - 1 to k."""

    @property
    def name(self) -> str:
        """As a protocol names it."""
        ...

    def length_m(self, k: int, m: Measurements, camera: Pinhole, T_k_prev: RigidTransform) -> float | None:
        """Length [m] of a motion of unit length; None where it cannot be told."""
        ...


@dataclass(frozen=True)
class Norm:
    """Length of a motion known from elsewhere: the truth's, or a GPS's."""

    name: str
    distance_m: Callable[[int], float]

    def length_m(self, k: int, m: Measurements, camera: Pinhole, T_k_prev: RigidTransform) -> float | None:
        """Length [m] of the motion from frame k - 1 to k."""
        return self.distance_m(k)


@dataclass(frozen=True)
class CameraHeight:
    """Known height of the camera over a road, whose height in units of the motion the flow tells.

    Points below the horizon, at most twice as far to the side as the camera is high, are triangulated; the
    road is where most of them lie (the mode of their log-heights, each weighed by its parallax), as in VOLDOR
    (Min and others, CVPR 2020). The road is taken to be parallel to the optical axis but for `pitch_rad`.

    Parameters
    ----------
    height_m : float
        Height of the camera over the road [m]; KITTI's is 1.65.
    pitch_rad : float
        Angle of the optical axis below the road's direction [rad].

    Raises
    ------
    DataError
        If the height is not positive.
    """

    height_m: float = 1.65
    pitch_rad: float = 0.0
    name: str = "camera-height"

    def __post_init__(self) -> None:
        if not 0 < self.height_m < np.inf:
            raise DataError(f"camera height {self.height_m} m must be positive")

    def length_m(self, k: int, m: Measurements, camera: Pinhole, T_k_prev: RigidTransform) -> float | None:
        """Length [m] of the motion; None where fewer than 15 points of the road are seen."""
        rays = camera.rays(m.pixels)
        height = rays @ np.array([0.0, np.cos(self.pitch_rad), np.sin(self.pitch_rad)])
        depth, parallax = _triangulated(m, camera, T_k_prev)
        road = (height > BELOW_HORIZON) & (np.abs(rays[:, 0]) < LANE * height)
        road &= (parallax > LEAST_PARALLAX_PX) & (depth > 0)
        if road.sum() < LEAST_POINTS:
            return None
        return self.height_m / _mode((depth * height)[road], parallax[road])


@dataclass(frozen=True)
class Stereo:
    """Depth from a second camera, level with the first: semi-global matching of the previous image's pair.

    Parameters
    ----------
    sequence : ImageSequence
        Data with `right_image` and `baseline_m`.
    """

    sequence: Any
    name: str = "stereo"

    def length_m(self, k: int, m: Measurements, camera: Pinhole, T_k_prev: RigidTransform) -> float | None:
        """Length [m] of the motion; None where fewer than 15 points have a disparity and parallax."""
        disparity = _stereo_disparity(self.sequence.image(k - 1), self.sequence.right_image(k - 1))
        column, row = np.rint(m.pixels).astype(int).T
        inside = camera.contains(m.pixels)
        d = np.where(inside, disparity[np.where(inside, row, 0), np.where(inside, column, 0)], np.nan)
        depth, parallax = _triangulated(m, camera, T_k_prev)
        usable = (d > 1) & (parallax > LEAST_PARALLAX_PX) & (depth > 0)
        if usable.sum() < LEAST_POINTS:
            return None
        metres = camera.fx * self.sequence.baseline_m / d[usable]
        precision = 1 / np.hypot(1 / parallax[usable], 0.3 / d[usable])
        return float(_weighted_median(metres / depth[usable], precision))


@dataclass(frozen=True)
class Unscaled:
    """No scale: every motion keeps unit length."""

    name: str = "none"

    def length_m(self, k: int, m: Measurements, camera: Pinhole, T_k_prev: RigidTransform) -> float | None:
        """Return None."""
        return None


def scale_source(name: str, sequence: ImageSequence, height_m: float = 1.65) -> ScaleSource:
    """Scale source by its name in `SCALES`.

    Raises
    ------
    DataError
        If the name is unknown, or the data lacks what the source needs.
    """
    if name == "none":
        return Unscaled()
    if name == "truth-norm":
        sequence.T_n_c(0)
        return Norm(name, lambda k: true_distance(sequence, k))
    if name == "gps-norm":
        positions = getattr(sequence, "gps_positions", None)
        if positions is None:
            raise lacks(sequence.name, "GPS positions (scale gps-norm needs the OXTS of KITTI raw)")
        return Norm(name, lambda k: float(np.linalg.norm(positions[k] - positions[k - 1])))
    if name == "camera-height":
        return CameraHeight(height_m)
    if name == "stereo":
        if getattr(sequence, "baseline_m", None) is None or not hasattr(sequence, "right_image"):
            raise lacks(sequence.name, "second camera (scale stereo needs right images and their baseline)")
        return Stereo(sequence)
    raise DataError(f"unknown scale source {name!r}: known are {', '.join(SCALES)}")


def true_distance(sequence: ImageSequence, k: int) -> float:
    """Length [m] of the true motion from frame k - 1 to k: the scale source ``truth-norm``."""
    return float(np.linalg.norm(sequence.T_n_c(k).translation - sequence.T_n_c(k - 1).translation))


def _triangulated(m: Measurements, camera: Pinhole, T_k_prev: RigidTransform) -> tuple[Array, Array]:
    """Depths (N,) along z in image k - 1, in units of the motion's length, and parallaxes (N,) [px].

    The parallax is the part of the flow along the epipolar line that the rotation does not explain, in whose
    inverse proportion the depth is uncertain; a depth behind the camera is not positive.
    """
    far = T_k_prev.rotation.apply(camera.rays(m.pixels))
    t = T_k_prev.translation / np.linalg.norm(T_k_prev.translation)
    end = camera.rays(m.pixels + m.flow)
    # end x (depth far + t) = 0, solved along the line: components of both orthogonal to the end ray
    a, b = np.cross(end, far), np.cross(end, t)
    with np.errstate(divide="ignore", invalid="ignore"):
        depth = -(a * b).sum(axis=1) / (a**2).sum(axis=1)
        infinity = camera.v2p(far)
    parallax = np.linalg.norm(m.pixels + m.flow - infinity, axis=1)
    return depth, np.where(np.isfinite(parallax), parallax, 0.0)


def _stereo_disparity(left: Image, right: Image) -> Array:
    """Disparity (H, W) [px] of the left image by OpenCV's semi-global matching; NaN where unknown."""
    sgbm: Any = cv2
    matcher = sgbm.StereoSGBM_create(
        minDisparity=0, numDisparities=DISPARITIES, blockSize=5, P1=8 * 25, P2=32 * 25, disp12MaxDiff=1,
        uniquenessRatio=10, speckleWindowSize=100, speckleRange=2, mode=cv2.STEREO_SGBM_MODE_SGBM_3WAY,
    )  # fmt: skip
    disparity = matcher.compute(left, right).astype(np.float64) / 16
    return np.where(disparity > 0, disparity, np.nan)


def _mode(values: Array, weights: Array) -> float:
    """Where positive values are densest on a logarithmic axis, by a kernel of 5 % of a value."""
    logs = np.log(values)
    distance = (logs[:, None] - logs) / KERNEL
    density = (weights * np.exp(-0.5 * distance**2)).sum(axis=1)
    near = np.abs(distance[density.argmax()]) < 2
    return float(np.exp(np.average(logs[near], weights=weights[near])))


def _weighted_median(values: Array, weights: Array) -> float:
    order = np.argsort(values)
    cumulated = np.cumsum(weights[order])
    return float(values[order][np.searchsorted(cumulated, 0.5 * cumulated[-1])])
