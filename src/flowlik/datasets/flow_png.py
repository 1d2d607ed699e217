"""Flow in 16-bit PNG: three channels that mean something else in each data set."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from flowlik.datasets._images import decode_image
from flowlik.errors import DataError
from flowlik.support.arrays import Array

Codes = NDArray[np.uint16]

OFFSET = 2**15
KITTI_SCALE, DSEC_SCALE = 64, 128
MOST_PX = 511
"""Longest component [px] that KITTI's and TartanAir's steps of 1/64 px hold on both sides."""

TARTANAIR_MASK = (0, 1, 10, 100, 200)
"""TartanAir V2: seen again, occluded by another thing, by the same, out of view, beyond what 16 bits hold."""
TARTANAIR_UNKNOWN = 200

DSEC_SIZE = (480, 640)
"""Height and width of DSEC's event cameras: no other flow PNG may pass for DSEC's."""

_MARK = b"tEXt" + b"flow\0kitti"
"""Text in the PNG files that flowlik writes: these are KITTI's whatever their size."""


def _kitti(codes: Codes) -> Array:
    return _where(codes[..., 0] > 0, (codes[..., 2:0:-1] - float(OFFSET)) / KITTI_SCALE)


def _dsec(codes: Codes) -> Array:
    return _where(codes[..., 0] > 0, (codes[..., 2:0:-1] - float(OFFSET)) / DSEC_SCALE)


def _tartanair(codes: Codes) -> Array:
    return _where(codes[..., 2] < TARTANAIR_UNKNOWN, (codes[..., :2] - float(OFFSET)) / KITTI_SCALE)


def _virtual_kitti(codes: Codes) -> Array:
    height, width = codes.shape[:2]
    shares = codes[..., 2:0:-1] * (2 / (2**16 - 1)) - 1
    return _where(codes[..., 0] > 0, shares * (width - 1, height - 1))


PNG_CODINGS: dict[str, Callable[[Codes], Array]] = {
    "kitti": _kitti,
    "dsec": _dsec,
    "tartanair": _tartanair,
    "virtual-kitti": _virtual_kitti,
}
"""Codings by name, of channels (H, W, 3) in OpenCV's order, blue first.

``kitti`` (2012, 2015, HD1K): valid, v, u in steps of 1/64 px. ``dsec``: the same in steps of 1/128 px.
``tartanair`` (V2, and `flowlik simulate`): u, v in steps of 1/64 px, mask. ``virtual-kitti`` (2): valid, v, u
as shares of the image's size. Occluded pixels keep their flow.
"""


def read_flow_png(path: Path, coding: str | None = None) -> Array:
    """Read flow of a PNG of three 16-bit channels.

    Parameters
    ----------
    path : Path
        File.
    coding : str, optional
        A name in `PNG_CODINGS`. By default the file must tell: KITTI's first channel (blue) is 0 or 1,
        TartanAir's last (red) one of 0, 1, 10, 100, 200. At 640 x 480 pixels KITTI's cannot be told from
        DSEC's, unless flowlik wrote it.

    Returns
    -------
    array (H, W, 2)
        Flow (u, v) [px]; NaN where unknown.

    Raises
    ------
    DataError
        If the file is damaged or of another kind, does not tell its coding, or is not of the one given.
    """
    codes = decode_image(path, cv2.IMREAD_UNCHANGED)
    if codes.dtype != np.uint16 or codes.ndim != 3 or codes.shape[2] != 3:
        raise DataError(f"{path}: not a flow file (a PNG of three 16-bit channels)")
    if coding is None:
        coding = "kitti" if _MARK in path.read_bytes()[:100] else _coding(codes, path)
    else:
        check_coding(coding)
        _check_claim(codes, coding, path)
    return PNG_CODINGS[coding](codes)


def check_coding(name: str) -> None:
    """Refuse a name that is not in `PNG_CODINGS`.

    Raises
    ------
    DataError
        If it is not.
    """
    if name not in PNG_CODINGS:
        raise DataError(f"unknown coding of flow PNGs {name!r}: known are {', '.join(PNG_CODINGS)}")


def encode_kitti_flow(flow: Array) -> bytes:
    """PNG of KITTI's coding of flow (H, W, 2) [px], rounded to 1/64 px; NaN becomes invalid.

    Raises
    ------
    DataError
        If a component is outside [-512, 512) px.
    """
    valid = np.asarray(np.isfinite(flow).all(axis=-1))
    codes = np.rint(np.where(valid[..., None], flow, 0) * KITTI_SCALE) + OFFSET
    if codes.min() < 0 or codes.max() >= 2 * OFFSET:
        raise DataError("KITTI's flow format holds -512 to 512 px, the flow has more")
    codes[~valid] = 0
    image = np.dstack([valid, codes[..., 1], codes[..., 0]]).astype(np.uint16)
    data = cv2.imencode(".png", image)[1].tobytes()
    after_header = 8 + 25
    chunk = struct.pack(">I", len(_MARK) - 4) + _MARK + struct.pack(">I", zlib.crc32(_MARK))
    return data[:after_header] + chunk + data[after_header:]


def _coding(codes: Codes, path: Path) -> str:
    """Coding that the channels themselves tell."""
    first, last = codes[..., 0], codes[..., 2]
    like_kitti = bool(first.max() <= 1)
    like_tartanair = bool(np.isin(last, TARTANAIR_MASK).all())
    if like_kitti and not first.any():
        return "kitti"  # no pixel is valid, whatever the scale
    if like_kitti != like_tartanair:
        if like_kitti and codes.shape[:2] == DSEC_SIZE:
            raise DataError(
                f"{path}: at 640 x 480 pixels this may be KITTI's flow (steps of 1/64 px) or DSEC's "
                f"(1/128 px); say which: {_choice('kitti', 'dsec')}"
            )
        return "kitti" if like_kitti else "tartanair"
    raise DataError(
        f"{path}: three 16-bit channels, but neither KITTI's flow (first channel 0 or 1, found up to "
        f"{first.max()}) nor TartanAir's (last channel of {', '.join(map(str, TARTANAIR_MASK))}, found up to "
        f"{last.max()}); say what it is: {_choice(*PNG_CODINGS)}"
    )


def _check_claim(codes: Codes, coding: str, path: Path) -> None:
    """Refuse a coding that the channels contradict."""
    first, last = codes[..., 0], codes[..., 2]
    if coding == "tartanair" and last.max() > TARTANAIR_UNKNOWN:
        raise DataError(
            f"{path}: no TartanAir flow, whose last channel is a mask of at most 200, not {last.max()}"
        )
    values = np.unique(first[first > 0])
    if coding != "tartanair" and len(values) > 1:
        raise DataError(
            f"{path}: no {coding} flow, whose first channel says valid or not; this one has values from "
            f"{values[0]} to {values[-1]} (TartanAir's has u there)"
        )


def _choice(*names: str) -> str:
    return f"--flow-png {', '.join(names[:-1])} or {names[-1]}"


def _where(known: NDArray[np.bool_], flow: Array) -> Array:
    return np.where(known[..., None], flow, np.nan)
