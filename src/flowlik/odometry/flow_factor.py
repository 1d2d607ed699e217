"""A motion as a measurement in a filter or a factor graph (docs/over-time.md)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from flowlik.egomotion import EgoMotion
from flowlik.errors import DataError, ModelError
from flowlik.geometry.motion import skew
from flowlik.likelihood.likelihood import FlowLikelihood
from flowlik.likelihood.over_time import HORIZON_S
from flowlik.support.arrays import Array

Form = Literal["given-rotation", "full"]


@dataclass(frozen=True, eq=False)
class FlowFactor:
    """A measured motion with the covariance that a chain of such measurements is worth.

    Attributes
    ----------
    form : {"given-rotation", "full"}
        What is measured: the translation once the rotation is known from elsewhere, or the whole motion.
    T_k_prev : RigidTransform
        Measured motion: takes points in {c} of image k-1 to {c} of image k [m].
    covariance : array (3, 3) or (6, 6)
        Of `residual`, for a filter that takes frames as independent [m^2, or rad and m].
    by_rotation : array (3, 3)
        Derivative [m/rad] of the measured translation by the rotation that it is given, a left perturbation
        ``exp(w) R_k_prev``: a gyroscope's error enters through it. Zero for ``"full"``.
    """

    form: Form
    T_k_prev: RigidTransform
    covariance: Array
    by_rotation: Array

    def residual(self, T_k_prev: RigidTransform) -> Array:
        """Predicted minus measured: translation (3,) [m], or tangent (6,) of ``exp(xi) T`` [rad, m]."""
        if self.form == "full":
            return np.asarray((T_k_prev * self.T_k_prev.inv()).as_exp_coords())
        return np.asarray(T_k_prev.translation - self.translation(T_k_prev.rotation))

    def translation(self, R_k_prev: Rotation) -> Array:
        """Translation (3,) [m] that is measured if this is the rotation, to first order."""
        w = (R_k_prev * self.T_k_prev.rotation.inv()).as_rotvec()
        return np.asarray(self.T_k_prev.translation + self.by_rotation @ w)


def flow_factor(
    motion: EgoMotion,
    likelihood: FlowLikelihood,
    interval_s: float,
    form: Form = "given-rotation",
    horizon_s: float = HORIZON_S,
) -> FlowFactor | None:
    """Measurement for a filter that takes a motion every ``interval_s``; None where the images tell none.

    Parameters
    ----------
    motion : EgoMotion
        Motion of known depth.
    likelihood : FlowLikelihood
        Model that it was estimated with, which knows how errors stay over time.
    interval_s : float
        Time [s] between the frames.
    form : {"given-rotation", "full"}
        ``"given-rotation"`` for a filter with a gyroscope, whose rotation is far better: what is left of the
        translation's error then stays less. ``"full"`` without one; never both for one motion.
    horizon_s : float
        Time [s] for which the filter goes by flow alone, before a position or a velocity corrects it.

    Raises
    ------
    ModelError
        If the model does not know how errors stay over time.
    DataError
        If the motion has no scale, no time passed, or the form is unknown.
    """
    if form not in ("given-rotation", "full"):
        raise DataError(f"unknown form {form!r} of a flow factor: known are 'given-rotation' and 'full'")
    if not (interval_s > 0 and horizon_s > 0):
        raise DataError(
            f"a flow factor needs a time between frames and a horizon, not {interval_s:g} and {horizon_s:g} s"
        )
    if (over_time := likelihood.shared_errors.over_time) is None:
        raise ModelError(
            "this model does not know how errors stay over time, so that a filter would be far too sure; "
            "shipped models of lucas-kanade and dis do"
        )
    if not motion.solved or motion.predicted or motion.alternative is not None:
        return None
    if not motion.scale_known:
        raise DataError("a flow factor needs a motion in metres; without depth the length is unknown")
    C, T = motion.covariance, motion.T_k_prev
    if not np.isfinite(C).all():
        return None
    if form == "full":
        return FlowFactor(form, T, over_time.full.filter_factor(interval_s, horizon_s) * C, np.zeros((3, 3)))
    gain, left = given_rotation(C)
    factor = over_time.given_rotation.filter_factor(interval_s, horizon_s)
    return FlowFactor(form, T, factor * (left + left.T) / 2, gain - skew(T.translation))


def given_rotation(covariance: Array) -> tuple[Array, Array]:
    """Likeliest translation's error by the rotation's, and the covariance that is left of it.

    Parameters
    ----------
    covariance : array (6, 6)
        Of a motion's tangent (rotation vector [rad], translation [m]).

    Returns
    -------
    gain : array (3, 3)
        Translation [m] a radian.
    left : array (3, 3)
        Of the translation once the rotation is known [m^2].
    """
    C = covariance
    gain = np.asarray(np.linalg.solve(C[:3, :3], C[:3, 3:]).T, dtype=np.float64)
    return gain, C[3:, 3:] - gain @ C[:3, 3:]
