"""EgoMotion: a motion between two images with its information and status."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import StrEnum

import numpy as np
from scipy.spatial.transform import RigidTransform

from flowlik.support.arrays import Array


class Status(StrEnum):
    """How far a motion can be used."""

    SOLVED = "solved"
    TOO_FEW = "too few"
    DEGENERATE = "degenerate"
    AMBIGUOUS = "ambiguous"
    STILL = "still"


@dataclass(frozen=True, eq=False)
class EgoMotion:
    """Motion of the camera from image k-1 to image k.

    Attributes
    ----------
    T_k_prev : RigidTransform
        Takes points in {c} of image k-1 to {c} of image k [m; unit length if neither ``scale_known`` nor
        ``length_predicted``].
    information : array (6, 6)
        Fisher information along the tangent (rotation vector [rad], translation [m]) of the left
        perturbation in {c} of image k, with components taken as independent: that of the plain product.
        Rank 5 for the epipolar residual, whose translation has no scale. With a prior, of the posterior.
    covariance : array (6, 6)
        Covariance of the error along the same tangent. Where the likelihood knows the correlation of
        scores it is the sandwich A^-1 B A^-1 (docs/theory-covariance.md), else the inverse of
        `information`, which is too small. Along the translation it is that of the length told, and zero where
        that is exact or there is none; NaN where a direction or a length is not determined: where a rotation
        alone explains the flow, of the translation. Of an AMBIGUOUS motion it does not cover the alternative.
    status : Status
        SOLVED, or why not.
    reason : str
        One line for a status other than SOLVED, or for a length that was not told.
    predicted : bool
        Whether the motion and its covariance are a motion model's, since the images did not tell.
    scale_known : bool
        Whether the translation is metric, by depth or by a length told.
    length_predicted : bool
        Whether the length [m] is the one expected after those before, with its uncertainty in ``covariance``.
    inliers : int
        Inliers of *this* motion, in ``inlier_unit``.
    informative : int
        Inlier components whose bound is at most 1 px.
    components : int
        Components that entered, after the gate.
    inlier_unit : str
        ``"vector"`` or ``"component"``.
    excluded : dict
        Flow vectors left out, by reason, and components dropped by the gate.
    outside : float
        Share of components outside the model's calibrated range.
    log_prob : float
        Log-likelihood [nat] of the components used in refinement.
    hypotheses : int
        Hypotheses scored.
    sensitivity : array (6, 6) or None
        A of the sandwich, how fast the total score falls along the same tangent: as this frame shows it where
        the likelihood knows the correlation of scores, else `information`. None where nothing was
        estimated, or the length was told afterwards.
    alternative : EgoMotion or None
        Of an AMBIGUOUS motion the other one, where it is known: a plane's second motion, or that of many
        vectors that this leaves over.
    """

    T_k_prev: RigidTransform
    information: Array
    covariance: Array
    status: Status
    reason: str = ""
    predicted: bool = False
    scale_known: bool = True
    length_predicted: bool = False
    inliers: int = 0
    informative: int = 0
    components: int = 0
    inlier_unit: str = "component"
    excluded: dict[str, int] = field(default_factory=dict)
    outside: float = 0.0
    log_prob: float = 0.0
    hypotheses: int = 0
    sensitivity: Array | None = None
    alternative: EgoMotion | None = None

    @property
    def solved(self) -> bool:
        """Whether the motion was determined by the images; a standstill is."""
        return self.status in (Status.SOLVED, Status.STILL)

    @property
    def covering(self) -> Array:
        """Covariance (6, 6) that covers the alternative too, for what cannot ask for the status."""
        if self.alternative is None:
            return self.covariance
        step = (self.alternative.T_k_prev * self.T_k_prev.inv()).as_exp_coords()
        return np.asarray(self.covariance + np.outer(step, step))

    @property
    def rotation_alone(self) -> bool:
        """Whether the images told the rotation and nothing of the translation."""
        told = np.isfinite(np.diag(self.covariance))
        return bool(told[:3].all() and not told[3:].any())


def of_rotation(covariance: Array, variance: float) -> Array:
    """Covariance (6, 6) of which the rotation's stays, with a translation of any direction.

    ``variance`` [m^2] is that of the translation along each axis; NaN if nothing is known of it.
    """
    found = np.full((6, 6), 0.0 * variance)
    found[:3, :3], found[3:, 3:] = covariance[:3, :3], variance * np.eye(3)
    return found


def unsolved(status: Status, reason: str, excluded: dict[str, int] | None = None) -> EgoMotion:
    """Return the identity with no information and no covariance, and why."""
    zero, unknown = np.zeros((6, 6)), np.full((6, 6), np.nan)
    return EgoMotion(RigidTransform.identity(), zero, unknown, status, reason, excluded=excluded or {})
