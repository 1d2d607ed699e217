"""A sequence through a lens that distorts, as a pinhole camera would have seen it."""

from __future__ import annotations

from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from flowlik.datasets._lens import Lens
from flowlik.datasets._wrapped import Wrapped
from flowlik.datasets.base import ImageSequence, mask_of
from flowlik.datasets.next_frame import is_visible, motion_to_next, true_flow, visibility_next
from flowlik.geometry.camera import Pinhole
from flowlik.image.sampling import sample_inverse_depth
from flowlik.support.arrays import Array


class Undistorted(Wrapped):
    """A `ImageSequence` whose images, and depth where there is any, are undistorted as they are read.

    Images are sampled bicubically, depth bilinearly on one surface and at the nearest pixel at its edges.
    Flow and visibility are those of depth and poses; a data set's own flow belongs to the distorted images
    and is not passed on, nor are images of a second camera, which has a lens of its own. Pixels that the
    original does not show are black, and `mask` says so.

    Parameters
    ----------
    inner : ImageSequence
        The sequence as its images are.
    lens : Lens
        Its lens.
    """

    def __init__(self, inner: ImageSequence, lens: Lens) -> None:
        super().__init__(inner)
        self.lens = lens

    def on(self, inner: ImageSequence) -> Undistorted:
        """Return another sequence undistorted by the same lens."""
        return Undistorted(inner, self.lens)

    @property
    def camera(self) -> Pinhole:
        """The pinhole camera of the undistorted images."""
        return self.lens.pinhole(self.shape)

    def image(self, k: int) -> NDArray[np.uint8]:
        """Undistorted grey image (H, W) of frame k."""
        return self.lens.undistort(self.inner.image(k))

    @cached_property
    def valid(self) -> NDArray[np.bool_]:
        """Pixels (H, W) that the original images show, with all that interpolation needs."""
        return self.lens.valid(self.shape)

    def mask(self, k: int) -> NDArray[np.bool_]:
        """Usable pixels (H, W) of frame k: shown, and made of usable pixels of the original."""
        usable = mask_of(self.inner, k)
        return self.valid if usable is None else self.lens.straighten_mask(usable)

    def depth(self, k: int) -> Array:
        """Return the depth (H, W) [m] along z of the undistorted pixels; NaN where unknown."""
        depth = self.inner.depth(k)
        columns, rows = self.lens.maps(depth.shape)
        at = np.stack([columns, rows], axis=-1)[self.valid].astype(np.float64)
        found = np.full(depth.shape, np.nan)
        with np.errstate(divide="ignore"):
            found[self.valid] = 1 / sample_inverse_depth(depth, at)
        return found

    def flow(self, k: int) -> Array:
        """Return the flow (H, W, 2) [px] of depth and poses; occluded pixels keep theirs."""
        return true_flow(self.camera, self.depth(k), motion_to_next(self, k))

    def visible(self, k: int) -> NDArray[np.bool_]:
        """Return which pixels (H, W) of frame k the depth of frame k + 1 shows again."""
        motion = motion_to_next(self, k)
        return is_visible(visibility_next(self.camera, self.depth(k), self.depth(k + 1), motion))


def removed_lens(sequence: ImageSequence) -> Lens | None:
    """Lens whose distortion was removed from a sequence's images, through what is around it; None if none."""
    inner: ImageSequence | None = sequence
    while inner is not None and not isinstance(inner, Undistorted):
        inner = inner.inner if isinstance(inner, Wrapped) else inner.__dict__.get("whole")
    return None if inner is None else inner.lens
