"""The Sequence protocol: what flowlik asks of a data set."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path
from typing import Protocol

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform

from flowlik.camera import Pinhole
from flowlik.datasets._truncation import is_whole
from flowlik.errors import DataError, MissingFieldError
from flowlik.motion import relative_motion


class Sequence(Protocol):
    """Frames of one camera in time order.

    What a data set lacks (poses, depth, ...) is not guessed: the method raises one DataError that
    names data set and field. ``name`` identifies the sequence in results.
    """

    name: str

    @property
    def camera(self) -> Pinhole:
        """The camera of every frame."""
        ...

    def __len__(self) -> int:
        """Return the number of frames."""
        ...

    def image(self, k: int) -> NDArray[np.uint8]:
        """Grey image (H, W) of frame k."""
        ...

    def timestamp(self, k: int) -> float:
        """Time [s] of frame k."""
        ...

    def T_n_c(self, k: int) -> RigidTransform:
        """Return the true pose of frame k, which takes points in {c} to points in {n} [m]."""
        ...

    def depth(self, k: int) -> NDArray[np.float64]:
        """Return the true depth (H, W) [m] along z at pixel centres; NaN where unknown, inf at the sky."""
        ...

    def flow(self, k: int) -> NDArray[np.float64]:
        """Return the true flow (H, W, 2) [px] from frame k to k + 1; NaN where unknown.

        Occluded pixels keep theirs.
        """
        ...


def lacks(name: str, field: str) -> MissingFieldError:
    """Make the one error for a field that a data set does not have."""
    return MissingFieldError(f"{name}: this data set has no {field}")


def read_grey(path: Path | str) -> NDArray[np.uint8]:
    """Read an image file as grey uint8 (H, W).

    Colour becomes grey by OpenCV's weights (0.299 R + 0.587 G + 0.114 B), rounded once.

    Raises
    ------
    DataError
        If the file is missing, truncated or not an image.
    """
    # The decoders' own conversions to grey differ in weights and rounding, so colour is read as colour.
    image = decode_image(path, cv2.IMREAD_ANYCOLOR)
    if image.ndim == 3:
        image = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
    return np.asarray(image, dtype=np.uint8)


def decode_image(path: Path | str, flags: int) -> NDArray:
    """Decode an image file as ``cv2.imread`` does with ``flags``, refusing incomplete files.

    Raises
    ------
    DataError
        If the file is missing, truncated or not an image.
    """
    try:
        data = Path(path).read_bytes()
    except FileNotFoundError as error:
        raise DataError(f"{path}: no such image file") from error
    except OSError as error:
        raise DataError(f"{path}: cannot be read ({error.strerror})") from error
    image = None
    if data and is_whole(data):
        with suppress(cv2.error):
            image = cv2.imdecode(np.frombuffer(data, dtype=np.uint8), flags)
    if image is None:
        raise DataError(f"{path}: not a readable image (truncated, damaged or not an image file)")
    return np.asarray(image)


def frame_index(sequence: Sequence, k: int) -> int:
    """Frame number k, or a DataError that says how many frames there are."""
    if not 0 <= k < len(sequence):
        raise DataError(f"{sequence.name}: no frame {k}, there are {len(sequence)} frames")
    return int(k)


def motion_to_next(sequence: Sequence, k: int) -> RigidTransform:
    """Motion T_k1_k: camera of frame k to camera of frame k + 1."""
    return relative_motion(sequence.T_n_c(k), sequence.T_n_c(frame_index(sequence, k) + 1))


def true_flow(camera: Pinhole, depth: NDArray[np.float64], T_k1_k: RigidTransform) -> NDArray[np.float64]:
    """Flow of a static scene from depth and motion: g of the paper's Eq. (1) minus the pixel.

    Parameters
    ----------
    camera : Pinhole
        The camera.
    depth : array (H, W)
        Depth along z [m] in frame k; inf (sky) moves with the rotation alone.
    T_k1_k : RigidTransform
        Takes points from the camera of frame k to that of frame k + 1 [m].

    Returns
    -------
    array (H, W, 2)
        Flow [px]; NaN where depth is not positive or the point falls behind the camera.
    """
    pixels = camera.pixel_grid().reshape(*depth.shape, 2)
    return camera.v2p(_moved_rays(camera, depth, T_k1_k)) - pixels


def visible_next(
    camera: Pinhole,
    depth: NDArray[np.float64],
    next_depth: NDArray[np.float64],
    T_k1_k: RigidTransform,
    tolerance: float = 0.02,
) -> NDArray[np.bool_]:
    """Pixels (H, W) of frame k seen again in frame k + 1.

    A pixel is visible if its true end lies in the image and the depths of all four pixels around that end
    agree with the predicted depth within a relative tolerance. Other parameters are those of `true_flow`.
    """
    moved = _moved_rays(camera, depth, T_k1_k)
    ends = camera.v2p(moved)
    inside = camera.contains(ends)
    column, row = np.floor(np.where(inside[..., None], ends, 0)).astype(np.int64).transpose(2, 0, 1)
    right, below = np.minimum(column + 1, camera.width - 1), np.minimum(row + 1, camera.height - 1)
    nearby = np.stack([next_depth[r, c] for r in (row, below) for c in (column, right)])
    # in inverse depth, so that sky (0) agrees with sky
    with np.errstate(invalid="ignore", divide="ignore"):
        predicted, found = 1 / (depth * moved[..., 2]), 1 / nearby
    return inside & (np.abs(found - predicted) <= tolerance * predicted).all(axis=0)


def _moved_rays(camera: Pinhole, depth: NDArray[np.float64], T_k1_k: RigidTransform) -> NDArray[np.float64]:
    """Points (H, W, 3) of frame k in the camera of frame k + 1, over their depth in frame k; else NaN."""
    rays = camera.rays(camera.pixel_grid())
    inverse_depth = 1 / np.where(depth > 0, depth, np.nan).reshape(-1, 1)
    moved = rays @ T_k1_k.rotation.as_matrix().T + T_k1_k.translation * inverse_depth
    return moved.reshape(*depth.shape, 3)
