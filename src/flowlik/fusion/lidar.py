"""LiDAR as known depth: a sweep in the image, how well it tells depth there, and the motion from it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from scipy.spatial.transform import RigidTransform

from flowlik.egomotion import EgoMotion, Estimator, KnownDepth, with_depth_errors
from flowlik.errors import DataError
from flowlik.flow.base import FlowMethod, Image
from flowlik.geometry.camera import Pinhole
from flowlik.image.texture import eigenbasis, tensors_at
from flowlik.likelihood.likelihood import FlowLikelihood
from flowlik.measurement.measurements import measure
from flowlik.support.arrays import Array

NEIGHBOURS = 6
HIDDEN_WITHIN_PX = 4.0
HIDDEN_SHARE = 0.25
"""A point is hidden where one this near in the image is nearer by this share of its depth."""
CELL_PX = 12.0
TAKEN_WITHIN_PX = 3.0


@dataclass(frozen=True)
class LidarNoise:
    """How a LiDAR's points err beside a camera.

    Attributes
    ----------
    range_m : float
        Standard deviation [m] of a range: 0.02 for Velodyne's HDL-64E by its data sheet.
    misregistration_px : float
        Standard deviation [px] an axis by which points fall beside their place in the image: of the
        calibration, of time between sweep and image.

    Raises
    ------
    DataError
        If one is negative or not finite.
    """

    range_m: float
    misregistration_px: float

    def __post_init__(self) -> None:
        if not (0 <= self.range_m < np.inf and 0 <= self.misregistration_px < np.inf):
            raise DataError(f"a LiDAR's errors must be finite and not negative, not {self}")


@dataclass(frozen=True, eq=False)
class SparseDepth:
    """Depth at some places of an image.

    Attributes
    ----------
    pixels : array (N, 2)
        Where points fall [px].
    inverse_range : array (N,)
        Inverse distance [1/m] from the camera along each ray.
    inverse_range_sd : array (N,)
        Its standard deviation [1/m].
    slope : array (N,)
        How fast it changes there [1/m/px].
    """

    pixels: Array
    inverse_range: Array
    inverse_range_sd: Array
    slope: Array


def sparse_depth(points_l_m: Array, T_c_l: RigidTransform, camera: Pinhole, noise: LidarNoise) -> SparseDepth:
    """Points of a sweep that the camera sees, with how well each tells the depth of the pixel it falls on.

    A range's noise is one part of that. The other: a point that falls beside its place tells the depth of a
    neighbour. How fast inverse range changes there is the root mean square slope to the six nearest points in
    the image, steep at edges. Points that others hide, as the LiDAR does not look from the camera's place,
    are left out.

    Parameters
    ----------
    points_l_m : array (N, 3)
        Points [m] in the LiDAR's axes.
    T_c_l : RigidTransform
        Takes them to the camera's [m].
    camera : Pinhole
        The camera.
    noise : LidarNoise
        How they err.

    Raises
    ------
    DataError
        If fewer points than seven fall into the image.
    """
    points_c = T_c_l.apply(points_l_m)
    pixels = camera.v2p(points_c)
    seen = np.asarray(camera.contains(pixels) & (points_c[:, 2] > 0))
    if seen.sum() <= NEIGHBOURS:
        found = f"{int(seen.sum())} of {len(points_c)}"
        raise DataError(f"{found} LiDAR points fall into the image: does the LiDAR sit there?")
    pixels, points_c = pixels[seen], points_c[seen]
    rho = 1 / np.linalg.norm(points_c, axis=1)
    apart_px, near = cKDTree(pixels).query(pixels, k=NEIGHBOURS + 1)
    apart_px, near = np.maximum(apart_px[:, 1:], 1.0), near[:, 1:]
    change = rho[near] - rho[:, None]
    nearer = change > HIDDEN_SHARE / (1 - HIDDEN_SHARE) * rho[:, None]
    hidden = (nearer & (apart_px < HIDDEN_WITHIN_PX)).any(axis=1)
    slope = np.sqrt(((change / apart_px) ** 2).mean(axis=1))
    sd = np.hypot(noise.range_m * rho**2, noise.misregistration_px * slope)
    return SparseDepth(*(values[~hidden] for values in (pixels, rho, sd, slope)))


def lidar_motion(
    previous: Image,
    current: Image,
    depth: SparseDepth,
    camera: Pinhole,
    method: FlowMethod,
    estimator: Estimator,
    seed: int = 0,
) -> EgoMotion:
    """Motion of the camera from flow at points of a LiDAR.

    What errors of depth move depends on the motion: it is estimated with exact depth first, then with how
    much wider the errors of flow are for it (`flowlik.egomotion.with_depth_errors`).

    Parameters
    ----------
    previous, current : uint8 array (H, W)
        Images k-1 and k.
    depth : SparseDepth
        Of image k-1.
    camera : Pinhole
        Camera of both.
    method : FlowMethod
        Flow that can be asked for at given pixels.
    estimator : Estimator
        Whose likelihood is the method's.
    seed : int
        Draws the samples.

    Raises
    ------
    DataError
        If points lie outside the images.
    ModelError
        If the likelihood is another method's.
    """
    residual, sd = lidar_residual(previous, current, depth, camera, method, estimator.likelihood)
    motion = estimator.estimate(residual, seed=seed)
    if not motion.solved:
        return motion
    wide = with_depth_errors(residual, estimator.likelihood, motion.T_k_prev, sd)
    return estimator.estimate(wide, seed=seed, start=motion.T_k_prev)


def lidar_residual(
    previous: Image,
    current: Image,
    depth: SparseDepth,
    camera: Pinhole,
    method: FlowMethod,
    likelihood: FlowLikelihood,
) -> tuple[KnownDepth, Array]:
    """Residual of flow at a LiDAR's points, and standard deviations (N,) [1/m] of their inverse ranges.

    Flow is measured at one point of each cell of 12 px, the one with most texture, and placed where the
    method says that it stands; depth there is that of the nearest point within 3 px, its deviation grown by
    the slope over what is between.

    Parameters
    ----------
    previous, current, depth, camera, method
        As for `lidar_motion`.
    likelihood : FlowLikelihood
        Whose signals are measured.

    Raises
    ------
    DataError
        If points lie outside the images.
    ModelError
        If the likelihood asks for a signal that is unknown.
    """
    texture, _ = eigenbasis(tensors_at(previous, depth.pixels, likelihood.texture))
    chosen = depth.pixels[_best_of_cells(depth.pixels, texture[:, 1])]
    m = measure(previous, current, method, likelihood.texture, chosen, likelihood.signals)
    apart_px, near = cKDTree(depth.pixels).query(m.pixels)
    close = (apart_px <= TAKEN_WITHIN_PX) & camera.contains(m.pixels)
    at, m = near[close], m.select(close)
    sd = np.hypot(depth.inverse_range_sd[at], apart_px[close] * depth.slope[at])
    excluded = {"no depth": int((~close).sum()), "no flow": m.lost}
    return KnownDepth(m, camera, depth.inverse_range[at], excluded), sd


def _best_of_cells(pixels: Array, texture: Array) -> NDArray[np.intp]:
    """Of the points in each square cell of the image the one with most texture."""
    cells = np.floor(pixels / CELL_PX).astype(np.int64)
    order = np.lexsort((-texture, cells[:, 0], cells[:, 1]))
    first = np.ones(len(order), dtype=bool)
    first[1:] = (np.diff(cells[order], axis=0) != 0).any(axis=1)
    return order[first]
