"""Where the camera is around the time of a frame, and how things move while its shutter is open."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import RigidTransform

from flowlik.datasets.next_frame import mover_motions
from flowlik.geometry.motion import relative_motion
from flowlik.support.arrays import Array


def pose_near(poses: RigidTransform, times_s: Array, k: int, offset_s: float) -> RigidTransform:
    """Pose at a time around frame k, on the geodesic of SE(3) to the frame before or after.

    Parameters
    ----------
    poses : RigidTransform (N,)
        T_n_c of each frame.
    times_s : array (N,)
        Time of each frame [s].
    k : int
        Frame.
    offset_s : float
        Time after frame k [s]; before it if negative. Beyond the first and the last frame the neighbouring
        motion goes on; a single frame stays where it is.
    """
    if len(poses) == 1 or offset_s == 0:
        return poses[k]
    other = k + 1 if k == 0 or (offset_s > 0 and k + 1 < len(poses)) else k - 1
    step = (poses[k].inv() * poses[other]).as_exp_coords()
    share = offset_s / (times_s[other] - times_s[k])
    return poses[k] * RigidTransform.from_exp_coords(share * step)


def motions_between(
    T_n_c0: RigidTransform,
    T_n_c1: RigidTransform,
    T_n_o0: RigidTransform | None,
    T_n_o1: RigidTransform | None,
) -> RigidTransform:
    """Motions (1 + M,) of points in the camera [m]: of the static world, then of each moving object.

    Parameters
    ----------
    T_n_c0, T_n_c1 : RigidTransform
        Pose of the camera at the beginning and at the end.
    T_n_o0, T_n_o1 : RigidTransform (M,) or None
        Poses of the moving objects at the same times; None if nothing moves.
    """
    static = relative_motion(T_n_c0, T_n_c1).as_matrix()[None]
    if T_n_o0 is None or T_n_o1 is None:
        return RigidTransform.from_matrix(static)
    moving = mover_motions(T_n_c0, T_n_c1, T_n_o0, T_n_o1).as_matrix()
    return RigidTransform.from_matrix(np.concatenate([static, moving]))
