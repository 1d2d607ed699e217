"""Files of poses, one a row: KITTI, TUM, EuRoC and TartanAir, with what tells which frame a row is."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform, Rotation

from flowlik.errors import DataError
from flowlik.geometry.times import check_times, in_time_order
from flowlik.support.arrays import Array
from flowlik.support.files import numbers, read_csv, read_table, read_text

ROTATION_TOLERANCE = 1e-3
"""Largest deviation from orthonormality that a file's rotation may have; up to it, rotations are mended.

It admits files written with four decimals (1e-4) and KITTI's official ones (1e-6).
"""

KITTI_LAYOUT = "12 numbers (a KITTI pose: the rows of [R | t], 3 x 4)"
TUM_LAYOUT = "8 numbers (a TUM pose: t x y z qx qy qz qw)"
LAYOUTS = {
    7: "7 numbers (a TartanAir pose: x y z qx qy qz qw, axes NED)",
    8: TUM_LAYOUT,
    12: KITTI_LAYOUT,
    13: "13 numbers (frame number or time, then a KITTI pose)",
    16: "16 numbers (a 4 x 4 pose, row by row)",
    17: "17 numbers (frame number or time, then a 4 x 4 pose)",
}
"""What a row of so many numbers is."""

EUROC_LAYOUT = "a time [ns], a position x y z [m] and a quaternion w x y z"

NS_PER_S = 10**9

_NED_CAMERA = RigidTransform.from_rotation(Rotation.from_matrix([[0, 0, 1], [1, 0, 0], [0, 1, 0]]))
"""Takes x right, y down, z forward to TartanAir's axes: x forward, y right, z down."""


@dataclass(frozen=True, eq=False)
class PoseTable:
    """Poses of a file, in its order.

    Attributes
    ----------
    poses : RigidTransform of N
        ``T_n_c`` (EuRoC: ``T_n_b``, of the robot's body) [m].
    times_s : array (N,) or None
        Times [s], increasing, where the file has them.
    frames : int array (N,) or None
        Frame numbers, increasing, where the file has them.
    left_out : int
        Rows left out, since their time or number is that of another row.
    of_body : bool
        Whether the poses are those of a robot's body, not of a camera.
    """

    poses: RigidTransform
    times_s: Array | None = None
    frames: NDArray[np.int64] | None = None
    left_out: int = 0
    of_body: bool = False

    def __len__(self) -> int:
        """Return the number of poses."""
        return len(self.poses)


def read_pose_table(path: Path | str, lenient: bool = False, columns: tuple[int, ...] = ()) -> PoseTable:
    """Read a file of poses; its first row tells the layout.

    Numbers are separated by white space: one of `LAYOUTS`, with ``#`` comments. With commas it is EuRoC's
    csv.

    Parameters
    ----------
    path : Path or str
        File.
    lenient : bool
        Times or numbers may go back or be double: rows are sorted, and of double ones only the first is kept.
    columns : tuple of int
        Numbers of columns that a row may have; by default any of `LAYOUTS`, or EuRoC's.

    Raises
    ------
    DataError
        If the file is missing, empty, or of no such layout; if a row is of another layout than the first,
        holds NaN, or is not a rigid transform within `ROTATION_TOLERANCE`; or if times or numbers do not
        increase.
    """
    lines = (line.partition("#")[0].strip() for line in read_text(path).splitlines())
    first = next(filter(None, lines), "")
    if "," in first and not columns:
        return read_euroc_poses(path, lenient)
    expected, found = columns or tuple(LAYOUTS), len(first.split())
    if found not in expected and not columns:
        what = f"its first row has {found} columns" if found else "empty"
        known = "; ".join(LAYOUTS[n] for n in expected)
        raise DataError(f"{path}: {what}, but expected {known}; or EuRoC's csv")
    return _in_order(_read_rows(path, found if found in expected else expected[0]), path, lenient)


def read_euroc_poses(path: Path | str, lenient: bool = False) -> PoseTable:
    """Read EuRoC's csv of true states: time [ns], position x y z [m], quaternion w x y z, and more.

    Poses are those of the robot's body. Parameters are those of `read_pose_table`.

    Raises
    ------
    DataError
        As `read_pose_table`.
    """
    stamps, rows = [], []
    for where, words in read_csv(path, 8, EUROC_LAYOUT):
        stamps.append(nanoseconds(words[0], where))
        row = numbers(words[1:8], where)
        if abs(np.linalg.norm(row[3:]) - 1) > ROTATION_TOLERANCE:
            raise DataError(f"{where}: not a unit quaternion w x y z")
        rows.append(row)
    table = np.array(rows)
    poses = RigidTransform.from_components(table[:, :3], Rotation.from_quat(table[:, 3:], scalar_first=True))
    return _in_order(PoseTable(poses, np.array(stamps), of_body=True), path, lenient)


