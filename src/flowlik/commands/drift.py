"""`flowlik drift`: how far one trajectory strays from another."""

from __future__ import annotations

from pathlib import Path

from flowlik.errors import DataError
from flowlik.evaluation.motion.motion_records import trajectory_records
from flowlik.geometry.trajectory import read_trajectory
from flowlik.results.records import Record


def drift(estimated: Path, truth: Path) -> list[Record]:
    """Drift, KITTI errors and per-frame errors of a trajectory file against the true one.

    Parameters
    ----------
    estimated, truth : Path
        KITTI (12 numbers a row) or TUM (8) files of the same frames.

    Raises
    ------
    DataError
        If a file cannot be read, or the two differ in number of poses.
    """
    first, second = read_trajectory(estimated), read_trajectory(truth)
    if len(first) < 2:
        raise DataError(f"{estimated}: one pose is no trajectory")
    return trajectory_records(first, second, truth.stem, scale="as given", source=estimated.name)
