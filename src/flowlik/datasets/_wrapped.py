"""A sequence seen through another: what is not changed is passed on."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform

from flowlik.datasets.base import ImageSequence, mask_of, shape_of
from flowlik.geometry.camera import Pinhole
from flowlik.support.arrays import Array


class Wrapped(ABC):
    """Base of sequences that change the images of another one, a `ImageSequence` themselves.

    Parameters
    ----------
    inner : ImageSequence
        The sequence as it is.

    Raises
    ------
    AttributeError
        For what neither has.
    """

    def __init__(self, inner: ImageSequence) -> None:
        self.inner, self.name = inner, inner.name

    @property
    def shape(self) -> tuple[int, int]:
        """Height and width of the first image."""
        return shape_of(self.inner)

    @abstractmethod
    def on(self, inner: ImageSequence) -> Wrapped:
        """Return the same change of another sequence."""

    @property
    def camera(self) -> Pinhole:
        """The camera of every frame."""
        return self.inner.camera

    def __len__(self) -> int:
        """Return the number of frames."""
        return len(self.inner)

    def image(self, k: int) -> NDArray[np.uint8]:
        """Grey image (H, W) of frame k."""
        return self.inner.image(k)

    def mask(self, k: int) -> NDArray[np.bool_] | None:
        """Usable pixels (H, W) of frame k; None if all are."""
        return mask_of(self.inner, k)

    def timestamp(self, k: int) -> float:
        """Time [s] of frame k."""
        return self.inner.timestamp(k)

    def T_n_c(self, k: int) -> RigidTransform:
        """Return the true pose of frame k, which takes points in {c} to points in {n} [m]."""
        return self.inner.T_n_c(k)

    def depth(self, k: int) -> Array:
        """Return the true depth (H, W) [m] along z of frame k; NaN where unknown."""
        return self.inner.depth(k)

    def flow(self, k: int) -> Array:
        """Return the true flow (H, W, 2) [px] from frame k to k + 1; NaN where unknown."""
        return self.inner.flow(k)

    def __getattr__(self, name: str) -> Any:
        """What else the sequence has, such as its GPS positions."""
        if name.startswith("_") or name == "inner":
            raise AttributeError(name)
        return getattr(self.inner, name)
