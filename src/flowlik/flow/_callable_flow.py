"""Bring your own flow: any callable or flow method, found by its dotted name."""

from __future__ import annotations

import inspect
import pkgutil
import re
import sys
import traceback
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, ClassVar, NoReturn

import numpy as np
from numpy.typing import NDArray

from flowlik.errors import DataError, ModelError
from flowlik.flow.base import DenseFlow, Image, as_dense, check_pair
from flowlik.support.arrays import Array

DOTTED = re.compile(r"[^\W\d]\w*(\.[^\W\d]\w*)*:[^\W\d]\w*(\.[^\W\d]\w*)*")
"""``package.module:object``, both parts with dots or without."""


@dataclass(frozen=True)
class CallableFlow(DenseFlow):
    """Dense flow of somebody's own object, which a model file knows by its name alone.

    The object is imported when it is first used, once a process, so that this one can be sent to others.

    Parameters
    ----------
    object : str
        ``package.module:object``: a callable ``f(previous, current)`` that takes grey uint8 images (H, W) and
        returns flow (H, W, 2) [px] of a floating type, not finite where unknown; or a `DenseFlow`.

    Raises
    ------
    ModelError
        If the name is not of that form.
    """

    name: ClassVar[str] = "callable"
    object: str

    def __post_init__(self) -> None:
        _check_name(self.object)

    def dense(self, previous: Image, current: Image) -> NDArray[np.float32]:
        """Flow (H, W, 2) [px] of every pixel; NaN where unknown.

        Raises
        ------
        DataError
            If the object fails, or returns anything else.
        ModelError
            If it cannot be imported, or is no flow.
        """
        check_pair(previous, current)
        own = find(self.object)
        function = own.dense if isinstance(own, DenseFlow) else own
        flow = _call(self.object, function, previous.copy(), current.copy())
        return as_dense(_floats(self.object, flow, (*previous.shape, 2)))


@dataclass(frozen=True)
class CallableFeatures:
    """Sparse flow of somebody's own object that has ``measure`` and ``measure_at``, as `CallableFlow`."""

    name: ClassVar[str] = "callable"
    object: str

    def measure(self, previous: Image, current: Image) -> tuple[Array, Array]:
        """Pixels (N, 2) the object chooses and their flow (N, 2) [px]; NaN where it fails.

        Raises
        ------
        ModelError
            If the object cannot be imported, or is no flow.
        DataError
            If the images differ in size, or the object fails or returns anything else.
        """
        check_pair(previous, current)
        measured = _call(self.object, find(self.object).measure, previous.copy(), current.copy())
        if not isinstance(measured, tuple) or len(measured) != 2:
            _refuse(self.object, f"must measure pixels and flow, two arrays (N, 2), not {_kind(measured)}")
        pixels = _floats(self.object, measured[0], (None, 2))
        return pixels, _floats(self.object, measured[1], pixels.shape)

    def measure_at(self, previous: Image, current: Image, pixels: Array) -> Array:
        """Flow (N, 2) [px] at given pixels (N, 2); NaN where it fails.

        Raises
        ------
        ModelError
            If the object cannot be imported, or is no flow.
        DataError
            If the images differ in size, or the object fails or returns anything else.
        """
        check_pair(previous, current)
        measure_at = find(self.object).measure_at
        flow = _call(self.object, measure_at, previous.copy(), current.copy(), pixels.copy())
        return _floats(self.object, flow, pixels.shape)


def _check_name(name: str) -> None:
    """Raise ModelError unless a name is of the form ``package.module:object``."""
    if not (isinstance(name, str) and DOTTED.fullmatch(name)):
        raise ModelError(f"{name!r} is not the name of an object, such as package.module:object")


def brought(name: str) -> CallableFlow | CallableFeatures:
    """Flow method of an object ``package.module:object``; imports it.

    Raises
    ------
    ModelError
        If it cannot be imported, or is no flow.
    """
    own = find(name)
    return CallableFeatures(name) if _measures(own) and not isinstance(own, DenseFlow) else CallableFlow(name)


@lru_cache(maxsize=32)
def find(name: str) -> Any:
    """Import ``package.module:object``: a flow method, or a callable of two images.

    A class is called without arguments, and so is a function that takes none: what it returns is meant. The
    current folder is importable, as with ``python -m``.

    Raises
    ------
    ModelError
        If the name is not of that form, cannot be imported, or is of something else.
    """
    _check_name(name)
    here = str(Path.cwd())
    if not sys.flags.safe_path and not {"", here} & set(sys.path):
        sys.path.insert(0, here)
    try:
        own = pkgutil.resolve_name(name)
        if isinstance(own, type) or (not _measures(own) and _takes(own, 0) and not _takes(own, 2)):
            own = own()
    except (Exception, SystemExit) as error:
        raise ModelError(f"{name}: cannot be imported ({_told(error)})") from error
    if not (_measures(own) or _takes(own, 2)):
        raise ModelError(f"{name}: {_kind(own)} is neither a callable of two images nor a flow method")
    return own


def _measures(own: Any) -> bool:
    return all(callable(getattr(own, name, None)) for name in ("measure", "measure_at"))


def _takes(own: Any, arguments: int) -> bool:
    """Whether an object can be called with so many arguments; compiled ones do not tell and are believed."""
    if not callable(own):
        return False
    try:
        inspect.signature(own).bind(*[None] * arguments)
    except TypeError:
        return False
    except ValueError:
        return arguments == 2
    return True


def _call(name: str, function: Callable[..., Any], *arguments: Any) -> Any:
    try:
        return function(*arguments)
    except Exception as error:
        where = traceback.extract_tb(error.__traceback__)[-1]
        place = f"line {where.lineno} of {Path(where.filename).name}"
        raise DataError(f"{name}: failed on two images ({_told(error)}, {place})") from error


def _floats(name: str, values: Any, shape: tuple[int | None, ...]) -> Array:
    """Array of the shape, in which None is any number, as float64."""
    try:
        array = np.asarray(values)
    except Exception as error:
        raise DataError(f"{name}: returned {_kind(values)}, not an array ({_told(error)})") from error
    expected = tuple(found if wanted is None else wanted for wanted, found in zip(shape, array.shape))
    if array.dtype.kind != "f" or array.shape != expected or array.ndim != len(shape):
        wanted = ", ".join("N" if side is None else str(side) for side in shape)
        _refuse(name, f"must return a floating array ({wanted}), not {_kind(values)}")
    return array.astype(np.float64)


def _refuse(name: str, message: str) -> NoReturn:
    raise DataError(f"{name}: {message}")


def _kind(value: Any) -> str:
    if isinstance(value, np.ndarray):
        return f"{value.dtype} {value.shape}"
    return f"an object of {type(value).__name__}"


def _told(error: BaseException) -> str:
    """Exception in one line."""
    return f"{type(error).__name__}: {' '.join(str(error).split())}".rstrip(": ")
