"""The ImageSequence protocol: what flowlik asks of a data set."""

from __future__ import annotations

from typing import Protocol, cast

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform

from flowlik.errors import DataError, MissingFieldError
from flowlik.geometry.camera import Pinhole

NO_TIMES = "frame number"
"""What images without times give as ``times_source``."""


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
