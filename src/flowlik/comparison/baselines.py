"""Other people's estimators on the same measurements: OpenCV and, with the extra `baselines`, PoseLib."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from flowlik.egomotion import Epipolar, KnownDepth
from flowlik.errors import DataError
from flowlik.geometry.camera import Pinhole
from flowlik.support.arrays import Array
from flowlik.support.extras import extra

RADII_PX = (0.1, 0.2, 0.35, 0.5, 0.75, 1.0, 1.5, 2.0, 3.0)


@dataclass(frozen=True)
class Pnp:
    """A rival for known depth, with its settings, on the points that a gate leaves.

    Attributes
    ----------
    name : str
        As results name it: ``opencv-ransac``, ``opencv-accurate``, ``opencv-magsac``, ``opencv-fast``,
        or ``poselib-`` and the loss of its refinement.
    radius_px : float
        Reprojection error of inliers [px].
    gate : float or None
        Vectors whose smaller texture is below it [intensity^2/px^2] are left out.
    iterations : int
        Most hypotheses.
    confidence : float
        Probability of a good sample at which drawing stops.

    Raises
    ------
    DataError
        If there is no baseline of that name.
    """

    name: str = "opencv-ransac"
    radius_px: float = 0.5
    gate: float | None = None
    iterations: int = 200
    confidence: float = 0.99

    def __post_init__(self) -> None:
        if self.name not in PNP:
            raise DataError(f"unknown baseline {self.name!r}: known are {', '.join(PNP)}")

    def __call__(self, residual: KnownDepth) -> RigidTransform | None:
        """Motion T_k_prev; None where the rival finds none."""
        m = residual.measurements
        kept = m.t[:, 1] >= (self.gate or 0.0)
        if kept.sum() < 4:
            return None
        points = residual.camera.p2v(m.pixels[kept]) / residual.rho[kept, None]
        ends = m.pixels[kept] + m.flow[kept]
        if self.name.startswith("opencv"):
            return _opencv(points, ends, residual.camera.K, self)
        return _poselib(points, ends, residual.camera, self)


OPENCV = {
    "opencv-ransac": cv2.SOLVEPNP_ITERATIVE,
    "opencv-accurate": cv2.USAC_ACCURATE,
    "opencv-magsac": cv2.USAC_MAGSAC,
    "opencv-fast": cv2.USAC_FAST,
}
LOSSES = ("truncated", "cauchy", "huber", "truncated_cauchy", "truncated_le_zach")
PNP = (*OPENCV, *(f"poselib-{loss}" for loss in LOSSES))


def opencv_pnp(residual: KnownDepth, radius_px: float = 0.5, iterations: int = 200) -> RigidTransform | None:
    """Motion by solvePnPRansac and solvePnPRefineLM on its inliers; None where it finds none."""
    return Pnp("opencv-ransac", radius_px, iterations=iterations)(residual)


def _opencv(points: Array, ends: Array, K: Array, rival: Pnp) -> RigidTransform | None:
    flag = OPENCV[rival.name]
    try:
        if rival.name == "opencv-ransac":
            found, rotation, translation, inliers = cv2.solvePnPRansac(
                points, ends, K, None, iterationsCount=rival.iterations, reprojectionError=rival.radius_px,
                confidence=rival.confidence,
            )  # fmt: skip
        else:
            settings = _usac(flag, rival)
            found, _, rotation, translation, inliers = cv2.solvePnPRansac(
                points, ends, K, None, params=settings
            )
    except cv2.error:
        return None
    if not found or inliers is None or len(inliers) < 4:
        return None
    chosen = inliers.ravel()
    rotation, translation = cv2.solvePnPRefineLM(points[chosen], ends[chosen], K, None, rotation, translation)
    return RigidTransform.from_components(translation.ravel(), Rotation.from_rotvec(rotation.ravel()))


def _usac(flag: int, rival: Pnp) -> cv2.UsacParams:
    """Settings that OpenCV's flags stand for, with the rival's radius and cap."""
    settings = cv2.UsacParams()
    settings.threshold, settings.maxIterations, settings.confidence = (
        rival.radius_px, rival.iterations, rival.confidence,
    )  # fmt: skip
    settings.sampler = cv2.SAMPLING_UNIFORM
    accurate = flag in (cv2.USAC_ACCURATE, cv2.USAC_MAGSAC)
    settings.score = cv2.SCORE_METHOD_MAGSAC if flag == cv2.USAC_MAGSAC else cv2.SCORE_METHOD_MSAC
    settings.loMethod = {
        cv2.USAC_ACCURATE: cv2.LOCAL_OPTIM_GC, cv2.USAC_MAGSAC: cv2.LOCAL_OPTIM_SIGMA,
    }.get(flag, cv2.LOCAL_OPTIM_INNER_AND_ITER_LO)  # fmt: skip
    settings.loIterations, settings.loSampleSize = (10, 50) if accurate else (5, 30)
    return settings


def _poselib(points: Array, ends: Array, camera: Pinhole, rival: Pnp) -> RigidTransform | None:
    poselib: Any = extra("poselib", "this baseline")
    options = {
        "max_reproj_error": rival.radius_px, "max_iterations": rival.iterations,
        "min_iterations": min(rival.iterations, 10), "success_prob": rival.confidence,
    }  # fmt: skip
    refinement = {
        "loss_type": rival.name.removeprefix("poselib-").upper(), "loss_scale": 0.5 * rival.radius_px,
    }  # fmt: skip
    pose, _ = poselib.estimate_absolute_pose(ends, points, _poselib_camera(camera), options, refinement)
    T = np.column_stack([pose.R, pose.t])
    if not np.isfinite(T).all():
        return None
    return RigidTransform.from_components(np.asarray(pose.t), Rotation.from_matrix(pose.R))


def sweep(
    rival: Pnp,
    pairs: Sequence[tuple[KnownDepth, RigidTransform]],
    radii_px: Sequence[float] = RADII_PX,
) -> Pnp:
    """Return the rival at the radius of least median translation error: to be run on calibration data.

    Parameters
    ----------
    rival : Pnp
        Which, with its gate.
    pairs : sequence of (KnownDepth, RigidTransform)
        Residuals and the true motions. A motion not found counts as standing still.
    radii_px : sequence of float
        Radii to try.
    """
    errors = []
    for radius in radii_px:
        tried = replace(rival, radius_px=radius)
        moves = [np.zeros(3) if T is None else T.translation for T in (tried(r) for r, _ in pairs)]
        away = [np.linalg.norm(t - true.translation) for t, (_, true) in zip(moves, pairs)]
        errors.append(np.median(away))
    return replace(rival, radius_px=float(radii_px[int(np.argmin(errors))]))


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


def poselib_relative(
    residual: Epipolar, radius_px: float = 0.5, cauchy_px: float | None = None
) -> RigidTransform | None:
    """Motion with a unit translation by PoseLib's estimate_relative_pose.

    Parameters
    ----------
    residual : Epipolar
        Matches.
    radius_px : float
        Epipolar distance of inliers [px].
    cauchy_px : float, optional
        Scale of a Cauchy loss in the refinement [px], instead of the default options.

    Raises
    ------
    MissingExtraError
        If PoseLib is not installed.
    """
    poselib: Any = extra("poselib", "this baseline")
    m, camera = residual.measurements, _poselib_camera(residual.camera)
    refinement = {} if cauchy_px is None else {"loss_type": "CAUCHY", "loss_scale": cauchy_px}
    pose, _ = poselib.estimate_relative_pose(
        m.pixels, m.pixels + m.flow, camera, camera, {"max_epipolar_error": radius_px}, refinement
    )
    t: Array = np.asarray(pose.t, dtype=np.float64)
    if not np.linalg.norm(t) > 0:
        return None
    return RigidTransform.from_components(t / np.linalg.norm(t), Rotation.from_matrix(pose.R))


def _poselib_camera(c: Pinhole) -> dict[str, Any]:
    return {"model": "PINHOLE", "width": c.width, "height": c.height, "params": [c.fx, c.fy, c.cx, c.cy]}
