"""What becomes of a frame's pixels in the next one: true flow and visibility, from depth and motion."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntFlag

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform

from flowlik.datasets.base import ImageSequence, frame_index
from flowlik.geometry.camera import Pinhole
from flowlik.geometry.motion import relative_motion


class Visibility(IntFlag):
    """What becomes of a pixel in the next frame; the classes of `visibility_next`.

    One of VISIBLE, OCCLUDED and OUT_OF_VIEW (beyond the image or behind the camera, or of unknown depth), and
    SKY besides, where the pixel sees the sky: ``Visibility.SKY | Visibility.VISIBLE``.
    """

    VISIBLE = 0
    OCCLUDED = 1
    OUT_OF_VIEW = 2
    SKY = 4


@dataclass(frozen=True, eq=False)
class Movers:
    """Moving objects in a frame.

    Attributes
    ----------
    labels : int array (H, W)
        Which object is seen at the pixel centre, -1 for the static world.
    T_k1_k : RigidTransform (M,)
        Takes points of each object from the camera of frame k to that of frame k + 1 [m].
    """

    labels: NDArray[np.integer]
    T_k1_k: RigidTransform


def mover_motions(
    T_n_k: RigidTransform, T_n_k1: RigidTransform, T_n_o: RigidTransform, T_n_o1: RigidTransform
) -> RigidTransform:
    """Motions T_k1_k (M,) of objects as the camera sees them, from their poses and its own at two times."""
    return T_n_k1.inv() * T_n_o1 * T_n_o.inv() * T_n_k


def motion_to_next(sequence: ImageSequence, k: int) -> RigidTransform:
    """Motion T_k1_k: camera of frame k to camera of frame k + 1.

    Raises
    ------
    DataError
        If there is no frame k.
    """
    return relative_motion(sequence.T_n_c(k), sequence.T_n_c(frame_index(sequence, k) + 1))


def true_flow(
    camera: Pinhole, depth: NDArray[np.float64], T_k1_k: RigidTransform, movers: Movers | None = None
) -> NDArray[np.float64]:
    """Flow from depth and motion: g of the paper's Eq. (1) minus the pixel.

    Parameters
    ----------
    camera : Pinhole
        The camera.
    depth : array (H, W)
        Depth along z [m] in frame k; inf (sky) moves with the rotation alone.
    T_k1_k : RigidTransform
        Takes points of the static scene from the camera of frame k to that of frame k + 1 [m].
    movers : Movers, optional
        Objects that have a motion of their own.

    Returns
    -------
    array (H, W, 2)
        Flow [px]; NaN where depth is not positive or the point falls behind the camera.
    """
    pixels = camera.pixel_grid().reshape(*depth.shape, 2)
    return camera.v2p(_moved_rays(camera, depth, T_k1_k, movers)) - pixels


def visibility_next(
    camera: Pinhole,
    depth: NDArray[np.float64],
    next_depth: NDArray[np.float64],
    T_k1_k: RigidTransform,
    movers: Movers | None = None,
    tolerance: float = 0.02,
) -> NDArray[np.uint8]:
    """Class (H, W) of each pixel of frame k, a `Visibility`.

    A pixel is visible if its true end lies in the image and the depths of all four pixels around that end
    agree with the predicted depth within a relative tolerance. Other parameters are those of `true_flow`.
    """
    moved = _moved_rays(camera, depth, T_k1_k, movers)
    ends = camera.v2p(moved)
    inside = camera.contains(ends)
    ends = np.where(inside[..., None], ends, 0)
    # an end on a pixel's centre, but for rounding, has no neighbours beyond that pixel
    column, row = np.floor(ends + 1e-6).astype(np.int64).transpose(2, 0, 1)
    right, below = np.ceil(ends - 1e-6).astype(np.int64).transpose(2, 0, 1)
    nearby = np.stack([next_depth[r, c] for r in (row, below) for c in (column, right)])
    # in inverse depth, so that sky (0) agrees with sky
    with np.errstate(invalid="ignore", divide="ignore"):
        predicted, found = 1 / (depth * moved[..., 2]), 1 / nearby
    again = (np.abs(found - predicted) <= tolerance * predicted).all(axis=0)
    seen = np.where(again, Visibility.VISIBLE, Visibility.OCCLUDED)
    sky = np.where(np.isposinf(depth), Visibility.SKY, 0)
    return (np.where(inside, seen, Visibility.OUT_OF_VIEW) | sky).astype(np.uint8)


def is_visible(classes: NDArray[np.uint8]) -> NDArray[np.bool_]:
    """Which pixels (H, W) of these classes are seen again in the next frame, sky or not."""
    return (classes & (Visibility.OCCLUDED | Visibility.OUT_OF_VIEW)) == 0


def _moved_rays(
    camera: Pinhole, depth: NDArray[np.float64], T_k1_k: RigidTransform, movers: Movers | None
) -> NDArray[np.float64]:
    """Points (H, W, 3) of frame k in the camera of frame k + 1, over their depth in frame k; else NaN."""
    rays = camera.rays(camera.pixel_grid())
    inverse_depth = 1 / np.where(depth > 0, depth, np.nan).reshape(-1, 1)
    moved = _moved(rays, inverse_depth, T_k1_k)
    if movers is not None:
        labels = movers.labels.ravel()
        for m in np.unique(labels[labels >= 0]):
            mine = labels == m
            moved[mine] = _moved(rays[mine], inverse_depth[mine], movers.T_k1_k[m])
    return moved.reshape(*depth.shape, 3)


def _moved(
    rays: NDArray[np.float64], inverse_depth: NDArray[np.float64], T: RigidTransform
) -> NDArray[np.float64]:
    return np.asarray(rays @ T.rotation.as_matrix().T + T.translation * inverse_depth)
