"""Whether flow says anything about a motion, and whether it says it of one motion alone."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from flowlik.egomotion._at_infinity import at_infinity, nearest_rotation, rough_rotation
from flowlik.egomotion._parallax import share_in_front
from flowlik.egomotion._plane import Twin
from flowlik.egomotion.covariance import temperature
from flowlik.egomotion.epipolar import Epipolar
from flowlik.egomotion.moments import Moments, determines
from flowlik.egomotion.problem import Explanation, Problem, View
from flowlik.egomotion.residual import KNOWN_PX
from flowlik.egomotion.result import Status
from flowlik.support.arrays import Array

# without depth: flow shorter than this [px] in half of the vectors is none
STILL_PX = 0.1
# flow shorter than this [px] in 99 % of the vectors is that of one image shown twice
FROZEN_PX = 1e-3
# an inlier known to this width [px] is counted as informative
INFORMATIVE_PX = 1.0
# inliers known well are witnesses of a motion: so many for each of its freedoms, and this share of all
# components; where images have nothing in common there are hardly any
LEAST_KNOWN, LEAST_KNOWN_SHARE = 2, 0.1
# an image without any texture [intensity^2/px^2], not even of noise, is none of the scene
LEAST_TEXTURE = 1e-2
# a rotation that explains so large a share of what the motion explains leaves no parallax
ROTATION_SHARE = 0.75
# and one found in a few steps must explain this share to be looked at closely
ROUGH_SHARE = 0.4
# unless so large a share of the parallax left is of points in front of the camera: as large as errors allow
IN_FRONT_SHARE = 0.9
# where less is in front, nothing tells on which side the points are
LEAST_IN_FRONT_SHARE = 0.25
# two motions of which one is worse by fewer standard deviations cannot be told apart
TOLD_APART = 3.0
# two motions with no deeper valley between them, in the same unit, are one
VALLEY = 2.5


@dataclass(frozen=True)
class Verdict:
    """What a motion that was found is worth.

    Attributes
    ----------
    status : Status
        SOLVED, or why not.
    reason : str
        One line for a status other than SOLVED.
    rotation : Explanation or None
        Points at infinity, where a rotation alone explains the flow.
    alternative : Explanation or None
        Another motion that explains it as well.
    between : Explanation or None
        The motion halfway between two that are one.
    spread : array (2, 6)
        Left tangents from there to either and all round.
    in_front : float
        Share of the parallax that is of points in front of the camera, of the largest that errors allow.
    """

    status: Status = Status.SOLVED
    reason: str = ""
    rotation: Explanation | None = None
    alternative: Explanation | None = None
    between: Explanation | None = None
    spread: Array = field(default_factory=lambda: np.zeros((2, 6)))
    in_front: float = 1.0


def too_little(problem: Problem) -> tuple[Status, str] | None:
    """Why there is nothing to estimate from; None if there is."""
    n, needed = int(problem.kept.any(axis=1).sum()), problem.residual.sampling.minimal
    if n < needed:
        return Status.TOO_FEW, f"{n} flow vectors, {needed} needed"
    length = np.linalg.norm(problem.residual.measurements.flow, axis=1)
    if np.percentile(length, 99) < FROZEN_PX:
        return Status.DEGENERATE, "the two images are the same: frozen, repeated, or still and without noise"
    # with known depth a standstill is a motion like any other
    if not problem.residual.metric and np.median(length[_known(problem)]) < STILL_PX:
        return Status.STILL, "the flow is zero"
    return None


def _known(problem: Problem) -> NDArray[np.bool_]:
    """Vectors (N,) whose stronger component is known well, or all where hardly any is."""
    bounds = problem.bound(problem.coordinates).min(axis=1)
    known = bounds <= KNOWN_PX
    return known if known.sum() > LEAST_KNOWN_SHARE * len(known) else np.ones(len(known), bool)


def judged(
    problem: Problem, view: View, moments: Moments, twin: Twin | None, other: Explanation | None
) -> Verdict:
    """Say what a motion that was found is worth, beside a plane's other or one of what it leaves over.

    A frame that tells nothing has inliers too, those of wide bounds: near any motion at all they are no
    witness of one. A minimal sample explains itself: so many narrow inliers are needed besides.
    """
    if not determines(moments.information, view.errors.basis):
        reason = "the measurements do not determine every direction of the motion"
        return Verdict(Status.DEGENERATE, reason)
    textured = problem.residual.measurements.t[:, 0] > LEAST_TEXTURE
    known = (view.bounds <= KNOWN_PX) & np.repeat(textured, len(view.bounds) // len(textured))
    witnesses = int((view.inliers & known).sum())
    components = int(problem.components.sum())
    if witnesses < max(LEAST_KNOWN * view.errors.basis.shape[1], LEAST_KNOWN_SHARE * components):
        reason = f"{witnesses} of {components} components agree and are known to {KNOWN_PX:g} px: hardly any"
        return Verdict(Status.DEGENERATE, reason)
    if other is not None:
        reason = "two motions, of many vectors each: which is the camera's, one image pair does not tell"
        return Verdict(Status.AMBIGUOUS, reason, alternative=other)
    if not isinstance(problem.residual, Epipolar):
        return Verdict()
    if (rotation := _rotation_alone(problem, view)) is not None:
        reason = "a rotation alone explains the flow: no parallax, no direction"
        return Verdict(Status.DEGENERATE, reason, rotation)
    in_front = min(share_in_front(problem, view.errors.T, view.inliers) / IN_FRONT_SHARE, 1.0)
    if in_front < LEAST_IN_FRONT_SHARE:
        reason = "as many points would be behind the camera as in front of it"
        return Verdict(Status.AMBIGUOUS, reason, in_front=in_front)
    # what correlated errors are worth
    worth = np.sqrt(temperature(moments.sensitivity, moments.variability))
    one_mode = twin is not None and twin.valley < VALLEY
    if twin is None or worth * twin.worse > TOLD_APART or (one_mode and twin.worse > TOLD_APART):
        return Verdict(in_front=in_front)
    if one_mode:
        return Verdict(between=twin.halfway, spread=twin.spread, in_front=in_front)
    reason = "a plane: two motions explain the flow, and the covariance is of one of them"
    return Verdict(Status.AMBIGUOUS, reason, alternative=twin.other, in_front=in_front)


def _rotation_alone(problem: Problem, view: View) -> Explanation | None:
    """Points at infinity, if they explain as much as the motion does; None if there is parallax.

    It is looked for among what is known well, and the rotation is fitted anew: that of the motion makes room
    for its translation.
    """
    far, of_motion = at_infinity(problem), view.inliers[view.used].mean()
    # a rough look spares most frames the fit
    rough = far.at(rough_rotation(far, view.errors.T))
    if _share_known(problem, rough) < ROUGH_SHARE * of_motion:
        return None
    found = nearest_rotation(far, rough.errors.T)
    if _share_known(problem, found.view) < ROTATION_SHARE * of_motion:
        return None
    # many distant points and some near ones: what the rotation leaves over is all in front
    T = np.column_stack([found.view.errors.T[:, :3], view.errors.T[:, 3]])
    return None if share_in_front(problem, T, view.inliers) > IN_FRONT_SHARE else found


def _share_known(problem: Problem, view: View) -> float:
    """Share of inliers among the components known well; 0 without any."""
    known = view.used & (view.bounds <= problem.widest_px)
    return float(view.inliers[known].mean()) if known.any() else 0.0
