"""A network's flow: any dense two-image network in an ONNX file (extra ``onnx``)."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar

import cv2
import numpy as np
from numpy.typing import NDArray

from flowlik.errors import DataError, ModelError
from flowlik.flow._onnx_graph import GraphForm, Network, dense_maps, network
from flowlik.flow.base import NOT_RECORDED, DenseFlow, DenseMaps, DensePairs, Image, as_dense, check_pair
from flowlik.support.threads import THREADS

LABEL = re.compile(r"\w[\w.-]*")
CHOICES = {
    "normalise": ("none", "imagenet"),
    "order": ("previous-first", "current-first"),
    "axes": ("uv", "vu"),
    "fit": ("pad", "resize"),
    "uncertainty_is": ("scale", "log-scale", "variance", "log-variance", "mixture"),
}
IMAGENET = np.array([[0.485, 0.456, 0.406], [0.229, 0.224, 0.225]])


@dataclass(frozen=True)
class OnnxFlow(DenseFlow, DensePairs):
    """Dense flow of a network in an ONNX file, made by `flowlik.flow.onnx_flow`.

    What the graph tells (its inputs, channels, size, type and batch) is read from it. The rest are the
    parameters here. Images are grey: a network of three colours gets the same image three times.

    Parameters
    ----------
    label : str
        Which network this is, for results and file names.
    sha256 : str
        Of the file's content: a model file records it, so that other weights are another method.
    low, high : float
        What grey levels 0 and 255 are to the network.
    normalise : {"none", "imagenet"}
        Whether each channel is normalised by ImageNet's mean and deviation instead.
    order : {"previous-first", "current-first"}
        Which image comes first.
    axes : {"uv", "vu"}
        Which component of the flow comes first: along the columns (u) or along the rows (v).
    scale : float
        What the output is multiplied by to be in pixels of its own size.
    fit : {"pad", "resize"}
        How images come to a size that the graph takes: edges repeated on all sides, or scaled.
    multiple : int
        Sides of images must be a multiple of it [px], where the graph leaves the size free.
    output : str
        Name of the output that is the flow; by default the last one of two channels with the most pixels.
    uncertainty : str
        Name of an output that is the network's own uncertainty of its flow, if it has one: one value a pixel,
        or two, for u and v.
    uncertainty_is : {"scale", "log-scale", "variance", "log-variance", "mixture"}
        What it holds, in the flow's unit; of a mixture half its channels are logarithms of weights and half
        those of Laplacian scales.
    path : Path, optional
        The file; it belongs to one machine and is not recorded.
    threads : int
        Threads of the processor that one call uses; not recorded.
    batch : int
        1 where a graph does not take more pairs a call though it says so; not recorded.

    Raises
    ------
    ModelError
        If a parameter is not of these.
    """

    name: ClassVar[str] = "onnx"
    label: str
    sha256: str
    low: float = 0.0
    high: float = 1.0
    normalise: str = "none"
    order: str = "previous-first"
    axes: str = "uv"
    scale: float = 1.0
    fit: str = "pad"
    multiple: int = 64
    output: str = ""
    uncertainty: str = ""
    uncertainty_is: str = "scale"
    path: Path | None = field(default=None, metadata=NOT_RECORDED)
    threads: int = field(default=THREADS, metadata=NOT_RECORDED)
    batch: int = field(default=2, metadata=NOT_RECORDED)

    def __post_init__(self) -> None:
        numbers = (self.low, self.high, self.scale)
        texts = (self.label, self.sha256, self.output, self.uncertainty)
        if not all(isinstance(text, str) for text in texts) or not LABEL.fullmatch(self.label):
            raise ModelError(f"a network's label has letters, digits and . _ - only, not {self.label!r}")
        if not all(type(n) in (int, float) and np.isfinite(n) for n in numbers) or self.high == self.low:
            raise ModelError(f"network {self.label}: range and scale must be finite numbers, not {numbers}")
        if self.scale == 0:
            raise ModelError(f"network {self.label}: a scale of 0 makes no flow")
        for name, choices in CHOICES.items():
            if getattr(self, name) not in choices:
                known = ", ".join(choices)
                raise ModelError(
                    f"network {self.label}: {name} must be one of {known}, not {getattr(self, name)!r}"
                )
        counts = {"multiple": self.multiple, "threads": self.threads, "batch": self.batch}
        for name, value in counts.items():
            if type(value) is not int or not 0 < value <= 4096:
                raise ModelError(
                    f"network {self.label}: {name} must be a whole number above 0, not {value!r}"
                )

    @property
    def tells_uncertainty(self) -> bool:
        """Whether the network gives its own uncertainty."""
        return bool(self.uncertainty)

    def dense(self, previous: Image, current: Image) -> NDArray[np.float32]:
        """Flow (H, W, 2) [px] of every pixel; NaN where the network's is not finite.

        Raises
        ------
        DataError
            If the images differ, the graph does not take them, or its flow is finite nowhere.
        ModelError
            If the graph has no such outputs.
        """
        return self.maps([(previous, current)])[0].flow

    def maps(self, pairs: Sequence[tuple[Image, Image]]) -> list[DenseMaps]:
        """Flow, and the network's own uncertainty of it, of image pairs of one size: in one call if it can.

        Raises
        ------
        DataError
            If the images differ, the graph does not take them, or its flow is finite nowhere.
        ModelError
            If the graph has no such outputs.
        """
        for pair in pairs:
            check_pair(*pair)
        ready = self.ready()
        at_once = 1 if self.batch == 1 else (ready.form.pairs or len(pairs))
        found: list[DenseMaps] = []
        for first in range(0, len(pairs), at_once):
            some = list(pairs[first : first + at_once])
            # a graph of so many pairs takes no fewer: the last is repeated
            some += [some[-1]] * ((ready.form.pairs or 1) - len(some))
            found += self._run(ready, some)[: len(pairs) - first]
        return found

    def ready(self) -> Network:
        """Return the network, loaded once a process.

        Raises
        ------
        DataError
            If its file is not said, not there, or of another content than recorded.
        ModelError
            If it is no ONNX network of two images.
        MissingExtraError
            If onnxruntime is not installed.
        """
        if self.path is None:
            raise DataError(f"network {self.label!r}: it is not said where its file is")
        return network(self.path, self.sha256, self.threads)

    def _run(self, ready: Network, pairs: Sequence[tuple[Image, Image]]) -> list[DenseMaps]:
        shape = pairs[0][0].shape
        size = self._size(ready.form, shape)
        before = [(side - own) // 2 for own, side in zip(shape, size)]
        stacked = np.stack([[self._fitted(image, size, before) for image in pair] for pair in pairs])
        stacked = stacked if self.order == "previous-first" else stacked[:, ::-1]
        outputs = ready.run(self._values(stacked, ready.form.colours))
        maps = dense_maps(outputs, size)
        flow = self._whole(self._flow_of(maps, outputs), size, before, shape)
        flow = np.float32(self.scale) * (flow if self.axes == "uv" else flow[..., ::-1])
        if not np.isfinite(flow).all(axis=-1).any():
            raise DataError(f"{self.path}: its flow is not finite at any pixel of these images")
        own = None
        if self.uncertainty:
            own = self._whole(self._sigma_of(maps, outputs), size, before, shape)
            own = np.float32(abs(self.scale)) * (own if self.axes == "uv" else own[..., ::-1])
        return [DenseMaps(as_dense(f), None if own is None else as_dense(own[i])) for i, f in enumerate(flow)]

    def _size(self, form: GraphForm, shape: tuple[int, ...]) -> tuple[int, int]:
        """Size (H, W) at which images go into the graph."""
        free = [-(-side // self.multiple) * self.multiple for side in shape]
        height, width = (given or own for given, own in zip(form.size, free))
        if self.fit == "pad" and (height < shape[0] or width < shape[1]):
            raise DataError(
                f"{self.path}: takes images of {width}x{height}, not of {shape[1]}x{shape[0]} "
                "(`fit`: resize scales them, as --resize does)"
            )
        return height, width

    def _fitted(self, image: Image, size: tuple[int, int], before: list[int]) -> NDArray[np.float32]:
        """Image in the size of the graph, grey levels."""
        if self.fit == "resize":
            smaller = size[0] * size[1] < image.size
            method = cv2.INTER_AREA if smaller else cv2.INTER_LINEAR
            return np.asarray(cv2.resize(image.astype(np.float32), size[::-1], interpolation=method))
        edges = [(b, side - own - b) for b, side, own in zip(before, size, image.shape)]
        return np.pad(image, edges, mode="edge").astype(np.float32)

    def _values(self, grey: NDArray[np.float32], colours: int) -> NDArray[np.float32]:
        """Grey levels (N, 2, H, W) as the network's values (N, 2, C, H, W)."""
        images = np.repeat(grey[:, :, None], colours, axis=2) / np.float32(255)
        if self.normalise == "imagenet":
            mean, deviation = (row[:colours, None, None].astype(np.float32) for row in IMAGENET)
            return np.asarray((images - mean) / deviation)
        return np.asarray(np.float32(self.low) + np.float32(self.high - self.low) * images)

    def _flow_of(
        self, maps: Mapping[str, NDArray[np.float32]], outputs: Mapping[str, NDArray[Any]]
    ) -> NDArray[np.float32]:
        candidates = {name: m for name, m in maps.items() if m.shape[-1] == 2 and name != self.uncertainty}
        if self.output:
            candidates = {name: m for name, m in candidates.items() if name == self.output}
        if not candidates:
            wanted = f"no output {self.output!r}" if self.output else "no output"
            raise ModelError(
                f"{self.path}: {wanted} is a flow of two channels, of the images' size or a half, quarter, "
                f"eighth of it: {_shapes(outputs)}"
            )
        most = max(m.shape[1] for m in candidates.values())
        return [m for m in candidates.values() if m.shape[1] == most][-1]

    def _sigma_of(
        self, maps: Mapping[str, NDArray[np.float32]], outputs: Mapping[str, NDArray[Any]]
    ) -> NDArray[np.float32]:
        values = maps.get(self.uncertainty)
        wanted = (2, 4) if self.uncertainty_is == "mixture" else (1, 2)
        if values is None or values.shape[-1] not in wanted:
            raise ModelError(
                f"{self.path}: no output {self.uncertainty!r} is an uncertainty of {wanted[0]} or "
                f"{wanted[1]} channels: {_shapes(outputs)}"
            )
        with np.errstate(over="ignore", invalid="ignore"):
            sigma = _SIGMAS[self.uncertainty_is](values)
        return np.asarray(np.broadcast_to(sigma, (*sigma.shape[:3], 2)))

    def _whole(
        self, maps: NDArray[np.float32], size: tuple[int, int], before: list[int], shape: tuple[int, ...]
    ) -> NDArray[np.float32]:
        """Maps (N, H', W', 2) in pixels of theirs as (N, H, W, 2) in pixels of the images."""
        part = size[0] // maps.shape[1]
        if part > 1:
            maps = np.stack([cv2.resize(m, size[::-1], interpolation=cv2.INTER_LINEAR) for m in maps]) * part
        if self.fit == "resize":
            back = np.array([shape[1] / size[1], shape[0] / size[0]], np.float32)
            whole = (shape[1], shape[0])
            return np.stack([cv2.resize(m, whole, interpolation=cv2.INTER_LINEAR) for m in maps]) * back
        return maps[:, before[0] : before[0] + shape[0], before[1] : before[1] + shape[1]]


def _mixture(values: NDArray[np.float32]) -> NDArray[np.float32]:
    """Standard deviation of a mixture of Laplacians, of logarithms of weights and scales side by side."""
    half = values.shape[-1] // 2
    logits, scales = values[..., :half], np.exp(values[..., half:])
    weights = np.exp(logits - logits.max(axis=-1, keepdims=True))
    weights /= weights.sum(axis=-1, keepdims=True)
    return np.asarray(np.sqrt((weights * 2 * scales**2).sum(axis=-1, keepdims=True)))


_SIGMAS: dict[str, Callable[[NDArray[np.float32]], NDArray[np.float32]]] = {
    "scale": lambda values: values,
    "log-scale": np.exp,
    "variance": np.sqrt,
    "log-variance": lambda values: np.exp(values / 2),
    "mixture": _mixture,
}


def _shapes(outputs: Mapping[str, NDArray[Any]]) -> str:
    return ", ".join(f"{name} {list(values.shape)}" for name, values in outputs.items()) or "none"
