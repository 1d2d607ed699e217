"""Whether a motion is wrong by its own covariance: in and far beyond the region of 99.9 %."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import RigidTransform
from scipy.stats import chi2

from flowlik.egomotion import EgoMotion, Status
from flowlik.egomotion.epipolar import observable
from flowlik.geometry.motion import skew
from flowlik.support.arrays import Array

CONFIDENCE = 0.999
GROSSLY = 2.0
"""Grossly wrong is beyond so many radii of that region."""

UNCLAIMED_RAD, UNCLAIMED_M = np.pi, 100.0
"""Standard deviations beyond which a direction of the tangent is not claimed."""

NONE = 1e-9
LEAST_VARIANCE = 1e-20


class Distance(NamedTuple):
    """Mahalanobis distance over the radius of the 99.9 % region, squared distance, and claimed freedoms."""

    radii: float
    squared: float
    freedoms: int


class Verdict(NamedTuple):
    """One motion against the truth.

    ``radii`` is NaN where nothing is claimed; the translation's error is in metres, or without depth the
    direction's in degrees, NaN where there is none.
    """

    radii: float
    squared: float
    freedoms: int
    solved: bool
    rotation_deg: float
    translation: float


UNCLAIMED = Distance(np.nan, np.nan, 0)


def of_motion(motion: EgoMotion, truth: RigidTransform, metric: bool) -> Verdict:
    """Judge what an odometry returned; of two motions said to be ambiguous, the better one counts."""
    found = distance(motion.T_k_prev, motion.covariance, truth, metric)
    other = getattr(motion, "alternative", None)
    if motion.status is Status.AMBIGUOUS and other is not None:
        second = distance(other.T_k_prev, other.covariance, truth, metric)
        found = min((d for d in (found, second) if d.freedoms), key=lambda d: d.radii, default=UNCLAIMED)
        answered = bool(found.radii <= 1)
    else:
        answered = _answered(motion, truth, metric)
    return Verdict(*found, answered, *errors(motion.T_k_prev, truth, metric))


def of_rival(T: RigidTransform | None, covariance: Array, truth: RigidTransform, metric: bool) -> Verdict:
    """Judge a rival's motion; one that found none claims nothing."""
    if T is None:
        return Verdict(*UNCLAIMED, False, np.nan, np.nan)
    return Verdict(*distance(T, covariance, truth, metric), True, *errors(T, truth, metric))


def distance(T: RigidTransform, covariance: Array, truth: RigidTransform, metric: bool) -> Distance:
    """How far the true motion is from the motion found, over what its covariance (6, 6) claims.

    With known depth in the six freedoms of the left tangent; without, in rotation and direction on the
    sphere, whatever the lengths. Where there is no true translation a claimed direction is as wrong as
    can be, unless the covariance knows of the length too, and so of its being zero.
    """
    if np.isnan(covariance).any():
        return UNCLAIMED
    if metric:
        return _within(
            (truth * T.inv()).as_exp_coords(), covariance, np.repeat([UNCLAIMED_RAD, UNCLAIMED_M], 3)
        )
    length, rotated = float(np.linalg.norm(T.translation)), (truth.rotation * T.rotation.inv()).as_rotvec()
    if length < NONE:
        return _within(rotated, covariance[:3, :3], np.full(3, UNCLAIMED_RAD))
    still = np.linalg.norm(truth.translation) < NONE
    along = np.append(np.zeros(3), T.translation / length)
    if still and along @ covariance @ along > (1e-6 * length) ** 2:
        units = np.repeat([UNCLAIMED_RAD, UNCLAIMED_M * length], 3)
        return _within((truth * T.inv()).as_exp_coords(), covariance, units)
    d = T.translation / length
    plane = observable(T.as_matrix()[:3])[3:, 3:]
    to_sphere = np.block([[np.eye(3), np.zeros((3, 3))], [-plane.T @ skew(d), plane.T / length]])
    C = to_sphere @ _finite(covariance) @ to_sphere.T
    units = np.full(5, UNCLAIMED_RAD)
    if not still:
        towards = truth.translation / np.linalg.norm(truth.translation)
        across, angle = plane.T @ towards, angle_between(d, towards)
        if np.linalg.norm(across) > NONE or angle < 1:
            scaled = across * angle / max(float(np.linalg.norm(across)), NONE)
            return _within(np.append(rotated, scaled), C, units)
    # as wrong as can be: half a turn, whichever way is the shortest
    opposite = np.pi * np.linalg.eigh(C[3:, 3:])[1][:, -1]
    return min(_within(np.append(rotated, sign * opposite), C, units) for sign in (-1, 1))


def errors(T: RigidTransform, truth: RigidTransform, metric: bool) -> tuple[float, float]:
    """Error of the rotation [deg]; of the translation [m] or, without depth, of its direction [deg]."""
    rotation = float(np.degrees((truth.rotation * T.rotation.inv()).magnitude()))
    a, b = T.translation, truth.translation
    if metric:
        return rotation, float(np.linalg.norm(a - b))
    if min(np.linalg.norm(a), np.linalg.norm(b)) < NONE:
        return rotation, np.nan
    return rotation, float(np.degrees(angle_between(a, b)))


def angle_between(a: Array, b: Array) -> float:
    """Angle [rad] between two vectors (3,)."""
    return float(np.arctan2(np.linalg.norm(np.cross(a, b)), a @ b))


def _within(error: Array, covariance: Array, units: Array) -> Distance:
    """Distance in the directions of the tangent whose standard deviation is below its unit."""
    variance, axes = np.linalg.eigh(_finite(covariance) / np.outer(units, units))
    claimed = variance < 1
    freedoms = int(claimed.sum())
    if not freedoms:
        return UNCLAIMED
    e = (axes.T @ (error / units))[claimed]
    squared = float(np.sum(e**2 / np.maximum(variance[claimed], LEAST_VARIANCE)))
    return Distance(float(np.sqrt(squared / chi2.ppf(CONFIDENCE, freedoms))), squared, freedoms)


def _finite(covariance: Array) -> Array:
    """Covariance whose infinite variances are huge, and independent of all else."""
    open_ = ~np.isfinite(np.diag(covariance))
    C = np.where(open_[:, None] | open_, 0.0, covariance)
    C[open_, open_] = 1e12
    return C


def _answered(motion: EgoMotion, truth: RigidTransform, metric: bool) -> bool:
    """Whether there is an answer: solved; still where all is; without a direction where there is none."""
    nowhere = np.linalg.norm(truth.translation) < NONE
    if motion.status is Status.STILL:
        return bool(nowhere and truth.rotation.magnitude() < NONE)
    if metric or not nowhere:
        return motion.status is Status.SOLVED
    if motion.predicted or not np.isfinite(motion.covariance[:3, :3]).all():
        return False
    return bool(distance(motion.T_k_prev, motion.covariance, truth, metric).radii <= 1)
