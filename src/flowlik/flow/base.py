"""The FlowMethod protocol: a two-frame optical flow with a name and frozen parameters."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import fields
from functools import cache
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from flowlik.errors import DataError
from flowlik.image.sampling import bilinear
from flowlik.image.texture import Gradients
from flowlik.support.arrays import Array

if TYPE_CHECKING:
    from flowlik.datasets.base import ImageSequence

Image = NDArray[np.uint8]
FlowAt = Callable[[Array], Array]
"""Flow (N, 2) [px] of an image pair at pixels (N, 2)."""

ZERO_ALLOWED = {"zero": True}
"""Metadata of a field for a parameter that may be 0; others must be above it."""
NOT_RECORDED = {"recorded": False}
"""Metadata of a field that belongs to one machine or run, and so not to a model file."""


class FlowMethod(Protocol):
    """Two-frame flow as a frozen dataclass: its fields are the parameters that a model file records."""

    name: ClassVar[str]

    def measure(self, previous: Image, current: Image) -> tuple[Array, Array]:
        """Pixels (N, 2) the method chooses and their flow (N, 2) [px]; NaN where it fails."""
        ...

    def measure_at(self, previous: Image, current: Image, pixels: Array) -> Array:
        """Flow (N, 2) [px] at given pixels (N, 2), sub-pixel or whole; NaN where it fails or outside."""
        ...


def describe(method: FlowMethod) -> dict[str, Any]:
    """Name and parameters of a method, as a model file records them."""
    recorded = [f.name for f in fields(method) if f.metadata.get("recorded", True)]  # type: ignore[arg-type]
    return {"name": method.name, **{name: getattr(method, name) for name in recorded}}


class FlowOfPairs(ABC):
    """Part of a method whose flow comes with a sequence's frame numbers, not from the images alone."""

    @abstractmethod
    def for_pair(self, sequence: ImageSequence, k: int) -> FlowMethod:
        """Return the method that gives the flow from frame k to k + 1; it is recorded as this one is."""

    @abstractmethod
    def backward(self) -> FlowMethod:
        """Return the method that gives the flow from frame k + 1 to k of the same pair."""


class Windowed(ABC):
    """Part of a method that finds one motion for all that its window holds."""

    @abstractmethod
    def anchors(self, gradients: Gradients, pixels: Array) -> Array:
        """Where in the image (N, 2) [px] the motion measured at pixels (N, 2) is that of the scene.

        ``gradients`` are the image's, as `flowlik.image.texture.derivatives` gives them.
        """


class TwoWay(ABC):
    """Part of a sparse method whose flow there and back share work."""

    @abstractmethod
    def choose(self, previous: Image) -> Array:
        """Pixels (N, 2) where it measures by its own choice."""

    @abstractmethod
    def both_ways(self, previous: Image, current: Image) -> tuple[FlowAt, FlowAt]:
        """Flow (N, 2) [px] as functions of pixels (N, 2): from previous to current, and back."""


class DenseMaps(NamedTuple):
    """Flow (H, W, 2) [px] of every pixel, and its standard deviations along u and v (H, W, 2), if told."""

    flow: NDArray[np.float32]
    own_uncertainty: NDArray[np.float32] | None = None


class DensePairs(ABC):
    """Part of a dense method that takes several image pairs in one go, or tells its own uncertainty."""

    @property
    @abstractmethod
    def tells_uncertainty(self) -> bool:
        """Whether it tells its own uncertainty."""

    @abstractmethod
    def maps(self, pairs: Sequence[tuple[Image, Image]]) -> list[DenseMaps]:
        """Maps of image pairs of one size."""


class Samplers(NamedTuple):
    """Flow (N, 2) [px] of an image pair as functions of pixels (N, 2), there and back.

    ``own_uncertainty`` gives the method's own standard deviations (N, 2) [px] of the flow there, if it tells
    any.
    """

    there: FlowAt
    back: FlowAt
    own_uncertainty: FlowAt | None = None


def method_for_pair(method: FlowMethod, sequence: ImageSequence, k: int) -> FlowMethod:
    """Return the method to use from frame k to k + 1 of a sequence: the method itself, but for flow on disk.

    Whoever measures a sequence calls this before each pair.
    """
    return method.for_pair(sequence, k) if isinstance(method, FlowOfPairs) else method


def backward_method(method: FlowMethod) -> FlowMethod:
    """Return the method for ``measure_at(current, previous, ends)``: itself, but for flow on disk."""
    return method.backward() if isinstance(method, FlowOfPairs) else method


