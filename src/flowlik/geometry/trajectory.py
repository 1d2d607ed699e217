"""Trajectories: timed poses of a camera, their chaining, and their files (KITTI, TUM)."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import RigidTransform

from flowlik.errors import DataError
from flowlik.geometry.pose_table import PoseTable, read_pose_table
from flowlik.geometry.times import check_times, read_times
from flowlik.support.files import atomic_write

Array = NDArray[np.float64]

KITTI_COLUMNS = (12, 13, 16, 17)

FRAME_RATE = 10.0
"""Frames a second [Hz] assumed for KITTI files without times."""


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

    Rows of 13 numbers begin with a frame number or a time, those of 16 are 4 x 4.

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
    return _timed(read_pose_table(path, columns=KITTI_COLUMNS), path, times)


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
    return _timed(read_pose_table(path, columns=(8,)), path, None)


def write_tum(path: Path | str, trajectory: Trajectory) -> None:
    """Write a trajectory as a TUM file (``t x y z qx qy qz qw``), full precision."""
    quaternions = trajectory.poses.rotation.as_quat()
    _write_rows(path, np.column_stack([trajectory.timestamps, trajectory.positions, quaternions]))


def read_trajectory(path: Path | str, times: Path | str | None = None) -> Trajectory:
    """Read a file of poses; its first row tells the layout, see `flowlik.geometry.pose_table`.

    Parameters
    ----------
    path : Path or str
        File.
    times : Path or str, optional
        File with one time [s] a row, for a file without times; without it, frame / 10 s.

    Raises
    ------
    DataError
        As `flowlik.geometry.pose_table.read_pose_table`; or if times are given to a file that has its own, or
        are not one a row.
    """
    return _timed(read_pose_table(path), path, times)


def _timed(table: PoseTable, path: Path | str, times: Path | str | None) -> Trajectory:
    if table.times_s is not None:
        if times is not None:
            raise DataError(f"{times}: {path} has its own times")
        return Trajectory(table.times_s, table.poses)
    frames = np.arange(len(table)) if table.frames is None else table.frames
    if times is None:
        return Trajectory(frames / FRAME_RATE, table.poses)
    seconds = read_times(times)
    if len(seconds) != len(table):
        raise DataError(f"{times}: {len(seconds)} times for the {len(table)} poses of {path}")
    return Trajectory(seconds, table.poses)


def _write_rows(path: Path | str, rows: ArrayLike) -> None:
    with atomic_write(path) as file:
        np.savetxt(file, np.asarray(rows), fmt="%.17g")
