"""A measured motion as a factor of a GTSAM graph (docs/over-time.md)."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.spatial.transform import RigidTransform

from flowlik.geometry.motion import skew
from flowlik.odometry import FlowFactor
from flowlik.support.arrays import Array
from flowlik.support.extras import extra

UNTOLD_ROTATION_RAD = 1.0
"""Standard deviation of the rotation in a translation given the rotation: far beyond any gyroscope's."""


def gtsam_factor(factor: FlowFactor, previous: int, current: int, T_b_c: RigidTransform | None = None) -> Any:
    """GTSAM's between-factor of two body poses ``T_n_b`` that says what a flow factor measures.

    It is a built-in factor, some hundred times as fast as one in Python. In that of a translation given the
    rotation, the rotation has a standard deviation of one radian: what the graph knows of it is the
    gyroscope's, which does not enter twice, and moves the translation by ``by_rotation``.

    Parameters
    ----------
    factor : FlowFactor
        Of `flowlik.odometry.flow_factor`.
    previous, current : int
        GTSAM's keys of the body's poses (``Pose3``) at image k-1 and image k.
    T_b_c : RigidTransform, optional
        Takes points in the camera to the body, mostly the IMU: its rotation, and the lever arm [m].
        By default the body is the camera.

    Returns
    -------
    gtsam.BetweenFactorPose3
        Whose error is minus the left perturbation of ``T_k_prev``, turned into the body by the adjoint.

    Raises
    ------
    MissingExtraError
        If GTSAM is not installed.
    """
    gtsam = extra("gtsam", "a GTSAM factor")
    # exp(xi) T_k_prev has the inverse Z exp(-xi), and B Z exp(-xi) B^-1 = B Z B^-1 exp(-Ad(B) xi)
    measured, back = gtsam.Pose3(factor.T_k_prev.as_matrix()).inverse(), np.eye(6)
    if T_b_c is not None:
        B = gtsam.Pose3(T_b_c.as_matrix())
        measured = B * measured * B.inverse()
        back = B.inverse().AdjointMap()
    information = back.T @ _information(factor) @ back
    noise = gtsam.noiseModel.Gaussian.Information((information + information.T) / 2)
    return gtsam.BetweenFactorPose3(previous, current, measured, noise)


def _information(factor: FlowFactor) -> Array:
    """Information (6, 6) along the tangent (rotation vector [rad], translation [m]) of a left error."""
    if factor.form == "full":
        return np.asarray(np.linalg.inv(factor.covariance))
    # the translation of exp(xi) T moves by v + w x t, of which by_rotation w is measured
    H = np.hstack([-(factor.by_rotation + skew(factor.T_k_prev.translation)), np.eye(3)])
    told = H.T @ np.linalg.solve(factor.covariance, H)
    told[:3, :3] += np.eye(3) / UNTOLD_ROTATION_RAD**2
    return np.asarray(told)
