"""Lengths that flow itself tells, of a road at a known depth below or of a second camera beside."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from scipy.spatial.transform import RigidTransform

from flowlik.errors import DataError
from flowlik.flow.base import Image
from flowlik.geometry.camera import Pinhole
from flowlik.likelihood.likelihood import FlowLikelihood
from flowlik.measurement.measurements import Measurements
from flowlik.odometry._inverse_depth import EpipolarFlow, Fit, fit_inverse_depths
from flowlik.odometry._lengths import Length
from flowlik.support.arrays import Array

# a length known no better than this is none
WIDEST = 0.15
# the road in front: as far to the side as the camera is high, times this, and this far below the horizon
LANE = 1.3
BELOW_HORIZON = 0.1
# how far a road is off the direction of travel, along it and across [rad], and a car moves up and down a step
TILT, ROLL, BOUNCE_M = np.deg2rad(0.25), np.deg2rad(2.0), 0.003
# how far a car's height on its springs is off
SPRINGS_M = 0.015
# how a road rises and falls along itself [1/m]
CURVATURE = 1 / 400
# the road's vectors lie as far below the horizon as all of them do, and not on a strip of something upright
LEAST_SPREAD = 0.5
# steps tried, in heights of the camera, and rolls [rad]
STEPS = np.geomspace(0.003, 3.0, 100)
ROLLS = np.deg2rad([-4.0, 0.0, 4.0])
DISPARITIES = 128
DISPARITY_SIGMA_PX = 0.5


@dataclass(frozen=True)
class CameraHeight:
    """Known height of the camera over a road, whose height in units of the motion the flow tells.

    On a plane inverse depth is linear in the ray, ``1 / z = (n / h) . ray`` with the normal n and the height
    h. Vectors in front of the car are a mixture of those of the road, with the likelihood's errors along
    their epipolar lines, and of others. A car drives along its road: the normal is across the direction of
    travel but for a small tilt, and bends up or down a little (docs/theory-scale.md).

    Parameters
    ----------
    height_m : float
        Height of the camera over the road [m].

    Raises
    ------
    DataError
        If the height is not positive.
    """

    height_m: float
    name: str = "camera-height"

    def __post_init__(self) -> None:
        if not 0 < self.height_m < np.inf:
            raise DataError(f"camera height {self.height_m} m must be positive")

    def length(
        self, k: int, m: Measurements, camera: Pinhole, T_k_prev: RigidTransform, likelihood: FlowLikelihood
    ) -> Length | None:
        """Length of the motion; None where too little of a road is seen, or too little parallax."""
        travel = -T_k_prev.inv().rotation.apply(T_k_prev.translation)
        travel /= np.linalg.norm(travel)
        right = np.cross(travel, [0.0, 1.0, 0.0])
        if (across := np.linalg.norm(right)) < 0.1:
            return None  # up or down: along no road
        right /= across
        down = np.cross(right, travel)
        below = camera.rays(m.pixels) @ down
        in_front = (below > BELOW_HORIZON) & (np.abs(camera.rays(m.pixels) @ right) < LANE * below)
        seen = EpipolarFlow.of(m.select(in_front), camera, T_k_prev)

        def prior(q: Array) -> Array:
            size = float(np.linalg.norm(q[:3]))
            along, aside = np.hypot(TILT * size, BOUNCE_M / self.height_m), ROLL * size
            information = np.zeros((4, 4))
            information[:3, :3] = np.outer(travel, travel) / along**2 + np.outer(right, right) / aside**2
            information[3, 3] = 1 / (0.5 * CURVATURE * self.height_m * size) ** 2
            return information

        rays = camera.rays(seen.measurements.pixels)
        X = np.column_stack([rays, 1 / (rays @ down)])
        starts = [[*(step * (down + roll * right)), 0.0] for step in STEPS for roll in ROLLS]
        fit = fit_inverse_depths(seen, X, np.array(starts), prior, likelihood)
        if fit is None or fit.q[:3] @ down <= 0 or _spread(rays @ down, fit.belongs) < LEAST_SPREAD:
            return None
        size = float(np.linalg.norm(fit.q[:3]))
        relative = np.append(fit.q[:3] / size**2, 0.0)
        return _told(self.height_m * size, relative, fit, SPRINGS_M / self.height_m)


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

    def length(
        self, k: int, m: Measurements, camera: Pinhole, T_k_prev: RigidTransform, likelihood: FlowLikelihood
    ) -> Length | None:
        """Length of the motion; None where too few vectors have a disparity and parallax."""
        disparity = _stereo_disparity(self.sequence.image(k - 1), self.sequence.right_image(k - 1))
        seen = EpipolarFlow.of(m, camera, T_k_prev)
        pixels = seen.measurements.pixels
        column, row = np.rint(pixels).astype(int).T
        inside = camera.contains(pixels)
        d = np.where(inside, disparity[np.where(inside, row, 0), np.where(inside, column, 0)], np.nan)
        seen, d = seen.select(d > 1), d[d > 1]
        nearness = d[:, None] / (camera.fx * self.sequence.baseline_m)
        steps = STEPS[:, None] * self.sequence.baseline_m * 30
        fit = fit_inverse_depths(
            seen, nearness, steps, lambda _: np.zeros((1, 1)), likelihood, DISPARITY_SIGMA_PX / d
        )
        if fit is None or fit.q[0] <= 0:
            return None
        return _told(float(fit.q[0]), 1 / fit.q, fit)


def _told(metres: float, relative: Array, fit: Fit, besides: float = 0.0) -> Length | None:
    """Length of a fit, given the derivative (P,) of its logarithm by the parameters; None if too wide.

    `besides` is a relative standard deviation that the fit does not know of.
    """
    sigma = float(np.sqrt(relative @ fit.covariance @ relative + besides**2))
    return Length(metres, sigma * metres, relative @ fit.by_motion) if sigma < WIDEST else None


def _spread(values: Array, weights: Array) -> float:
    """Standard deviation of weighted values (N,) over that of all."""
    mean = np.average(values, weights=weights)
    return float(np.sqrt(np.average((values - mean) ** 2, weights=weights)) / values.std())


def _stereo_disparity(left: Image, right: Image) -> Array:
    """Disparity (H, W) [px] of the left image by OpenCV's semi-global matching; NaN where unknown."""
    sgbm: Any = cv2
    matcher = sgbm.StereoSGBM_create(
        minDisparity=0, numDisparities=DISPARITIES, blockSize=5, P1=8 * 25, P2=32 * 25, disp12MaxDiff=1,
        uniquenessRatio=10, speckleWindowSize=100, speckleRange=2, mode=cv2.STEREO_SGBM_MODE_SGBM_3WAY,
    )  # fmt: skip
    disparity = matcher.compute(left, right).astype(np.float64) / 16
    return np.where(disparity > 0, disparity, np.nan)