def ned_poses(poses: RigidTransform) -> RigidTransform:
    """Poses in TartanAir's NED axes, of poses whose axes are x right, y down, z forward."""
    return _NED_CAMERA * poses * _NED_CAMERA.inv()


def camera_poses(ned: RigidTransform) -> RigidTransform:
    """Poses whose axes are x right, y down, z forward, of poses in TartanAir's NED axes."""
    return _NED_CAMERA.inv() * ned * _NED_CAMERA


def ned_vectors(vectors_c: Array) -> Array:
    """Components (N, 3) in TartanAir's NED axes of vectors whose axes are x right, y down, z forward."""
    return np.asarray(_NED_CAMERA.rotation.apply(vectors_c))


def camera_vectors(vectors_ned: Array) -> Array:
    """Components (N, 3), axes x right, y down, z forward, of vectors in TartanAir's NED axes."""
    return np.asarray(_NED_CAMERA.rotation.inv().apply(vectors_ned))


def _read_rows(path: Path | str, columns: int) -> PoseTable:
    layout = LAYOUTS[columns]
    rows, lines = read_table(path, columns, layout)
    if columns in (7, 8):
        bad = np.abs(np.linalg.norm(rows[:, -4:], axis=1) - 1) > ROTATION_TOLERANCE
        _refuse(bad, path, lines, f"not a unit quaternion, so not {layout}")
        poses = RigidTransform.from_components(rows[:, -7:-4], Rotation.from_quat(rows[:, -4:]))
        return PoseTable(camera_poses(poses)) if columns == 7 else PoseTable(poses, rows[:, 0])
    matrices = rows[:, columns % 4 :].reshape(len(rows), -1, 4)
    R = matrices[:, :3, :3]
    deviation = np.abs(R @ R.transpose(0, 2, 1) - np.eye(3)).max(axis=(1, 2))
    bad = (deviation > ROTATION_TOLERANCE) | (np.linalg.det(R) < 0)
    _refuse(bad, path, lines, f"not a rotation, so not {layout}")
    if columns > 13:
        bad = np.abs(matrices[:, 3] - [0, 0, 0, 1]).max(axis=1) > ROTATION_TOLERANCE
        _refuse(bad, path, lines, f"its last four numbers are not 0 0 0 1, so not {layout}")
    poses = RigidTransform.from_components(matrices[:, :3, 3], Rotation.from_matrix(R))
    if columns % 4 == 0:
        return PoseTable(poses)
    key = rows[:, 0]
    whole = (key % 1 == 0).all() and np.abs(key).max() < 2**53
    return PoseTable(poses, frames=key.astype(np.int64)) if whole else PoseTable(poses, key)


def _refuse(bad: NDArray[np.bool_], path: Path | str, lines: NDArray[np.int64], why: str) -> None:
    if bad.any():
        raise DataError(f"{path}, line {lines[np.argmax(bad)]}: {why}")


def nanoseconds(word: str, where: str) -> float:
    """Time [s] of a whole number of nanoseconds.

    Raises
    ------
    DataError
        Beginning with ``where``, if the word is no such number.
    """
    if not (word.isascii() and word.isdecimal() and len(word) < 20):
        raise DataError(f"{where}: {word!r} is not a time [ns]")
    return int(word) / NS_PER_S


def _in_order(table: PoseTable, path: Path | str, lenient: bool) -> PoseTable:
    key = table.times_s if table.times_s is not None else table.frames
    if key is None:
        return table
    if not lenient:
        what = "" if table.frames is None else ", frame numbers (first column)"
        check_times(np.asarray(key, np.float64), f"{path}{what}")
        return table
    kept = in_time_order(np.asarray(key, np.float64))
    return replace(
        table,
        poses=table.poses[kept],
        times_s=None if table.times_s is None else table.times_s[kept],
        frames=None if table.frames is None else table.frames[kept],
        left_out=len(key) - len(kept),
    )
