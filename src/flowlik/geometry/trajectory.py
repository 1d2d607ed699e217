"""Trajectories: timed poses of a camera, their chaining, and their files (KITTI, TUM)."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import RigidTransform, Rotation

from flowlik.errors import DataError
from flowlik.support.files import atomic_write, read_table, read_text

Array = NDArray[np.float64]

ROTATION_TOLERANCE = 1e-3
"""Largest deviation from orthonormality that a file's rotation may have; up to it, rotations are mended.

It admits files written with four decimals (1e-4) and KITTI's official ones (1e-6).
"""

FRAME_RATE = 10.0
"""Frames a second [Hz] assumed for KITTI files without times."""

KITTI_LAYOUT = "12 numbers (a KITTI pose: the rows of [R | t], 3 x 4)"
TUM_LAYOUT = "8 numbers (a TUM pose: t x y z qx qy qz qw)"


@dataclass(frozen=True)
class Trajectory:
    """Poses of a camera in time order.

    Parameters
    ----------
    timestamps : array (N,)
        Times [s], increasing.
    poses : RigidTransform of N
        ``T_n_c``: takes points in {c} to points in {n} [m].

    Raises
    ------
    DataError
        If there is no pose, times and poses differ in number, or times do not increase.
    """

    timestamps: Array
    poses: RigidTransform

    def __post_init__(self) -> None:
        object.__setattr__(self, "timestamps", np.asarray(self.timestamps, dtype=np.float64))
        if self.poses.single or len(self.poses) == 0:
            raise DataError("a trajectory needs a stack of at least one pose")
        if self.timestamps.shape != (len(self.poses),):
            raise DataError(f"a trajectory of {len(self.poses)} poses has {self.timestamps.size} timestamps")
        check_times(self.timestamps, "trajectory")

    def __len__(self) -> int:
        """Return the number of poses."""
        return len(self.poses)

    @property
    def positions(self) -> Array:
        """Camera centres (N, 3) in {n} [m]."""
        return np.asarray(self.poses.translation, dtype=np.float64)

    @property
    def distances(self) -> Array:
        """Length (N,) [m] of the path from the first pose to each pose."""
        steps = np.linalg.norm(np.diff(self.positions, axis=0), axis=1)
        return np.concatenate([[0.0], np.cumsum(steps)])

    @property
    def length(self) -> float:
        """Length of the path [m]."""
        return float(self.distances[-1])


def time_text(time_s: float) -> str:
    """Time [s] as text, with all digits that tell it from its neighbours: epoch times have many."""
    return np.format_float_positional(time_s, trim="-")


def check_times(timestamps: Array, where: str) -> None:
    """Check that timestamps (N,) [s] are finite and increase; ``where`` begins the message of an error.

    Raises
    ------
    DataError
        If they do not.
    """
    if not np.isfinite(timestamps).all():
        raise DataError(f"{where}: a timestamp is not a finite number")
    back = np.flatnonzero(np.diff(timestamps) <= 0)
    if back.size:
        k = int(back[0])
        a, b = (time_text(t) for t in timestamps[k : k + 2])
        raise DataError(f"{where}: times must increase, but number {k} is {a} s and the next {b} s")


def chain(steps: Iterable[RigidTransform]) -> RigidTransform:
    """Chain frame-to-frame motions into poses.

    Parameters
    ----------
    steps : iterable of RigidTransform
        ``T_k_prev`` of each frame after the first: takes points in the previous camera to the current.

    Returns
    -------
    RigidTransform of N + 1
        ``T_n_c``, the first being the identity: ``T_n_k = T_n_prev * inv(T_k_prev)``.
    """
    matrices = [np.eye(4)]
    for step in steps:
        matrices.append(matrices[-1] @ step.inv().as_matrix())
    return RigidTransform.from_matrix(np.array(matrices))


def read_kitti(path: Path | str, times: Path | str | None = None) -> Trajectory:
    """Read a KITTI pose file: 12 numbers a row, ``T_n_c`` as [R | t].

    Parameters
    ----------
    path : Path or str
        Pose file.
    times : Path or str, optional
        File with one time [s] a row; without it, frame / 10 s.

    Raises
    ------
    DataError
        If a file is missing, empty, has a row of another layout or with NaN, a rotation further than
        `ROTATION_TOLERANCE` from orthonormal, or another number of times than poses.
    """
    poses = read_kitti_poses(path)
    if times is None:
        return Trajectory(np.arange(len(poses)) / FRAME_RATE, poses)
    seconds = read_times(times)
    if len(seconds) != len(poses):
        raise DataError(f"{times}: {len(seconds)} times for the {len(poses)} poses of {path}")
    return Trajectory(seconds, poses)


def read_kitti_poses(path: Path | str) -> RigidTransform:
    """Poses of a KITTI file, as `read_kitti`, without times.

    Raises
    ------
    DataError
        If the file cannot be read, or is not a table of poses.
    """
    rows, lines = read_table(path, 12, KITTI_LAYOUT)
    matrices = rows.reshape(-1, 3, 4)
    R = matrices[:, :, :3]
    deviation = np.abs(R @ R.transpose(0, 2, 1) - np.eye(3)).max(axis=(1, 2))
    bad = np.flatnonzero((deviation > ROTATION_TOLERANCE) | (np.linalg.det(R) < 0))
    if bad.size:
        raise DataError(f"{path}, line {lines[bad[0]]}: not a rotation, so not {KITTI_LAYOUT}")
    return RigidTransform.from_components(matrices[:, :, 3], Rotation.from_matrix(R))


def read_times(path: Path | str, increasing: bool = True) -> Array:
    """Read times (N,) [s], one a row.

    Raises
    ------
    DataError
        If the file cannot be read, or times are not numbers, or go back and ``increasing`` is asked for.
    """
    seconds = read_table(path, 1, "1 number (a time in seconds)")[0][:, 0]
    if increasing:
        check_times(seconds, str(path))
    return seconds


def write_kitti(path: Path | str, trajectory: Trajectory) -> None:
    """Write the poses of a trajectory as a KITTI file, full precision; times are not part of it."""
    rows = trajectory.poses.as_matrix()[:, :3, :].reshape(-1, 12)
    _write_rows(path, rows)


def read_tum(path: Path | str) -> Trajectory:
    """Read a TUM trajectory: ``t x y z qx qy qz qw`` a row ([s], [m], ``T_n_c``), ``#`` comments.

    Raises
    ------
    DataError
        If the file is missing, empty, has a row of another layout or with NaN, a quaternion whose norm
        is further than `ROTATION_TOLERANCE` from 1, or times that do not increase.
    """
    rows, lines = read_table(path, 8, TUM_LAYOUT)
    norms = np.linalg.norm(rows[:, 4:], axis=1)
    bad = np.flatnonzero(np.abs(norms - 1) > ROTATION_TOLERANCE)
    if bad.size:
        raise DataError(f"{path}, line {lines[bad[0]]}: not a unit quaternion, so not {TUM_LAYOUT}")
    check_times(rows[:, 0], str(path))
    rotations = Rotation.from_quat(rows[:, 4:])
    return Trajectory(rows[:, 0], RigidTransform.from_components(rows[:, 1:4], rotations))


def write_tum(path: Path | str, trajectory: Trajectory) -> None:
    """Write a trajectory as a TUM file (``t x y z qx qy qz qw``), full precision."""
    quaternions = trajectory.poses.rotation.as_quat()
    _write_rows(path, np.column_stack([trajectory.timestamps, trajectory.positions, quaternions]))


def read_trajectory(
    path: Path | str, format: Literal["kitti", "tum"] | None = None, times: Path | str | None = None
) -> Trajectory:
    """Read a KITTI or TUM file; without ``format`` its first row tells (12 or 8 numbers).

    Raises
    ------
    DataError
        As `read_kitti` and `read_tum`; or if the first row is of neither format.
    """
    format = format or _guess_format(path)
    if format == "kitti":
        return read_kitti(path, times)
    if times is not None:
        raise DataError(f"{times}: a TUM file has its own times")
    return read_tum(path)


def _guess_format(path: Path | str) -> Literal["kitti", "tum"]:
    rows = (line.partition("#")[0].split() for line in read_text(path).splitlines())
    columns = next((len(words) for words in rows if words), 0)
    if columns == 12:
        return "kitti"
    if columns == 8:
        return "tum"
    found = f"its first row has {columns} columns" if columns else "empty"
    raise DataError(f"{path}: {found}, but expected {KITTI_LAYOUT} or {TUM_LAYOUT}")


def _write_rows(path: Path | str, rows: ArrayLike) -> None:
    with atomic_write(path) as file:
        np.savetxt(file, np.asarray(rows), fmt="%.17g")
