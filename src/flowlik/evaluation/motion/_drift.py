"""How far an estimated trajectory strays from the true one.

Nothing here aligns or scales the estimate unless it says so: the first pose is shared, no more.
Estimated and true trajectory have one pose a frame each, matched by number.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform, Rotation

from flowlik.errors import DataError
from flowlik.geometry.trajectory import Trajectory

Array = NDArray[np.float64]

Align = Literal["none", "se3", "sim3"]
ALIGNMENTS: tuple[Align, ...] = get_args(Align)

KITTI_LENGTHS_M = (100, 200, 300, 400, 500, 600, 700, 800)
KITTI_STEP = 10


@dataclass(frozen=True)
class Segments:
    """Errors over the segments of a path, one entry a segment, as the KITTI devkit lists them.

    Attributes
    ----------
    first, last : int array (S,)
        Frames where a segment begins and ends.
    length_m : array (S,)
        Its nominal length [m].
    t_err_percent, r_err_deg_per_100m : array (S,)
        Its errors.
    """

    first: NDArray[np.int64]
    last: NDArray[np.int64]
    length_m: Array
    t_err_percent: Array
    r_err_deg_per_100m: Array

    def __len__(self) -> int:
        """Return the number of segments."""
        return len(self.first)


@dataclass(frozen=True)
class KittiErrors:
    """The KITTI odometry metric: means over all segments, and the segments.

    ``t_err_percent`` [%] and ``r_err_deg_per_100m`` [deg / 100 m] are None, and ``reason`` says why,
    where the true path holds no segment.
    """

    t_err_percent: float | None
    r_err_deg_per_100m: float | None
    segments: Segments
    reason: str = ""


@dataclass(frozen=True)
class RelativeErrors:
    """Errors of each frame-to-frame motion, one entry a step (N - 1).

    Attributes
    ----------
    translation_m : array (N - 1,)
        Length of the translation's error [m].
    rotation_deg : array (N - 1,)
        Angle of the rotation's error [deg].
    direction_rad : array (N - 1,)
        Angle between estimated and true direction of translation [rad]; NaN where either stands still.
    """

    translation_m: Array
    rotation_deg: Array
    direction_rad: Array


def aligned(estimated: Trajectory, truth: Trajectory, align: Align = "none") -> Trajectory:
    """Lay an estimated trajectory onto the true one.

    Parameters
    ----------
    estimated, truth : Trajectory
        N poses each.
    align : {"none", "se3", "sim3"}
        ``none``: the first pose is shared. Otherwise the positions are moved (``se3``), or moved and scaled
        (``sim3``), onto the true ones by least squares (Umeyama, PAMI 1991), and the rotations turned with
        them.

    Raises
    ------
    DataError
        If the trajectories differ in number of poses, or the alignment is unknown.
    """
    _check_same_length(estimated, truth)
    if align not in ALIGNMENTS:
        raise DataError(f"unknown alignment {align!r}: known are {', '.join(ALIGNMENTS)}")
    if align == "none":
        return Trajectory(estimated.timestamps, truth.poses[0] * estimated.poses[0].inv() * estimated.poses)
    rotation, scale = _umeyama(estimated.positions, truth.positions, scaled=align == "sim3")
    centred = estimated.positions - estimated.positions.mean(axis=0)
    positions = scale * rotation.apply(centred) + truth.positions.mean(axis=0)
    poses = RigidTransform.from_components(positions, rotation * estimated.poses.rotation)
    return Trajectory(estimated.timestamps, poses)


def drift_percent(estimated: Trajectory, truth: Trajectory, align: Align = "none") -> float:
    """Loop-closure drift: 100 · ‖final position error‖ / true length [%].

    Parameters
    ----------
    estimated, truth : Trajectory
        N poses each.
    align : {"none", "se3", "sim3"}
        See `aligned`; by default the first pose is shared, no more.

    Raises
    ------
    DataError
        If the trajectories differ in number of poses, or the true path has no length.
    """
    _check_same_length(estimated, truth)
    if truth.length == 0:
        raise DataError("drift is undefined: the true path has no length")
    end_error = aligned(estimated, truth, align).positions[-1] - truth.positions[-1]
    return float(100 * np.linalg.norm(end_error) / truth.length)


def absolute_trajectory_error(estimated: Trajectory, truth: Trajectory, align: Align = "none") -> float:
    """Root mean square of the position errors (ATE) [m].

    Parameters
    ----------
    estimated, truth : Trajectory
        N poses each.
    align : {"none", "se3", "sim3"}
        See `aligned`; by default the first pose is shared, no more.

    Raises
    ------
    DataError
        If the trajectories differ in number of poses.
    """
    errors = aligned(estimated, truth, align).positions - truth.positions
    return float(np.sqrt((errors**2).sum(axis=1).mean()))


def kitti_errors(estimated: Trajectory, truth: Trajectory) -> KittiErrors:
    """Compute translation and rotation error as the KITTI odometry devkit does, without alignment.

    Segments of 100, 200 … 800 m of the true path, from every tenth frame, each to the first frame
    beyond its length; errors are divided by the nominal length and averaged over all segments.
    Source: Geiger et al., CVPR 2012, devkit ``evaluate_odometry``.

    Raises
    ------
    DataError
        If the trajectories differ in number of poses.
    """
    _check_same_length(estimated, truth)
    distances = truth.distances
    starts = np.arange(0, len(truth), KITTI_STEP)
    first, length = (a.ravel() for a in np.meshgrid(starts, KITTI_LENGTHS_M, indexing="ij"))
    last = np.searchsorted(distances, distances[first] + length, side="right")
    reached = last < len(truth)
    first, last, nominal = first[reached], last[reached], np.asarray(length[reached], dtype=np.float64)

    error = _motions(estimated, first, last).inv() * _motions(truth, first, last)
    t_err = 100 * np.linalg.norm(error.translation, axis=1) / nominal
    r_err = 100 * np.rad2deg(error.rotation.magnitude()) / nominal
    segments = Segments(first, last, nominal, t_err, r_err)
    if len(segments) == 0:
        reason = f"the true path of {truth.length:.1f} m holds no segment of {KITTI_LENGTHS_M[0]} m"
        return KittiErrors(None, None, segments, reason)
    return KittiErrors(float(t_err.mean()), float(r_err.mean()), segments)


def relative_pose_errors(estimated: Trajectory, truth: Trajectory) -> RelativeErrors:
    """Errors of the motion from each frame to the next.

    Raises
    ------
    DataError
        If the trajectories differ in number of poses.
    """
    _check_same_length(estimated, truth)
    estimated_steps, true_steps = _steps(estimated), _steps(truth)
    error = true_steps.inv() * estimated_steps
    a, b = _unit(estimated_steps.translation), _unit(true_steps.translation)
    # The arc tangent keeps its digits where the arc cosine of nearly 1 loses them.
    direction = np.arctan2(np.linalg.norm(np.cross(a, b), axis=1), (a * b).sum(axis=1))
    return RelativeErrors(
        translation_m=np.linalg.norm(error.translation, axis=1),
        rotation_deg=np.rad2deg(error.rotation.magnitude()),
        direction_rad=direction,
    )


def direction_offset(estimated: Trajectory, truth: Trajectory, min_step_m: float = 0.3) -> Array:
    """Constant offset between estimated and true direction of translation, in the camera frame.

    Parameters
    ----------
    estimated, truth : Trajectory
        N poses each.
    min_step_m : float
        Only steps whose true length exceeds this [m] count.

    Returns
    -------
    array (3,)
        Component-wise median of estimated - true unit direction [rad for small offsets] from the
        previous camera's centre to the current one's, in the previous camera's frame.

    Raises
    ------
    DataError
        If the trajectories differ in number of poses, or no step counts.
    """
    _check_same_length(estimated, truth)
    estimated_steps, true_steps = _steps(estimated).translation, _steps(truth).translation
    far = np.linalg.norm(true_steps, axis=1) > min_step_m
    differences = (_unit(estimated_steps) - _unit(true_steps))[far]
    differences = differences[np.isfinite(differences).all(axis=1)]
    if len(differences) == 0:
        raise DataError(f"no direction offset: no step of the true path is longer than {min_step_m} m")
    return np.median(differences, axis=0)


def remove_direction_offset(estimated: Trajectory, offset: Array) -> Trajectory:
    """Subtract a constant offset from the direction of every step, and chain the steps again.

    Parameters
    ----------
    estimated : Trajectory
        N poses; rotations and step lengths are kept, and so is the first pose.
    offset : array (3,)
        As `direction_offset` returns it; the direction is renormalised after the subtraction.
    """
    steps = _steps(estimated)
    lengths = np.linalg.norm(steps.translation, axis=1, keepdims=True)
    directions = _unit(_unit(steps.translation) - np.asarray(offset))
    moves = np.where(lengths > 0, lengths * directions, 0.0)
    world_moves = estimated.poses.rotation[:-1].apply(moves) if len(moves) else moves
    positions = estimated.positions[0] + np.concatenate([np.zeros((1, 3)), np.cumsum(world_moves, axis=0)])
    return Trajectory(
        estimated.timestamps, RigidTransform.from_components(positions, estimated.poses.rotation)
    )


def _check_same_length(estimated: Trajectory, truth: Trajectory) -> None:
    if len(estimated) != len(truth):
        raise DataError(f"the estimated trajectory has {len(estimated)} poses, the true one {len(truth)}")


def _motions(trajectory: Trajectory, first: NDArray[np.int64], last: NDArray[np.int64]) -> RigidTransform:
    """``T_first_last`` of pairs of frames (S,)."""
    return trajectory.poses[first].inv() * trajectory.poses[last]


def _steps(trajectory: Trajectory) -> RigidTransform:
    """``T_prev_k`` of the N - 1 steps; its translation is the move in the previous camera's frame."""
    first = np.arange(len(trajectory) - 1)
    return _motions(trajectory, first, first + 1)


def _unit(vectors: Array) -> Array:
    """Scale vectors (N, 3) to unit length; NaN for zero vectors."""
    norms = np.linalg.norm(vectors, axis=1, keepdims=True)
    return vectors / np.where(norms > 0, norms, np.nan)


def _umeyama(points: Array, target: Array, *, scaled: bool) -> tuple[Rotation, float]:
    """Rotation and, if asked, scale that take centred points (N, 3) to the centred target (N, 3)."""
    a, b = points - points.mean(axis=0), target - target.mean(axis=0)
    rotation = Rotation.align_vectors(b, a)[0] if np.any(a) and np.any(b) else Rotation.identity()
    a = rotation.apply(a)
    return rotation, float((a * b).sum() / (a**2).sum()) if scaled and np.any(a) else 1.0
