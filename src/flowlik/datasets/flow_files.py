"""Optical flow on disk: Middlebury .flo, KITTI 16-bit PNG, NumPy .npy."""

from __future__ import annotations

import struct
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from flowlik.datasets.base import decode_image
from flowlik.errors import DataError
from flowlik.support.files import atomic_write

Array = NDArray[np.float64]

FLO_MAGIC = b"PIEH"
FLO_MAX_SIDE = 99_999
FLO_UNKNOWN = 1e9
"""Middlebury marks unknown flow by components of this size or more [px]."""

KITTI_OFFSET = 2**15
KITTI_SCALE = 64
KITTI_MOST_PX = 511


def read_flow(path: Path | str) -> Array:
    """Read a flow file; its suffix (.flo, .png, .npy) names the format.

    Returns
    -------
    array (H, W, 2)
        Flow (u, v) [px], float64; NaN in both components where unknown.

    Raises
    ------
    DataError
        If the suffix is another, or the file is missing, truncated or not of that format.
    """
    path = Path(path)
    readers = {".flo": _read_flo, ".png": _read_kitti, ".npy": _read_npy}
    if path.suffix.lower() not in readers:
        raise DataError(f"{path}: unknown flow format, expected one of {', '.join(readers)}")
    if not path.is_file():
        raise DataError(f"{path}: no such flow file")
    flow = readers[path.suffix.lower()](path)
    flow[~np.isfinite(flow).all(axis=-1)] = np.nan
    return flow


def write_flo(path: Path | str, flow: Array) -> None:
    """Write flow (H, W, 2) [px] as Middlebury .flo, rounded to float32; NaN becomes unknown (1e10).

    Raises
    ------
    DataError
        If the flow has another shape.
    """
    height, width = _shape(flow)
    unknown = ~np.isfinite(flow).all(axis=-1, keepdims=True)
    values = np.where(unknown, 10 * FLO_UNKNOWN, flow).astype("<f4")
    with atomic_write(path, "wb") as file:
        file.write(FLO_MAGIC + struct.pack("<ii", width, height))
        file.write(values.tobytes())


def write_kitti_flow(path: Path | str, flow: Array) -> None:
    """Write flow (H, W, 2) [px] as KITTI's 16-bit PNG, rounded to 1/64 px; NaN becomes invalid.

    Raises
    ------
    DataError
        If the flow has another shape, or a component outside [-512, 512) px.
    """
    _shape(flow)
    valid = np.asarray(np.isfinite(flow).all(axis=-1))
    codes = np.rint(np.where(valid[..., None], flow, 0) * KITTI_SCALE) + KITTI_OFFSET
    if codes.min() < 0 or codes.max() >= 2 * KITTI_OFFSET:
        raise DataError(f"{path}: KITTI's flow format holds -512 to 512 px, the flow has more")
    codes[~valid] = 0
    image = np.dstack([valid, codes[..., 1], codes[..., 0]]).astype(np.uint16)  # OpenCV's order: B, G, R
    with atomic_write(path, "wb") as file:
        file.write(cv2.imencode(".png", image)[1].tobytes())


def _read_flo(path: Path) -> Array:
    with path.open("rb") as file:
        header = file.read(12)
    if len(header) < 12 or header[:4] != FLO_MAGIC:
        raise DataError(f"{path}: not a .flo file (it must begin with {FLO_MAGIC.decode()})")
    width, height = struct.unpack("<ii", header[4:])
    if not (0 < width <= FLO_MAX_SIDE and 0 < height <= FLO_MAX_SIDE):
        raise DataError(f"{path}: impossible size {width} x {height} in a .flo file")
    expected, found = 12 + 8 * width * height, path.stat().st_size
    if found != expected:
        raise DataError(f"{path}: {found} bytes, but {width} x {height} vectors take {expected} (truncated?)")
    values = np.fromfile(path, dtype="<f4", offset=12).reshape(height, width, 2)
    with np.errstate(invalid="ignore"):  # a signalling NaN is as unknown as any other
        flow = values.astype(np.float64)
    flow[np.abs(flow) >= FLO_UNKNOWN] = np.nan
    return flow


def _read_kitti(path: Path) -> Array:
    image = decode_image(path, cv2.IMREAD_UNCHANGED)
    if image.dtype != np.uint16 or image.ndim != 3 or image.shape[2] != 3:
        raise DataError(f"{path}: not a KITTI flow file (a PNG of three 16-bit channels)")
    flow = (image[..., [2, 1]].astype(np.float64) - KITTI_OFFSET) / KITTI_SCALE
    flow[image[..., 0] == 0] = np.nan
    return flow


def _read_npy(path: Path) -> Array:
    try:
        # Mapped, a header that promises more than the file holds is refused before memory is asked for.
        flow = np.load(path, mmap_mode="r", allow_pickle=False)
    except Exception as error:  # NumPy's parser of headers raises a dozen kinds
        raise DataError(f"{path}: not a readable .npy file (truncated or of another kind)") from error
    if not isinstance(flow, np.ndarray) or flow.dtype.kind not in "fiu":
        raise DataError(f"{path}: not an array of real numbers")
    try:
        _shape(flow)
    except DataError as error:
        raise DataError(f"{path}: {error}") from error
    return np.array(flow, dtype=np.float64)


def _shape(flow: NDArray) -> tuple[int, int]:
    if flow.ndim != 3 or flow.shape[2] != 2 or flow.size == 0:
        raise DataError(f"flow must have shape (H, W, 2), not {flow.shape}")
    return flow.shape[0], flow.shape[1]
