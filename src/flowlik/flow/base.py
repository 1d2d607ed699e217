"""The FlowMethod protocol: a two-frame optical flow with a name and frozen parameters."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import asdict
from typing import Any, ClassVar, Protocol

import numpy as np
from numpy.typing import NDArray

from flowlik import _kernels
from flowlik.camera import Array
from flowlik.errors import DataError

Image = NDArray[np.uint8]


class FlowMethod(Protocol):
    """Two-frame flow as a frozen dataclass: its fields are the parameters that a model file records."""

    name: ClassVar[str]

    def measure(self, previous: Image, current: Image) -> tuple[Array, Array]:
        """Pixels (N, 2) the method chooses and their flow (N, 2) [px]; NaN where it fails."""
        ...

    def measure_at(self, previous: Image, current: Image, pixels: Array) -> Array:
        """Flow (N, 2) [px] at given pixels (N, 2); NaN where it fails."""
        ...


def describe(method: FlowMethod) -> dict[str, Any]:
    """Name and parameters of a method, as a model file records them."""
    return {"name": method.name, **asdict(method)}  # type: ignore[call-overload]


def check_pair(previous: Image, current: Image) -> None:
    """Raise DataError unless both are grey uint8 images of one size."""
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


def sample_dense(flow: NDArray[np.float32], pixels: Array) -> Array:
    """Dense flow (H, W, 2) at pixels (N, 2): exact at whole pixels, bilinear between."""
    u, v = pixels[:, 0], pixels[:, 1]
    whole = np.rint(pixels)
    if np.array_equal(whole, pixels):
        return flow[v.astype(int), u.astype(int)].astype(np.float64)
    return _kernels.bilinear(flow, np.ascontiguousarray(pixels, dtype=np.float64))


def sampler(method: FlowMethod, previous: Image, current: Image) -> Callable[[Array], Array]:
    """Flow (N, 2) [px] of an image pair as a function of pixels (N, 2); a dense one is computed once."""
    if isinstance(method, DenseFlow):
        flow = method.dense(previous, current)
        return lambda pixels: sample_dense(flow, pixels)
    return lambda pixels: method.measure_at(previous, current, pixels)


class DenseFlow(ABC):
    """Common part of dense methods: they say `dense`, this says the rest."""

    @abstractmethod
    def dense(self, previous: Image, current: Image) -> NDArray[np.float32]:
        """Flow (H, W, 2) [px] of every pixel."""

    def measure(self, previous: Image, current: Image) -> tuple[Array, Array]:
        """Flow of all pixels in row-major order: pixels (H * W, 2) and flow (H * W, 2) [px]."""
        return all_pixels(previous.shape), self.dense(previous, current).reshape(-1, 2).astype(np.float64)

    def measure_at(self, previous: Image, current: Image, pixels: Array) -> Array:
        """Flow (N, 2) [px] at given pixels (N, 2), bilinear between pixel centres."""
        return sample_dense(self.dense(previous, current), pixels)
