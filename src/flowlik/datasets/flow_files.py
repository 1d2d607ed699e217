"""Optical flow on disk, in the formats that the field uses."""

from __future__ import annotations

import struct
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from flowlik.datasets._pfm import read_pfm
from flowlik.datasets.flow_png import encode_kitti_flow, read_flow_png
from flowlik.errors import DataError
from flowlik.support.arrays import Array
from flowlik.support.files import atomic_write, mapped_npy, read_npz

SUFFIXES = (".flo", ".png", ".npy", ".npz", ".pfm")
"""Flow formats that `read_flow` reads."""

HDF5 = ".flo5"
"""Spring's flow, which is HDF5: refused with what converts it, since nothing else here needs that library."""

FLO_MAGIC = b"PIEH"
FLO_MAX_SIDE = 99_999
FLO_UNKNOWN = 1e9
"""Middlebury marks unknown flow by components of this size or more [px]."""


def read_flow(path: Path | str, png: str | None = None) -> Array:
    """Read a flow file; its suffix, one of `SUFFIXES`, names the format.

    Parameters
    ----------
    path : Path or str
        Middlebury ``.flo``; ``.png`` as `flowlik.datasets.flow_png` knows them; ``.pfm`` of three channels,
        the last of them zero (FlyingThings3D); ``.npy`` of an array (H, W, 2) or (2, H, W), or one of these
        with axes of length 1 before it; ``.npz`` of one such array, or of ``flow`` with ``valid``.
    png : str, optional
        Coding of a PNG, where it shall not tell it itself (`flowlik.datasets.flow_png.PNG_CODINGS`).

    Returns
    -------
    array (H, W, 2)
        Flow (u, v) [px], float64; NaN in both components where unknown.

    Raises
    ------
    DataError
        If the suffix is another, or the file is missing, truncated, not of that format, or can be read in two
        ways.
    """
    path = Path(path)
    readers: dict[str, Callable[[Path], NDArray]] = {
        ".flo": _read_flo,
        ".png": lambda path: read_flow_png(path, png),
        ".npy": _read_npy,
        ".npz": _read_npz,
        ".pfm": _read_pfm,
    }
    assert tuple(readers) == SUFFIXES
    if path.suffix.lower() == HDF5:
        raise DataError(
            f"{path}: flow in HDF5 is not read; convert it by "
            f"numpy.save({path.stem + '.npy'!r}, h5py.File({path.name!r})['flow'][:])"
        )
    if path.suffix.lower() not in readers:
        raise DataError(f"{path}: unknown flow format, expected one of {', '.join(readers)}")
    if not path.is_file():
        raise DataError(f"{path}: no such flow file")
    with np.errstate(invalid="ignore", over="ignore"):  # a signalling NaN is as unknown as any other
        flow = readers[path.suffix.lower()](path).astype(np.float64)
        flow[~(np.abs(flow) < FLO_UNKNOWN).all(axis=-1)] = np.nan
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
    try:
        data = encode_kitti_flow(flow)
    except DataError as error:
        raise DataError(f"{path}: {error}") from error
    with atomic_write(path, "wb") as file:
        file.write(data)


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
    return np.fromfile(path, dtype="<f4", offset=12).reshape(height, width, 2)


def _read_npy(path: Path) -> NDArray:
    return np.array(_components_last(mapped_npy(path), path))


def _read_npz(path: Path) -> NDArray:
    arrays = read_npz(path)
    if len(arrays) == 1:
        (flow,) = arrays.values()
        return _components_last(flow, path)
    if set(arrays) != {"flow", "valid"}:
        raise DataError(
            f"{path}: holds {', '.join(map(repr, arrays)) or 'nothing'}, but expected one array (NaN where "
            "unknown), or `flow` with `valid`"
        )
    flow, valid = _components_last(arrays["flow"], path), np.squeeze(arrays["valid"])
    if valid.shape != flow.shape[:2] or valid.dtype.kind not in "biuf":
        raise DataError(f"{path}: `valid` of {valid.dtype} {valid.shape} for a flow {flow.shape}")
    return np.where((valid > 0)[..., None], flow, np.nan)


def _read_pfm(path: Path) -> NDArray:
    values = read_pfm(path, 3)
    if values[..., 2].any():
        raise DataError(f"{path}: the third channel of a flow is zero, this one has other values: no flow?")
    return values[..., :2]


def _components_last(array: object, path: Path) -> NDArray:
    """Flow (H, W, 2) of an array that has u and v first or last."""
    if not isinstance(array, np.ndarray) or array.dtype.kind not in "fiu":
        raise DataError(f"{path}: not an array of real numbers")
    found = array
    while found.ndim > 3 and len(found) == 1:
        found = found[0]
    # no image is two pixels wide: (2, H, 2) has u and v last
    if found.ndim == 3 and found.shape[2] != 2 and len(found) == 2:
        found = found.transpose(1, 2, 0)
    if found.ndim != 3 or found.shape[2] != 2 or found.size == 0:
        raise DataError(f"{path}: flow must have shape (H, W, 2) or (2, H, W), not {array.shape}")
    return found


def _shape(flow: NDArray) -> tuple[int, int]:
    if flow.ndim != 3 or flow.shape[2] != 2 or flow.size == 0:
        raise DataError(f"flow must have shape (H, W, 2), not {flow.shape}")
    return flow.shape[0], flow.shape[1]
