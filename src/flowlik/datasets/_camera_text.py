"""Cameras in plain text: KITTI's calib.txt, COLMAP's cameras.txt, and a row fx fy cx cy."""

from __future__ import annotations

import re
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from flowlik.datasets._camera_formats import Cameras
from flowlik.datasets._camera_model import camera_matrix, make_lens, matrix_lens
from flowlik.datasets._lens import Lens
from flowlik.errors import DataError
from flowlik.support.files import numbers, read_text

KITTI_ROW = re.compile(r"P(?:_rect_0)?\d:")
COLMAP_ROW = re.compile(r"\d+\s+[A-Z][A-Z_]+\s")

COLMAP = {
    "SIMPLE_PINHOLE": ("plumb_bob", "f cx cy"),
    "PINHOLE": ("plumb_bob", "fx fy cx cy"),
    "SIMPLE_RADIAL": ("plumb_bob", "f cx cy k1"),
    "RADIAL": ("plumb_bob", "f cx cy k1 k2"),
    "OPENCV": ("plumb_bob", "fx fy cx cy k1 k2 p1 p2"),
    "FULL_OPENCV": ("plumb_bob", "fx fy cx cy k1 k2 p1 p2 k3 k4 k5 k6"),
    "OPENCV_FISHEYE": ("fisheye", "fx fy cx cy k1 k2 k3 k4"),
    "SIMPLE_RADIAL_FISHEYE": ("fisheye", "f cx cy k1"),
    "RADIAL_FISHEYE": ("fisheye", "f cx cy k1 k2"),
}
"""COLMAP's camera models: ours, and their parameters in order."""


def text_cameras(text: str) -> Cameras | None:
    """Cameras of a text that is KITTI's or COLMAP's or one row of four numbers; None if it is none of these.

    Raises
    ------
    DataError
        If it is, and is malformed.
    """
    lines = [(i, line.strip()) for i, line in enumerate(text.splitlines(), start=1)]
    rows = [(i, line) for i, line in lines if line and not line.startswith("#")]
    if any(KITTI_ROW.match(line) for _, line in rows):
        matrices = projections(rows)
        sizes = {name: size for name, size in _kitti_sizes(rows)}
        return Cameras({name: partial(_kitti, P, sizes.get(name)) for name, P in matrices.items()})
    if rows and all(COLMAP_ROW.match(line) for _, line in rows):
        read = {line.split()[0]: partial(_colmap, i, line.split()) for i, line in rows}
        if len(read) < len(rows):
            raise DataError("a camera's number stands there twice")
        return Cameras(read)
    words = rows[0][1].split() if len(rows) == 1 else []
    if len(words) == 4 and all(re.fullmatch(r"[-+.\deE]+", word) for word in words):
        return Cameras({"camera": partial(_row, *rows[0])})
    return None


def _row(number: int, line: str) -> Lens:
    return make_lens(numbers(line.split(), f"line {number}"), "none")


def read_projection(path: Path | str, row: str) -> NDArray[np.float64]:
    """Projection matrix (3, 4) K [I | t] of one camera in KITTI's ``calib.txt``.

    Parameters
    ----------
    path : Path or str
        Calibration file.
    row : str
        Name of the row, ``P0`` to ``P3`` or ``P_rect_00``.

    Raises
    ------
    DataError
        If the file is missing or not a calibration file, has no such row, or that is no camera without skew.
    """
    lines = enumerate(read_text(path).splitlines(), start=1)
    rows = [(number, line.strip()) for number, line in lines if line.strip()]
    if not rows:
        raise DataError(f"{path}: empty, but expected KITTI calibration rows ('P0:' and 12 numbers)")
    try:
        matrices = projections(rows)
    except DataError as error:
        raise DataError(f"{path}, {error}") from error
    if row not in matrices:
        there = ", ".join(matrices) or "none of a camera"
        raise DataError(f"{path}: no row {row}, the camera of the images here (rows: {there})")
    matrix_lens(matrices[row], f"{path}, row {row}: not the projection matrix of a camera")
    return matrices[row]


def projections(rows: list[tuple[int, str]]) -> dict[str, NDArray[np.float64]]:
    """Projection matrices (3, 4) of KITTI's rows ``P0: …`` or ``P_rect_00: …``, of lines with their numbers.

    Other rows (``Tr``, ``R0_rect``, ``R_rect_00``, …) turn laser points, or raw images into line: of no use
    for rectified images, they are only looked at for being rows.

    Raises
    ------
    DataError
        If a line is no row of a name and numbers, or a projection has other than 12.
    """
    found: dict[str, NDArray[np.float64]] = {}
    for number, line in rows:
        # KITTI's tracking files write some rows without a colon
        name, colon, values = line.partition(":") if ":" in line else line.partition(" ")
        words = values.split()
        is_row = bool(re.fullmatch(r"[A-Za-z]\w*", name)) and len(words) > 0
        projection = bool(KITTI_ROW.match(line))
        if not is_row or (projection and len(words) != 12) or not (colon.strip() or _all_numbers(words)):
            raise DataError(f"line {number}: not a KITTI calibration row ('P0:' and 12 numbers)")
        if projection:
            if name in found:
                raise DataError(f"line {number}: {name} stands there twice")
            found[name] = np.array(numbers(words, f"line {number}")).reshape(3, 4)
    return found


def _all_numbers(words: list[str]) -> bool:
    return all(re.fullmatch(r"[-+.\deE]+", word) for word in words)


def _kitti_sizes(rows: list[tuple[int, str]]) -> list[tuple[str, list[float]]]:
    """Image sizes that raw drives tell as ``S_rect_00: width height``, by the name of the projection."""
    return [
        (f"P_rect_{line[7:9]}", numbers(line.partition(":")[2].split(), f"line {i}"))
        for i, line in rows
        if re.match(r"S_rect_0\d:", line)
    ]


def _kitti(P: NDArray[np.float64], size: list[float] | None) -> Lens:
    return make_lens(camera_matrix(P), "none", (), size)


def _colmap(number: int, words: list[str]) -> Lens:
    """Camera of a row ``ID MODEL WIDTH HEIGHT PARAMETERS``; pixels begin at a corner, half a pixel off."""
    kind = words[1]
    if kind not in COLMAP:
        raise DataError(f"line {number}: camera model {kind} is not known, known are {', '.join(COLMAP)}")
    model, order = COLMAP[kind]
    names, values = order.split(), numbers(words[2:], f"line {number}")
    if len(values) != 2 + len(names):
        raise DataError(f"line {number}: {len(values) - 2} parameters of {kind}, expected {order}")
    keys = dict(zip(names, values[2:], strict=True))
    f = keys.get("f", 0.0)
    intrinsics = (keys.get("fx", f), keys.get("fy", f), keys["cx"] - 0.5, keys["cy"] - 0.5)
    terms = (
        ("k1", "k2", "k3", "k4") if model == "fisheye" else ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")
    )
    return make_lens(intrinsics, model, [keys.get(k, 0.0) for k in terms], values[:2])
