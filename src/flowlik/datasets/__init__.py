"""Data sets: one file a format, found by name in a registry or by the layout of their folder."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from flowlik.datasets.base import Sequence
from flowlik.errors import DataError


def _open_kitti(folder: Path) -> Sequence:
    from flowlik.datasets.kitti import KittiOdometry

    return KittiOdometry(folder)


def _open_kitti_raw(folder: Path) -> Sequence:
    from flowlik.datasets.kitti_raw import KittiRaw

    return KittiRaw(folder)


def _open_tartanair(folder: Path) -> Sequence:
    from flowlik.datasets.tartanair import TartanAir

    return TartanAir(folder)


FORMATS: dict[str, Callable[[Path], Sequence]] = {
    "kitti": _open_kitti,
    "kitti-raw": _open_kitti_raw,
    "tartanair": _open_tartanair,
}
"""Format name to a function that opens a folder of it; each imports its reader when called."""

LAYOUTS = {
    "kitti": ("image_0", "image_2"),
    "kitti-raw": ("image_00", "image_02"),
    "tartanair": ("image_lcam_front",),
}
"""Folders of which a sequence of each format holds at least one."""


def guess_format(folder: Path | str) -> str:
    """Name of the format whose layout a folder has.

    Raises
    ------
    DataError
        If the folder is missing, or has the layout of no known format.
    """
    folder = Path(folder)
    if not folder.is_dir():
        raise DataError(f"{folder}: no such folder")
    for name, parts in LAYOUTS.items():
        if any((folder / part).is_dir() for part in parts):
            return name
    expected = "; ".join(f"{name}: {' or '.join(parts)}" for name, parts in LAYOUTS.items())
    raise DataError(f"{folder}: not the folder of a known data set (expected inside it {expected})")


def open_sequence(path: Path | str, format: str | None = None) -> Sequence:
    """Open the folder of a sequence.

    Parameters
    ----------
    path : Path or str
        Folder.
    format : str, optional
        A name in `FORMATS`; by default guessed from the layout.

    Raises
    ------
    DataError
        If the format is unknown, or the folder is not a sequence of it.
    """
    name = format or guess_format(path)
    if name not in FORMATS:
        raise DataError(f"unknown data set format {name!r}, known are {', '.join(FORMATS)}")
    return FORMATS[name](Path(path))
