"""Other people's estimators on the same measurements: OpenCV and, with the extra `baselines`, PoseLib."""

from __future__ import annotations

import cv2
import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from flowlik.camera import Array
from flowlik.egomotion import Epipolar, KnownDepth
from flowlik.errors import FlowlikError


def opencv_pnp(residual: KnownDepth, radius_px: float = 0.5, iterations: int = 200) -> RigidTransform | None:
    """Motion by solvePnPRansac and solvePnPRefineLM on its inliers; None where it finds none.

    Parameters
    ----------
    residual : KnownDepth
        Points of known depth and their flow.
    radius_px : float
        Reprojection error of inliers [px].
    iterations : int
        Most hypotheses.
    """
    m, K = residual.measurements, residual.camera.K
    if len(m) < 4:
        return None
    points = residual.camera.p2v(m.pixels) / residual.rho[:, None]
    ends = m.pixels + m.flow
    found, rotation, translation, inliers = cv2.solvePnPRansac(
        points, ends, K, None, iterationsCount=iterations, reprojectionError=radius_px, confidence=0.99
    )
    if not found or inliers is None:
        return None
    chosen = inliers.ravel()
    rotation, translation = cv2.solvePnPRefineLM(points[chosen], ends[chosen], K, None, rotation, translation)
    return RigidTransform.from_components(translation.ravel(), Rotation.from_rotvec(rotation.ravel()))


def opencv_essential(
    residual: Epipolar, radius_px: float = 0.5, flag: int = cv2.RANSAC
) -> RigidTransform | None:
    """Motion with a unit translation by findEssentialMat and recoverPose; None where there is none.

    Parameters
    ----------
    residual : Epipolar
        Matches.
    radius_px : float
        Epipolar distance of inliers [px].
    flag : int
        ``cv2.RANSAC``, or one of OpenCV's USAC methods.
    """
    m, K = residual.measurements, residual.camera.K
    first, second = m.pixels, m.pixels + m.flow
    E, inliers = cv2.findEssentialMat(first, second, K, method=flag, prob=0.999, threshold=radius_px)
    if E is None or E.shape != (3, 3):
        return None
    _, R, t, _ = cv2.recoverPose(E, first, second, K, mask=inliers)
    return RigidTransform.from_components(t.ravel(), Rotation.from_matrix(R))


def poselib_relative(residual: Epipolar, radius_px: float = 0.5) -> RigidTransform | None:
    """Motion with a unit translation by PoseLib's estimate_relative_pose with its default options.

    Raises
    ------
    FlowlikError
        If PoseLib is not installed.
    """
    try:
        import poselib
    except ImportError:
        raise FlowlikError("PoseLib is missing: pip install 'flowlik[baselines]'") from None
    m, c = residual.measurements, residual.camera
    camera = {"model": "PINHOLE", "width": c.width, "height": c.height, "params": [c.fx, c.fy, c.cx, c.cy]}
    pose, _ = poselib.estimate_relative_pose(
        m.pixels, m.pixels + m.flow, camera, camera, {"max_epipolar_error": radius_px}, {}
    )
    t: Array = np.asarray(pose.t, dtype=np.float64)
    if not np.linalg.norm(t) > 0:
        return None
    return RigidTransform.from_components(t / np.linalg.norm(t), Rotation.from_matrix(pose.R))
