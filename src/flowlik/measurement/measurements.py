"""Measurements: what a pair of images says, the y of the paper with what its error depends on."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flowlik.errors import DataError
from flowlik.flow.base import (
    DenseFlow,
    FlowMethod,
    TwoWay,
    Windowed,
    all_pixels,
    check_pair,
    describe,
    samplers,
)
from flowlik.image.texture import Gradients, TextureDefinition, derivatives, eigenbasis, tensors_at
from flowlik.measurement._signals import Pair, signal
from flowlik.support.arrays import Array


@dataclass(frozen=True)
class Measurements:
    """Flow vectors of one image pair with their eigenbasis and covariates.

    Attributes
    ----------
    pixels : array (N, 2)
        Positions (u, v) in image k-1 [px] whose motion the flow is: where it was measured or, of a method
        with a window, its anchor near there.
    flow : array (N, 2)
        Measured flow [px] in {i}, finite.
    R_i_e : array (N, 2, 2)
        Eigenbasis of the structure tensor of image k-1 where the flow was measured.
    t : array (N, 2)
        Texture: eigenvalues t1 >= t2 [intensity^2/px^2] of the structure tensor.
    texture : TextureDefinition
        What t means.
    method : dict
        Flow method's name and parameters, as in model files.
    signals : dict of str to array (N,), (N, 2) or (N, 3)
        What else was measured about each vector, by its name in `flowlik.measurement.SIGNALS`; NaN
        where it failed.
    lost : int
        Asked-for pixels without a finite flow, left out.
    """

    pixels: Array
    flow: Array
    R_i_e: Array
    t: Array
    texture: TextureDefinition
    method: dict[str, Any]
    signals: dict[str, Array] = field(default_factory=dict)
    lost: int = 0

    def __len__(self) -> int:
        """Return the number of flow vectors."""
        return len(self.pixels)

    def select(self, which: NDArray[Any]) -> Measurements:
        """Return the measurements at an index or mask (N,)."""
        return replace(
            self,
            pixels=self.pixels[which],
            flow=self.flow[which],
            R_i_e=self.R_i_e[which],
            t=self.t[which],
            signals={name: values[which] for name, values in self.signals.items()},
        )

    def errors(self, true_flow: Array) -> Array:
        """Error components (N, 2) [px] in the eigenbasis, ``z = R_e_i (y - h)``; the paper's Eq. (9).

        Parameters
        ----------
        true_flow : array (N, 2)
            True or predicted flow h [px] of the same pixels.
        """
        return np.einsum("nij,ni->nj", self.R_i_e, self.flow - true_flow)


def measure(
    previous: NDArray[np.uint8],
    current: NDArray[np.uint8],
    method: FlowMethod,
    texture: TextureDefinition | None = None,
    pixels: Array | None = None,
    signals: Iterable[str] = (),
) -> Measurements:
    """Measure the flow between two grey images, with texture, eigenbasis and signals.

    Parameters
    ----------
    previous, current : uint8 array (H, W)
        Images k-1 and k.
    method : FlowMethod
        Flow method.
    texture : TextureDefinition, optional
        Definition of texture; the default is the paper's.
    pixels : array (N, 2), optional
        Where to measure [px]; by default where the method itself chooses. The vectors of a method with a
        window are placed near there (`flowlik.flow.base.Windowed`).
    signals : iterable of str
        Signals to measure besides, as a schedule's index names them.

    Raises
    ------
    DataError
        If the images differ in size or are not grey uint8, or pixels lie outside.
    ModelError
        If a signal is unknown.
    """
    check_pair(previous, current)
    signals = tuple(signals)
    flow_at, back_at, own_at = samplers(method, previous, current, both="discrepancy" in signals)
    if pixels is not None:
        pixels = _checked_pixels(pixels, previous.shape)
        flow = flow_at(pixels)
    elif isinstance(method, DenseFlow):
        pixels = all_pixels(previous.shape)
        flow = flow_at(pixels)
    elif isinstance(method, TwoWay):
        pixels = method.choose(previous)
        flow = flow_at(pixels)
    else:
        pixels, flow = method.measure(previous, current)
    gradients = derivatives(previous)
    m = _textured(previous, gradients, pixels, flow, method, texture)
    pair = Pair(previous, current, gradients, flow_at, back_at, m.pixels, m.flow, own_at)
    placed = method.anchors(gradients, m.pixels) if isinstance(method, Windowed) else m.pixels
    return replace(m, pixels=placed, signals={name: signal(name)(pair) for name in signals})


def attach_texture(
    previous: NDArray[np.uint8],
    pixels: Array,
    flow: Array,
    method: FlowMethod,
    texture: TextureDefinition | None = None,
) -> Measurements:
    """Measurements of flow (N, 2) [px] known at pixels (N, 2) of image k-1; NaN is left out.

    Raises
    ------
    DataError
        If the image is not grey uint8, or smaller than the texture's window.
    """
    return _textured(previous, None, pixels, flow, method, texture)


def _textured(
    previous: NDArray[np.uint8],
    gradients: Gradients | None,
    pixels: Array,
    flow: Array,
    method: FlowMethod,
    texture: TextureDefinition | None,
) -> Measurements:
    texture = texture or TextureDefinition()
    known = np.asarray(np.isfinite(flow).all(axis=1))
    pixels, flow = np.asarray(pixels[known], np.float64), np.asarray(flow[known], np.float64)
    t, R_i_e = eigenbasis(tensors_at(previous, pixels, texture, gradients))
    lost = int(np.sum(~known))
    return Measurements(pixels, flow, R_i_e, t, texture, describe(method), lost=lost)


def stratified_pixels(shape: tuple[int, int], count: int, rng: np.random.Generator, margin: int = 2) -> Array:
    """About `count` whole pixels (N, 2), one at random in each cell of a square grid over the image (H, W).

    The outermost `margin` pixels are left out.

    Raises
    ------
    DataError
        If the image is too small for so many.
    """
    height, width = shape[0] - 2 * margin, shape[1] - 2 * margin
    if min(height, width) < 1 or count < 1:
        raise DataError(f"cannot place {count} pixels in an image of {shape}")
    step = max(1.0, float(np.sqrt(height * width / count)))
    v, u = np.meshgrid(np.arange(0, height, step), np.arange(0, width, step), indexing="ij")
    jittered = np.stack([u, v], axis=-1).reshape(-1, 2) + step * rng.random((u.size, 2))
    inside = (jittered[:, 0] < width) & (jittered[:, 1] < height)
    return np.floor(jittered[inside]) + margin


def _checked_pixels(pixels: Array, shape: tuple[int, ...]) -> Array:
    pixels = np.asarray(pixels, dtype=np.float64)
    if pixels.ndim != 2 or pixels.shape[1] != 2:
        raise DataError(f"pixels must have shape (N, 2), not {pixels.shape}")
    limits = np.array([shape[1] - 1, shape[0] - 1])
    if not ((pixels >= 0) & (pixels <= limits)).all():
        raise DataError("pixels must lie inside the image and be finite")
    return pixels
