"""The ImageSequence protocol: what flowlik asks of a data set."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from enum import IntFlag
from pathlib import Path
from typing import Protocol, TypeVar, cast

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform

from flowlik.datasets._truncation import claimed_size, is_whole
from flowlik.errors import DataError, MissingFieldError
from flowlik.geometry.camera import Pinhole
from flowlik.geometry.motion import relative_motion

MAX_PIXELS = 2**27
"""Pixels an image may have; a header that claims more is taken for damage before memory is asked for."""

MAX_FILE_BYTES = 2**30

NO_TIMES = "frame number"
"""What images without times give as ``times_source``."""

_T = TypeVar("_T", bound=np.generic)


class ImageSequence(Protocol):
    """Frames of one camera in time order.

    What a data set lacks (poses, depth, ...) is not guessed: the method raises one DataError that
    names data set and field. ``name`` identifies the sequence in results. A reader that had to choose how it
    takes its files says so in ``notes``, see `notes_of`. Not every pixel need be usable: a sequence may have
    a method ``mask(k)``, which `mask_of` asks.
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


def shape_of(sequence: ImageSequence) -> tuple[int, int]:
    """Height and width of the images, of the first one where they differ."""
    height, width = getattr(sequence, "shape", None) or sequence.image(0).shape
    return height, width


def mask_of(sequence: ImageSequence, k: int) -> NDArray[np.bool_] | None:
    """Usable pixels (H, W) of frame k, or None if all are: what lies beyond a lens or under a mask is not."""
    mask = getattr(sequence, "mask", None)
    return None if mask is None else mask(k)


class PairSequence:
    """Base of data sets of isolated image pairs: frames 2i and 2i + 1 are a pair, and no others are.

    Such a data set meets the `ImageSequence` protocol, but ``flow(k)`` is there for even k only, and images
    of different pairs may differ in size. Walk over `frame_pairs` and both kinds are served.
    """

    isolated_pairs = True


def frame_pairs(sequence: ImageSequence | PairSequence) -> range:
    """First frames k of the image pairs (k, k + 1) of a sequence.

    Every frame but the last begins one, or in a `PairSequence`, wrapped or not, every second frame.
    """
    frames = len(cast(ImageSequence, sequence))
    isolated = getattr(sequence, "isolated_pairs", False)
    return range(0, frames - 1, 2) if isolated else range(max(frames - 1, 0))


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
        If the file is missing, truncated or not an image, or its header claims more than `MAX_PIXELS`.
    """
    try:
        if Path(path).stat().st_size > MAX_FILE_BYTES:
            raise DataError(f"{path}: an image file of more than {MAX_FILE_BYTES >> 20} MiB is not read")
        data = Path(path).read_bytes()
    except FileNotFoundError as error:
        raise DataError(f"{path}: no such image file") from error
    except OSError as error:
        raise DataError(f"{path}: cannot be read ({error.strerror})") from error
    except ValueError as error:  # a list of files that is damaged
        raise DataError(f"{str(path)!r}: not the name of a file") from error
    return decode_bytes(data, path, flags)


def decode_bytes(data: bytes, path: Path | str, flags: int) -> NDArray:
    """Decode an image that is in memory, as `decode_image`; ``path`` begins the message of an error.

    Raises
    ------
    DataError
        If it is truncated or not an image, or its header claims more than `MAX_PIXELS`.
    """
    width, height = claimed_size(data) or (0, 0)
    if width * height > MAX_PIXELS:
        found = f"its header claims {width} x {height} pixels"
        raise DataError(f"{path}: {found}, more than the {MAX_PIXELS} an image may have")
    image = None
    if data and is_whole(data):
        with suppress(cv2.error):
            image = cv2.imdecode(np.frombuffer(data, dtype=np.uint8), flags)
    if image is None:
        raise DataError(f"{path}: not a readable image (truncated, damaged or not an image file)")
    return np.asarray(image)


def of_size(values: NDArray[_T], shape: tuple[int, ...], path: Path, other: str) -> NDArray[_T]:
    """Pass on values (H, W, ...) of a file that must have the size (H, W) of ``other``.

    Raises
    ------
    DataError
        If they have another.
    """
    if values.shape[:2] != shape[:2]:
        raise DataError(f"{path}: {_size(values.shape)} pixels, but {other} has {_size(shape)}")
    return values


def _size(shape: tuple[int, ...]) -> str:
    return " x ".join(map(str, shape[1::-1]))


def notes_of(sequence: ImageSequence) -> tuple[str, ...]:
    """What the reader of a sequence chose and its user should know, a sentence each."""
    return tuple(getattr(sequence, "notes", ()))


def frame_index(sequence: ImageSequence, k: int) -> int:
    """Frame number k of a sequence.

    Raises
    ------
    DataError
        If there is no such frame; says how many there are.
    """
    if not 0 <= k < len(sequence):
        raise DataError(f"{sequence.name}: no frame {k}, there are {len(sequence)} frames")
    return int(k)


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
