"""Images in messages of a ROS bag: to grey of 8 bits, and to depth in metres."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from flowlik.datasets._images import MAX_PIXELS, decode_bytes
from flowlik.errors import DataError
from flowlik.support.arrays import Array

IMAGE, COMPRESSED = "sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage"

TO_GREY: dict[str, tuple[int, int | None]] = {
    "mono8": (1, None),
    "8uc1": (1, None),
    "bgr8": (3, cv2.COLOR_BGR2GRAY),
    "8uc3": (3, cv2.COLOR_BGR2GRAY),
    "rgb8": (3, cv2.COLOR_RGB2GRAY),
    "bgra8": (4, cv2.COLOR_BGRA2GRAY),
    "rgba8": (4, cv2.COLOR_RGBA2GRAY),
    "yuv422_yuy2": (2, cv2.COLOR_YUV2GRAY_YUY2),
    "yuyv": (2, cv2.COLOR_YUV2GRAY_YUY2),
    "yuv422": (2, cv2.COLOR_YUV2GRAY_UYVY),
    "uyvy": (2, cv2.COLOR_YUV2GRAY_UYVY),
    "bayer_rggb8": (1, cv2.COLOR_BayerBG2GRAY),
    "bayer_bggr8": (1, cv2.COLOR_BayerRG2GRAY),
    "bayer_gbrg8": (1, cv2.COLOR_BayerGR2GRAY),
    "bayer_grbg8": (1, cv2.COLOR_BayerGB2GRAY),
    "nv12": (1, None),
    "nv21": (1, None),
}
"""Bytes a pixel of each encoding of 8 bits, and OpenCV's conversion to grey."""

LUMA_FIRST = ("nv12", "nv21")
"""Encodings whose grey levels (luma) come first, and after them half as many bytes of colour."""

MONO16 = "mono16"
"""Encoding whose values of 16 bits are grey levels of fewer bits, or of all."""

DEPTH_UNITS_PER_M = {"16uc1": ("u2", 1000.0), "32fc1": ("f4", 1.0)}
"""Type of a depth image's values by encoding, and how many make a metre (REP 118)."""


def largest_value(message: Any, where: str) -> int:
    """Largest grey level of a message of 16 bits, 0 for any other encoding.

    Raises
    ------
    DataError
        If it holds fewer bytes than its size needs.
    """
    if _encoding(message) != MONO16:
        return 0
    return int(_pixels(message, "u2", where).max())


def to_grey(message: Any, kind: str, where: str, bits: int = 16) -> NDArray[np.uint8]:
    """Grey image (H, W) of a message.

    Parameters
    ----------
    message : object
        Message of the type ``kind``.
    kind : str
        `IMAGE` or `COMPRESSED`.
    where : str
        Beginning of an error's message.
    bits : int
        Bits that values of 16 bits use, at least 8: the upper eight of them are read.

    Raises
    ------
    DataError
        If its encoding is not known, it holds fewer bytes than its size needs, or values of more bits.
    """
    if kind == COMPRESSED:
        image = decode_bytes(bytes(message.data), where, cv2.IMREAD_ANYCOLOR)
        grey = image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
        return np.asarray(grey, dtype=np.uint8)
    encoding = _encoding(message)
    if encoding == MONO16:
        values = _pixels(message, "u2", where) >> (bits - 8)
        if values.max() > 255:
            raise DataError(f"{where}: a grey level of more than {bits} bits")
        return values.astype(np.uint8)
    if encoding not in TO_GREY:
        hint = " (as depth: --depth-topic)" if encoding in DEPTH_UNITS_PER_M else ""
        known = ", ".join([*TO_GREY, MONO16])
        raise DataError(f"{where}: encoding {str(message.encoding)!r} is not read{hint}, known are {known}")
    channels, conversion = TO_GREY[encoding]
    pixels = _pixels(message, "u1", where, channels, 1.5 if encoding in LUMA_FIRST else 1.0)
    try:
        grey = pixels if conversion is None else cv2.cvtColor(pixels, conversion)
    except cv2.error as error:
        size = f"{message.width} x {message.height}"
        raise DataError(f"{where}: no image of {size} pixels has that encoding") from error
    return np.array(grey, dtype=np.uint8)


def to_depth(message: Any, where: str) -> Array:
    """Depth (H, W) [m] of a message: 16UC1 in millimetres or 32FC1 in metres; NaN where unknown.

    Raises
    ------
    DataError
        If its encoding is another, or it holds fewer bytes than its size needs.
    """
    encoding = _encoding(message)
    if encoding not in DEPTH_UNITS_PER_M:
        found = repr(str(message.encoding))
        raise DataError(f"{where}: depth must be 16UC1 (millimetres) or 32FC1 (metres), not {found}")
    kind, units_per_m = DEPTH_UNITS_PER_M[encoding]
    values = _pixels(message, kind, where).astype(np.float64)
    with np.errstate(invalid="ignore"):
        known = (values > 0) & (values < np.inf)
    return np.where(known, values / units_per_m, np.nan)


def _encoding(message: Any) -> str:
    return str(getattr(message, "encoding", "")).lower()


def _pixels(message: Any, kind: str, where: str, channels: int = 1, planes: float = 1.0) -> NDArray[Any]:
    """Values (H, W) or (H, W, channels) of a raw image's message; ``planes`` times as many bytes follow."""
    order = ">" if message.is_bigendian else "<"
    dtype = np.dtype(order + kind)
    height, width, step = int(message.height), int(message.width), int(message.step)
    row = width * channels * dtype.itemsize
    if not (0 < height * width <= MAX_PIXELS and row <= step):
        raise DataError(f"{where}: impossible size {width} x {height} with rows of {step} bytes")
    needed = int(height * step * planes)
    if len(message.data) < needed:
        raise DataError(f"{where}: {len(message.data)} bytes, but {height} rows take {needed}")
    rows = np.frombuffer(message.data, np.uint8, height * step).reshape(height, step)
    pixels = np.ascontiguousarray(rows[:, :row]).view(dtype).reshape(height, width, channels)
    return pixels[..., 0] if channels == 1 else pixels
