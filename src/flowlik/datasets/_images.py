"""Image files and what their bytes hold, refused where they are damaged or too large."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path
from typing import TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray

from flowlik.datasets._truncation import claimed_size, is_whole
from flowlik.errors import DataError

MAX_PIXELS = 2**27
"""Pixels an image may have; a header that claims more is taken for damage before memory is asked for."""

MAX_FILE_BYTES = 2**30

_T = TypeVar("_T", bound=np.generic)


def read_grey(path: Path | str) -> NDArray[np.uint8]:
    """Read an image file as grey uint8 (H, W).

    Colour becomes grey by OpenCV's weights (0.299 R + 0.587 G + 0.114 B), rounded once.

    Raises
    ------
    DataError
        If the file is missing, truncated or not an image.
    """
    # The decoders' own conversions to grey differ in weights and rounding, so colour is read as colour.
    image = decode_image(path, cv2.IMREAD_ANYCOLOR)
    if image.ndim == 3:
        image = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
    return np.asarray(image, dtype=np.uint8)


def decode_image(path: Path | str, flags: int) -> NDArray:
    """Decode an image file as ``cv2.imread`` does with ``flags``, refusing incomplete files.

    Raises
    ------
    DataError
        If the file is missing, truncated or not an image, or its header claims more than `MAX_PIXELS`.
    """
    try:
        if Path(path).stat().st_size > MAX_FILE_BYTES:
            raise DataError(f"{path}: an image file of more than {MAX_FILE_BYTES >> 20} MiB is not read")
        data = Path(path).read_bytes()
    except FileNotFoundError as error:
        raise DataError(f"{path}: no such image file") from error
    except OSError as error:
        raise DataError(f"{path}: cannot be read ({error.strerror})") from error
    except ValueError as error:  # a list of files that is damaged
        raise DataError(f"{str(path)!r}: not the name of a file") from error
    return decode_bytes(data, path, flags)


def decode_bytes(data: bytes, path: Path | str, flags: int) -> NDArray:
    """Decode an image that is in memory, as `decode_image`; ``path`` begins the message of an error.

    Raises
    ------
    DataError
        If it is truncated or not an image, or its header claims more than `MAX_PIXELS`.
    """
    width, height = claimed_size(data) or (0, 0)
    if width * height > MAX_PIXELS:
        found = f"its header claims {width} x {height} pixels"
        raise DataError(f"{path}: {found}, more than the {MAX_PIXELS} an image may have")
    image = None
    if data and is_whole(data):
        with suppress(cv2.error):
            image = cv2.imdecode(np.frombuffer(data, dtype=np.uint8), flags)
    if image is None:
        raise DataError(f"{path}: not a readable image (truncated, damaged or not an image file)")
    return np.asarray(image)


def of_size(values: NDArray[_T], shape: tuple[int, ...], path: Path, other: str) -> NDArray[_T]:
    """Pass on values (H, W, ...) of a file that must have the size (H, W) of ``other``.

    Raises
    ------
    DataError
        If they have another.
    """
    if values.shape[:2] != shape[:2]:
        raise DataError(f"{path}: {_size(values.shape)} pixels, but {other} has {_size(shape)}")
    return values


def _size(shape: tuple[int, ...]) -> str:
    return " x ".join(map(str, shape[1::-1]))
