"""A sequence some pixels of which are not used."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from flowlik.datasets._mask_file import read_mask
from flowlik.datasets._wrapped import Wrapped
from flowlik.datasets.base import ImageSequence, mask_of, shape_of
from flowlik.errors import DataError


class Masked(Wrapped):
    """A `ImageSequence` some pixels of which are not used: a hood, a rim, an arm.

    Parameters
    ----------
    inner : ImageSequence
        The sequence.
    usable : bool array (H, W)
        Which pixels of every image may be used.

    Raises
    ------
    DataError
        If the images are of another size.
    """

    def __init__(self, inner: ImageSequence, usable: NDArray[np.bool_]) -> None:
        super().__init__(inner)
        self._usable = usable
        _check(usable, self.shape, inner.name)

    def on(self, inner: ImageSequence) -> Masked:
        """Return another sequence with the same mask."""
        return Masked(inner, self._usable)

    def mask(self, k: int) -> NDArray[np.bool_]:
        """Usable pixels (H, W) of frame k.

        Raises
        ------
        DataError
            If its image is of another size than the first, as in a set of pairs.
        """
        if getattr(self.inner, "isolated_pairs", False):
            _check(self._usable, self.inner.image(k).shape, f"{self.name}, frame {k}")
        inner = mask_of(self.inner, k)
        return self._usable if inner is None else self._usable & inner


def masked(sequence: ImageSequence, path: Path | str | None) -> ImageSequence:
    """Sequence with a user's mask, which is of the images before they are undistorted or resized.

    Parameters
    ----------
    sequence : ImageSequence
        As `flowlik.open_sequence` opens it.
    path : Path or str, optional
        Mask file, see `flowlik.datasets._mask_file.read_mask`; without one the sequence stays as it is.

    Raises
    ------
    DataError
        If the file is no mask of these images.
    """
    if path is None:
        return sequence
    if isinstance(sequence, Wrapped):
        return sequence.on(masked(sequence.inner, path))
    return Masked(sequence, read_mask(path, shape_of(sequence)))


def _check(usable: NDArray[np.bool_], shape: tuple[int, ...], where: str) -> None:
    if usable.shape != shape:
        size, images = (" x ".join(map(str, sides[::-1])) for sides in (usable.shape, shape))
        raise DataError(f"{where}: a mask of {size} pixels for images of {images}")