def check_pair(previous: Image, current: Image) -> None:
    """Check that both are grey uint8 images of one size.

    Raises
    ------
    DataError
        If they are not.
    """
    for image in (previous, current):
        if image.ndim != 2 or image.dtype != np.uint8:
            raise DataError(f"an image must be grey uint8 (H, W), not {image.dtype} {image.shape}")
    if previous.shape != current.shape:
        sizes = " and ".join(f"{image.shape[1]}x{image.shape[0]}" for image in (previous, current))
        raise DataError(f"the two images differ in size: {sizes}")


def all_pixels(shape: tuple[int, ...]) -> Array:
    """Pixel centres (H * W, 2) of an image (H, W), in row-major order."""
    v, u = np.mgrid[0 : shape[0], 0 : shape[1]]
    return np.stack([u.ravel(), v.ravel()], axis=-1).astype(np.float64)


def as_dense(flow: NDArray[np.floating]) -> NDArray[np.float32]:
    """Flow (H, W, 2) of others as a dense method gives it: NaN in both components where not finite."""
    with np.errstate(over="ignore"):
        dense = flow.astype(np.float32)
    dense[~np.isfinite(dense).all(axis=-1)] = np.nan
    return dense


def inside_image(pixels: Array, shape: tuple[int, ...]) -> NDArray[np.bool_]:
    """Which positions (N, 2) lie within the outermost pixel centres of an image (H, W, ...); NaN does not."""
    return np.asarray(((pixels >= 0) & (pixels <= [shape[1] - 1, shape[0] - 1])).all(axis=1))


def _sample_dense(flow: NDArray[np.float32], pixels: Array) -> Array:
    """Dense flow (H, W, 2) at pixels (N, 2): exact at whole pixels, bilinear between, NaN outside."""
    inside = inside_image(pixels, flow.shape)
    if not inside.all():
        sampled = np.full((len(pixels), 2), np.nan)
        sampled[inside] = _sample_dense(flow, pixels[inside])
        return sampled
    whole = np.rint(pixels)
    if np.array_equal(whole, pixels):
        u, v = whole.astype(int).T
        return flow[v, u].astype(np.float64)
    return bilinear(flow, pixels)


def samplers(method: FlowMethod, previous: Image, current: Image, both: bool = False) -> Samplers:
    """Flow of an image pair as functions of pixels; a dense one is computed once each way, at most.

    ``both`` says that both ways will be asked for, so that one call may give them.
    """
    if isinstance(method, TwoWay):
        return Samplers(*method.both_ways(previous, current))
    if isinstance(method, DensePairs):
        return _samplers_of_maps(method, previous, current, both)
    back = cache(lambda: _sampler(backward_method(method), current, previous))
    return Samplers(_sampler(method, previous, current), lambda pixels: back()(pixels))


def _samplers_of_maps(method: DensePairs, previous: Image, current: Image, both: bool) -> Samplers:
    pairs = [(previous, current), (current, previous)]
    together = cache(lambda: method.maps(pairs))
    alone = cache(lambda way: method.maps(pairs[way : way + 1])[0])

    def maps(way: int) -> DenseMaps:
        return together()[way] if both else alone(way)

    def own(pixels: Array) -> Array:
        uncertainty = maps(0).own_uncertainty
        assert uncertainty is not None
        return _sample_dense(uncertainty, pixels)

    return Samplers(
        lambda pixels: _sample_dense(maps(0).flow, pixels),
        lambda pixels: _sample_dense(maps(1).flow, pixels),
        own if method.tells_uncertainty else None,
    )


def _sampler(method: FlowMethod, previous: Image, current: Image) -> FlowAt:
    if not isinstance(method, DenseFlow):
        return lambda pixels: method.measure_at(previous, current, pixels)
    dense = cache(lambda: method.dense(previous, current))
    return lambda pixels: _sample_dense(dense(), pixels)


class DenseFlow(ABC):
    """Common part of dense methods: they say `dense`, this says the rest."""

    @abstractmethod
    def dense(self, previous: Image, current: Image) -> NDArray[np.float32]:
        """Flow (H, W, 2) [px] of every pixel."""

    def measure(self, previous: Image, current: Image) -> tuple[Array, Array]:
        """Flow of all pixels in row-major order: pixels (H * W, 2) and flow (H * W, 2) [px]."""
        return all_pixels(previous.shape), self.dense(previous, current).reshape(-1, 2).astype(np.float64)

    def measure_at(self, previous: Image, current: Image, pixels: Array) -> Array:
        """Flow (N, 2) [px] at given pixels (N, 2), bilinear between pixel centres; NaN outside the image.

        The whole image is measured on every call.
        """
        return _sample_dense(self.dense(previous, current), pixels)
