"""What an ONNX graph takes and gives: how two grey images become its input, and its output flow."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
from numpy.typing import NDArray

from flowlik.errors import DataError, ModelError
from flowlik.support.extras import extra

TYPES = {
    "tensor(float)": "float32",
    "tensor(float16)": "float16",
    "tensor(double)": "float64",
    "tensor(uint8)": "uint8",
}
COLOURS = (1, 3)


@dataclass(frozen=True)
class GraphForm:
    """How a graph takes two images.

    Attributes
    ----------
    inputs : tuple of str
        Names of its one or two inputs.
    stacked : {"channels", "axis", "batch", "no"}
        Along what the two images lie in one input: its channels, an axis of their own, the batch; or they are
        two inputs.
    colours : int
        Channels of an image: 1 or 3.
    channels_last : bool
        Whether channels are the last axis.
    size : tuple of int or None
        Height and width [px], None where free.
    pairs : int or None
        Image pairs a call, None where free.
    dtype : str
        Type of the values, as numpy names it.
    """

    inputs: tuple[str, ...]
    stacked: str
    colours: int
    channels_last: bool
    size: tuple[int | None, int | None]
    pairs: int | None
    dtype: str

    def arrays(self, pairs: NDArray[np.float32]) -> dict[str, NDArray[Any]]:
        """Inputs by name, of image pairs (N, 2, C, H, W) in the order and range of the graph."""
        images = np.moveaxis(pairs, 2, -1) if self.channels_last else pairs
        if self.dtype == "uint8":
            images = np.clip(np.rint(images), 0, 255)
        images = images.astype(self.dtype)
        if self.stacked == "no":
            return {name: np.ascontiguousarray(images[:, i]) for i, name in enumerate(self.inputs)}
        if self.stacked == "channels":
            axis = -1 if self.channels_last else 1
            images = np.concatenate([images[:, 0], images[:, 1]], axis=axis)
        elif self.stacked == "batch":
            images = images[0]
        return {self.inputs[0]: np.ascontiguousarray(images)}


class Network:
    """An ONNX file that is ready to run, on so many threads of the processor.

    Raises
    ------
    ModelError
        If it is no ONNX network of two images.
    MissingExtraError
        If onnxruntime is not installed.
    """

    def __init__(self, path: Path, threads: int) -> None:
        runtime = extra("onnxruntime", "a network's flow")
        options = runtime.SessionOptions()
        options.intra_op_num_threads = threads
        options.inter_op_num_threads = 1
        options.log_severity_level = 4  # what goes wrong is said by the exception
        # sums of tiny numbers, of which some networks are full, take a tenth of the time
        options.add_session_config_entry("session.set_denormal_as_zero", "1")
        # in a thread of its own: the session takes tiny numbers for zero in whichever thread makes or runs it
        self._thread = ThreadPoolExecutor(1, "network")
        try:
            providers = ["CPUExecutionProvider"]
            self._session = self._thread.submit(
                runtime.InferenceSession, str(path), options, providers
            ).result()
        except Exception as error:
            raise ModelError(f"{path}: not an ONNX network that onnxruntime loads ({told(error)})") from error
        self.path = path
        self.form = graph_form(path, [(i.name, list(i.shape), i.type) for i in self._session.get_inputs()])
        self.outputs = tuple(output.name for output in self._session.get_outputs())

    def run(self, pairs: NDArray[np.float32]) -> dict[str, NDArray[Any]]:
        """Outputs by name, of image pairs (N, 2, C, H, W) in the order and range of the graph.

        Raises
        ------
        DataError
            If the graph fails on them.
        """
        try:
            found = self._thread.submit(self._session.run, None, self.form.arrays(pairs)).result()
        except Exception as error:
            size = f"{pairs.shape[4]}x{pairs.shape[3]}"
            raise DataError(
                f"{self.path}: fails on {len(pairs)} pair(s) of images of {size} ({told(error)}); "
                "`multiple` and `batch` say what it can take"
            ) from error
        return dict(zip(self.outputs, found))


def graph_form(path: Path, inputs: Sequence[tuple[str, list[Any], str]]) -> GraphForm:
    """Form of a graph of its inputs' names, shapes (int where fixed) and types.

    Raises
    ------
    ModelError
        If they are not two images.
    """
    told = ", ".join(f"{name} {kind} {shape}" for name, shape, kind in inputs)

    def refuse() -> NoReturn:
        raise ModelError(
            f"{path}: its inputs are not two images: {told}; expected one of (N, 2C, H, W), (N, 2, C, H, W), "
            "(2, C, H, W), or two of (N, C, H, W), or the same with the channels last, where C is 1 or 3"
        )

    shapes = [tuple(side if isinstance(side, int) and side > 0 else None for side in s) for _, s, _ in inputs]
    kinds = {kind for _, _, kind in inputs}
    if len(inputs) not in (1, 2) or len(set(shapes)) != 1 or len(kinds) != 1 or not kinds <= set(TYPES):
        refuse()
    names, shape = tuple(name for name, _, _ in inputs), shapes[0]
    dtype = TYPES[kinds.pop()]
    if len(names) == 1 and len(shape) == 5 and shape[1] in (2, None):
        stacked, batch, sides, of = "axis", shape[0], shape[2:], COLOURS
    elif len(shape) != 4:
        refuse()
    elif len(names) == 2:
        stacked, batch, sides, of = "no", shape[0], shape[1:], COLOURS
    elif shape[0] == 2 and (shape[1] in COLOURS or shape[3] in COLOURS):
        stacked, batch, sides, of = "batch", 1, shape[1:], COLOURS
    else:
        stacked, batch, sides, of = "channels", shape[0], shape[1:], (2, 6)
    last = sides[0] not in of
    if (sides[2] if last else sides[0]) not in of:
        refuse()
    channels, *size = (sides[2], *sides[:2]) if last else sides
    assert channels is not None
    colours = channels // 2 if stacked == "channels" else channels
    return GraphForm(names, stacked, colours, last, (size[0], size[1]), batch, dtype)


def dense_maps(outputs: dict[str, NDArray[Any]], size: tuple[int, int]) -> dict[str, NDArray[np.float32]]:
    """Outputs that are maps of images of that size (H, W), or a whole part of it, as (N, H', W', C)."""
    maps = {}
    for name, values in outputs.items():
        if values.ndim == 5 and values.shape[1] == 1:
            values = values[:, 0]
        if values.ndim != 4 or values.dtype.kind != "f":
            continue
        for channels_last in (False, True):
            image = values if channels_last else np.moveaxis(values, 1, -1)
            if image.shape[3] <= 4 and _part(image.shape[1:3], size):
                maps[name] = image.astype(np.float32)
                break
    return maps


def _part(shape: tuple[int, ...], size: tuple[int, int]) -> int:
    """Which part of an image's size (H, W) a map's is, such as 8 for an eighth; 0 if none."""
    part = size[0] // shape[0] if shape[0] else 0
    return part if part and (shape[0] * part, shape[1] * part) == size and part & (part - 1) == 0 else 0


@lru_cache(maxsize=8)
def network(path: Path, sha256: str, threads: int) -> Network:
    """Network of a file whose content is known: one session a process.

    Raises
    ------
    DataError
        If there is no such file, or its content is another.
    ModelError
        If it is no network of two images.
    MissingExtraError
        If onnxruntime is not installed.
    """
    if content(path) != sha256:
        raise DataError(f"{path}: another network than when the run began (its content has changed)")
    return Network(path, threads)


# threads do not survive a fork: the child makes its own sessions
if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=network.cache_clear)


def content(path: Path) -> str:
    """SHA-256 of a network's file, with its weights where they lie beside it in FILE.data.

    Raises
    ------
    DataError
        If the file cannot be read.
    """
    found = hashlib.sha256()
    try:
        found.update(path.read_bytes())
        weights = path.with_name(f"{path.name}.data")
        if weights.is_file():
            found.update(weights.read_bytes())
    except OSError as error:
        raise DataError(f"{path}: no such file of a network ({error.strerror})") from error
    return found.hexdigest()


def told(error: BaseException) -> str:
    """Exception of onnxruntime in one line, not longer than a few."""
    text = " ".join(str(error).split())
    return text if len(text) < 240 else f"{text[:230]} ..."
