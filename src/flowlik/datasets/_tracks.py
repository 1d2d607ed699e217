"""Corners tracked from one image to the next, and what their errors have in common."""

from __future__ import annotations

from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform

from flowlik.geometry.camera import Pinhole
from flowlik.geometry.motion import epipolar_error, h
from flowlik.image.masks import clear
from flowlik.support.arrays import Array

CORNERS = 300
WINDOW = 9, 21
NEAR = 3, 11
SPACING_PX = 3, 10
AGAIN_PX = 0.5
CELLS, LEAST_IN_CELL, LEAST_CELLS = 4, 5, 4


class Tracks(NamedTuple):
    """Corners of an image and their motion to the next.

    Attributes
    ----------
    pixels, flow : array (N, 2)
        Where they are and how far they move [px].
    cells : int array (N,)
        In which cell of a grid over the image each lies.
    """

    pixels: Array
    flow: Array
    cells: NDArray[np.int64]


def track(
    previous: NDArray[np.uint8],
    current: NDArray[np.uint8],
    usable: NDArray[np.bool_] | None = None,
    known: NDArray[np.bool_] | None = None,
) -> Tracks:
    """Track corners by Lucas-Kanade's method; kept is what comes back to where it began.

    Parameters
    ----------
    previous, current : uint8 array (H, W)
        Images; of different sizes nothing is tracked.
    usable : bool array (H, W), optional
        Usable pixels of the first: no corner's window touches others.
    known : bool array (H, W), optional
        Where corners are wanted.
    """
    nothing = Tracks(np.empty((0, 2)), np.empty((0, 2)), np.empty(0, np.int64))
    if previous.shape != current.shape:
        return nothing
    window = _side(previous.shape, 16, WINDOW)
    wanted = np.ones(previous.shape, bool) if known is None else known
    if usable is not None:
        wanted = wanted & clear(usable, window // 2)
    spacing = float(np.clip(np.sqrt(previous.size) / 40, *SPACING_PX))
    mask = wanted.astype(np.uint8)
    found = cv2.goodFeaturesToTrack(previous, CORNERS, 0.01, spacing, mask=mask, blockSize=5)
    if found is None:
        return nothing
    corners = np.asarray(found, np.float32)
    ends, there = _lucas_kanade(previous, current, corners, window)
    begins, back = _lucas_kanade(current, previous, ends, window)
    kept = there & back & (np.abs(begins - corners).reshape(-1, 2).max(axis=1) < AGAIN_PX)
    pixels, ends = (points.reshape(-1, 2)[kept].astype(np.float64) for points in (corners, ends))
    column, row = (pixels / previous.shape[::-1] * CELLS).astype(np.int64).T
    return Tracks(pixels, ends - pixels, column * CELLS + row)


def _side(shape: tuple[int, ...], parts: int, limits: tuple[int, int]) -> int:
    """Odd side [px] of a window that is such a part of an image (H, W)."""
    return int(np.clip(np.sqrt(shape[0] * shape[1]) / parts, *limits)) // 2 * 2 + 1


def even(field: NDArray[np.floating], share: float, least: float = 0.0) -> NDArray[np.bool_]:
    """Where (H, W) a map (H, W, D) is known, and varies around by no more than a share of itself and so much.

    A corner at the edge of a thing belongs to one side of it, and no one knows to which.
    """
    known = np.isfinite(field).all(axis=-1)
    if not known.any():
        return known
    values = np.where(known[..., None], field, np.nan).astype(np.float32)
    side = _side(known.shape, 32, NEAR)
    window = np.ones((side, side), np.uint8)
    most = cv2.dilate(np.nan_to_num(values, nan=-np.inf), window).reshape(values.shape)
    fewest = cv2.erode(np.nan_to_num(values, nan=np.inf), window).reshape(values.shape)
    with np.errstate(invalid="ignore", over="ignore"):
        spread, size = (np.linalg.norm(v, axis=-1) for v in (most - fewest, values))
        return np.asarray(known & (spread <= share * size + least))


def _lucas_kanade(
    previous: NDArray[np.uint8], current: NDArray[np.uint8], points: NDArray[np.float32], window: int
) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    ends, found, _ = cv2.calcOpticalFlowPyrLK(
        previous, current, points, np.empty_like(points), winSize=(window, window), maxLevel=4
    )
    return np.asarray(ends, np.float32), found.ravel() == 1


def in_common(errors: Array, cells: NDArray[np.int64]) -> float:
    """How far vectors (N, D) lie from zero together: the median, over an image's cells, of their medians.

    What is random from track to track falls out of a cell's median; a wrong truth does not. NaN where too
    few cells have tracks.
    """
    known = np.isfinite(errors).all(axis=1)
    errors, cells = errors[known], cells[known]
    there, counts = np.unique(cells, return_counts=True)
    there = there[counts >= LEAST_IN_CELL]
    if len(there) < LEAST_CELLS:
        return np.nan
    medians = np.array([np.median(errors[cells == cell], axis=0) for cell in there])
    return float(np.median(np.linalg.norm(medians, axis=1)))


def epipolar_errors(camera: Pinhole, tracks: Tracks, T_k_prev: RigidTransform) -> Array:
    """Signed distances (N, 1) [px] of the tracks' ends to their epipolar lines; vectors (N, 2) for a turn."""
    if not T_k_prev.translation.any():
        return tracks.flow - h(T_k_prev, camera, tracks.pixels, np.zeros(len(tracks.pixels)))
    with np.errstate(invalid="ignore", divide="ignore"):
        return epipolar_error(T_k_prev, camera, tracks.pixels, tracks.flow)[0][:, None]
