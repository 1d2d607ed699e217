"""Covariance of a trajectory's poses from that of its motions, and its files."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from scipy.spatial.transform import RigidTransform

from flowlik.egomotion import EgoMotion
from flowlik.errors import DataError
from flowlik.geometry.motion import adjoint
from flowlik.geometry.trajectory import Trajectory
from flowlik.likelihood.over_time import Persistence
from flowlik.support.arrays import Array
from flowlik.support.files import atomic_write, read_text, write_npz

AXES = ("rx", "ry", "rz", "tx", "ty", "tz")
PAIRS = tuple((i, j) for i in range(6) for j in range(i, 6))
COLUMNS = [f"{kind}_{AXES[i]}_{AXES[j]}" for kind in ("pose", "motion") for i, j in PAIRS]
HEADER = ["frame", "timestamp_s", *COLUMNS]


@dataclass(frozen=True, eq=False)
class TrajectoryCovariance:
    """Covariances along a trajectory.

    Attributes
    ----------
    timestamps : array (N,)
        Times [s].
    poses : array (N, 6, 6)
        Of the right perturbation of each pose, ``T_n_k exp(eta)``: tangent (rotation vector [rad],
        translation [m]) in the camera of frame k. Zero at the first frame, which is the world.
    motions : array (N, 6, 6)
        Of the left perturbation of each motion, ``exp(xi) T_k_prev``, in the same camera; zero at the first.
        That of an ambiguous motion covers its alternative.
    """

    timestamps: Array
    poses: Array
    motions: Array


@dataclass(frozen=True, eq=False)
class ChainedErrors:
    """Errors of a pose at the end of a chain of motions.

    A pose is ``T_n_k = T_n_prev inv(T_k_prev)``. With errors eta of a pose (on the right) and xi of a motion
    (on the left), ``eta_k = Ad(T_k_prev) eta_prev - xi_k`` to first order. What of xi stays from motion to
    motion is a Gauss-Markov bias, whitened by each motion's covariance; what it has in common with eta is
    carried along.

    Attributes
    ----------
    pose : array (6, 6)
        Covariance of eta, as in `TrajectoryCovariance.poses`.
    with_bias : array (6, 6)
        Covariance of eta with the whitened bias.
    persistence : Persistence or None
        How the errors of motions stay; None takes them as independent.
    """

    pose: Array = field(default_factory=lambda: np.zeros((6, 6)))
    with_bias: Array = field(default_factory=lambda: np.zeros((6, 6)))
    persistence: Persistence | None = None

    def after(self, motion: EgoMotion, interval_s: float) -> ChainedErrors:
        """Errors after a motion that took so long [s]."""
        Ad, C = adjoint(motion.T_k_prev), motion.covering
        pose, stays = Ad @ self.pose @ Ad.T, self.persistence
        if stays is None or not np.isfinite(C).all():
            return replace(self, pose=_symmetric(pose + C), with_bias=np.zeros((6, 6)))
        root = _root(C)
        known = Ad @ self.with_bias * np.exp(-interval_s / stays.memory_s)
        shared = known @ root.T
        pose = pose + stays.variance * C - shared - shared.T
        return replace(self, pose=_symmetric(pose), with_bias=known - stays.share * root)


def trajectory_covariance(
    timestamps: Array, motions: Sequence[EgoMotion], persistence: Persistence | None = None
) -> TrajectoryCovariance:
    """Covariance of poses that are chained from motions (`ChainedErrors`).

    Parameters
    ----------
    timestamps : array (N,)
        Times [s] of the frames.
    motions : sequence of N - 1 EgoMotion
        Of every frame after the first.
    persistence : Persistence, optional
        How the errors of motions stay, ``shared_errors.over_time.full`` of a likelihood; by default they are
        taken as independent, and the covariances are far too small after some seconds.

    Raises
    ------
    DataError
        If there is not one time more than motions.
    """
    if len(timestamps) != len(motions) + 1:
        raise DataError(f"{len(timestamps)} times for {len(motions)} motions, expected one more")
    errors = ChainedErrors(persistence=persistence)
    poses, steps = [errors.pose], [np.zeros((6, 6))]
    for motion, interval_s in zip(motions, np.diff(timestamps)):
        errors = errors.after(motion, float(interval_s))
        poses.append(errors.pose)
        steps.append(motion.covering)
    return TrajectoryCovariance(np.asarray(timestamps, np.float64), np.array(poses), np.array(steps))


def _symmetric(matrix: Array) -> Array:
    return np.asarray((matrix + matrix.T) / 2)


def _root(covariance: Array) -> Array:
    """Root L (6, 6), ``L L^T`` the covariance, which varies smoothly with it and not with its units."""
    sigma = np.sqrt(np.diag(covariance))
    unit = np.where(sigma > 0, sigma, 1.0)
    values, vectors = np.linalg.eigh(covariance / np.outer(unit, unit))
    return np.asarray(unit[:, None] * (vectors * np.sqrt(np.maximum(values, 0.0))) @ vectors.T)


def _write_covariance_csv(path: Path | str, covariance: TrajectoryCovariance) -> None:
    """Write covariances as CSV: one row a frame, the upper triangles of both matrices, row by row.

    ``pose_rx_tz`` is the covariance of rotation about x [rad] and translation along z [m] of the pose, and so
    on; ``nan`` where a direction is not determined.

    Raises
    ------
    DataError
        If the place cannot be written to.
    """
    rows, columns = np.array(PAIRS).T
    with atomic_write(path) as file:
        writer = csv.writer(file)
        writer.writerow(HEADER)
        for k, time_s in enumerate(covariance.timestamps):
            upper = [*covariance.poses[k][rows, columns], *covariance.motions[k][rows, columns]]
            writer.writerow([k, f"{time_s:.17g}", *(f"{value:.17g}" for value in upper)])


def read_covariance_csv(path: Path | str) -> TrajectoryCovariance:
    """Read what `_write_covariance_csv` wrote.

    Raises
    ------
    DataError
        If the file is missing or of another layout.
    """
    lines = read_text(path).splitlines()
    try:
        rows = list(csv.reader(lines))
    except csv.Error as error:
        raise DataError(f"{path}: not readable CSV ({error})") from error
    if not rows or rows[0] != HEADER:
        raise DataError(f"{path}: not a table of covariances, whose header begins {','.join(HEADER[:3])}")
    try:
        table = np.array([[float(word) for word in row] for row in rows[1:]]).reshape(-1, len(HEADER))
    except ValueError as error:
        raise DataError(f"{path}: a row does not hold {len(HEADER)} numbers") from error
    matrices = []
    for upper in (table[:, 2 : 2 + len(PAIRS)], table[:, 2 + len(PAIRS) :]):
        full = np.zeros((len(table), 6, 6))
        for n, (i, j) in enumerate(PAIRS):
            full[:, i, j] = full[:, j, i] = upper[:, n]
        matrices.append(full)
    return TrajectoryCovariance(table[:, 1], *matrices)


def _write_trajectory_npz(path: Path | str, trajectory: Trajectory, covariance: TrajectoryCovariance) -> None:
    """Write ``timestamps_s`` (N,), ``T_n_c`` (N, 4, 4), ``pose_covariance`` and ``motion_covariance``.

    Raises
    ------
    DataError
        If the place cannot be written to.
    """
    arrays = {
        "timestamps_s": trajectory.timestamps,
        "T_n_c": trajectory.poses.as_matrix(),
        "pose_covariance": covariance.poses,
        "motion_covariance": covariance.motions,
    }
    write_npz(path, arrays)


def write_covariance(
    folder: Path,
    trajectory: Trajectory,
    motions: Sequence[EgoMotion],
    persistence: Persistence | None = None,
) -> None:
    """Write ``covariance.csv`` and ``trajectory.npz`` of a trajectory chained from motions.

    ``persistence`` is as in `trajectory_covariance`.

    Raises
    ------
    DataError
        If there is not one time more than motions, or the place cannot be written to.
    """
    write_covariances(folder, trajectory, trajectory_covariance(trajectory.timestamps, motions, persistence))


def write_covariances(folder: Path, trajectory: Trajectory, covariance: TrajectoryCovariance) -> None:
    """Write ``covariance.csv`` and ``trajectory.npz`` of a trajectory whose covariances are known.

    Raises
    ------
    DataError
        If the place cannot be written to.
    """
    _write_covariance_csv(folder / "covariance.csv", covariance)
    _write_trajectory_npz(folder / "trajectory.npz", trajectory, covariance)


def world_covariance(T_n_c: RigidTransform, covariance: Array) -> Array:
    """Covariance (6, 6) about the world's axes, of small turns [rad] and of the position [m] in {n}.

    From that of the pose's right perturbation: ``R exp(w) = exp(R w) R`` and ``p + R v``.
    """
    R = T_n_c.rotation.as_matrix()
    turn = np.zeros((6, 6))
    turn[:3, :3] = turn[3:, 3:] = R
    return np.asarray(turn @ covariance @ turn.T)
