"""The motion of one camera without depth: a direction, whose length the other sensors tell."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import RigidTransform

from flowlik.egomotion import EgoMotion
from flowlik.errors import DataError
from flowlik.geometry.motion import scaled, skew
from flowlik.odometry import FlowFactor
from flowlik.odometry.flow_factor import Form, given_rotation
from flowlik.support.arrays import Array

UNTOLD_LENGTH = 100.0
"""Standard deviation of a length that is not told, over the length."""
MOST_UNKNOWN = 0.3
"""Standard deviation of a step, over its length, up to which its direction is used."""


@dataclass(frozen=True, eq=False)
class DirectionFactor:
    """A measured rotation and direction, to be used at the length that a smoother predicts.

    Attributes
    ----------
    form : {"given-rotation", "full"}
        As of `flowlik.odometry.FlowFactor`.
    T_k_prev : RigidTransform
        Measured motion, of unit length.
    covariance : array (6, 6)
        Of its tangent, for a filter that takes frames as independent; nothing along the translation.
    """

    form: Form
    T_k_prev: RigidTransform
    covariance: Array

    def at_length(self, length_m: float) -> FlowFactor:
        """Flow factor of a step of so many metres, whose length it says nothing of."""
        scale = np.repeat([1.0, length_m], 3)
        C = scale[:, None] * self.covariance * scale
        T = scaled(self.T_k_prev, length_m)
        along = UNTOLD_LENGTH**2 * np.outer(T.translation, T.translation)
        if self.form == "full":
            C[3:, 3:] += along
            return FlowFactor("full", T, C, np.zeros((3, 3)))
        gain, left = given_rotation(C)
        return FlowFactor("given-rotation", T, (left + left.T) / 2 + along, gain - skew(T.translation))


def direction_factor(
    motion: EgoMotion, long_run_factor: float, form: Form = "given-rotation"
) -> DirectionFactor | None:
    """Direction as a measurement; None where the images tell none.

    Parameters
    ----------
    motion : EgoMotion
        Of one camera, of unit length.
    long_run_factor : float
        By which the variance of a sum of such errors exceeds that of independent ones. It is not calibrated
        for directions and must be stated.
    form : {"given-rotation", "full"}
        As of `flowlik.odometry.flow_factor`.

    Raises
    ------
    DataError
        If the factor is not above 0, or the motion has a length.
    """
    if not 0 < long_run_factor < np.inf:
        raise DataError(f"a long-run factor must be above 0, not {long_run_factor:g}")
    if not motion.solved or motion.predicted or motion.alternative is not None:
        return None
    C, length = motion.covariance, float(np.linalg.norm(motion.T_k_prev.translation))
    if not np.isfinite(C).all() or length == 0:
        return None
    if motion.scale_known or abs(length - 1) > 1e-6:
        raise DataError("a direction is of unit length; a motion in metres is a flow factor")
    return DirectionFactor(form, motion.T_k_prev, long_run_factor * C)
