"""The second motion that explains the flow of a plane (Longuet-Higgins 1986)."""

from __future__ import annotations

from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from flowlik.egomotion._parallax import losses, parallax_at
from flowlik.egomotion.epipolar import Epipolar
from flowlik.egomotion.maximise import refine, transform
from flowlik.egomotion.problem import Explanation, Problem
from flowlik.egomotion.residual import Linearised
from flowlik.support.arrays import Array

# a plane that holds this share of the inliers may have a second motion worth a look
PLANE_SHARE = 0.5
# rounds of a robust fit of a plane
ROUNDS = 6


class Twin(NamedTuple):
    """The other of two motions of a plane, beside the better one.

    Attributes
    ----------
    other : Explanation
        Its errors.
    worse : float
        By how much less it explains, in standard deviations of what errors alone make of a difference.
    halfway : Explanation
        Between the two.
    spread : array (2, 6)
        Left tangents from halfway to the other, in the directions that the better one observes, and as far
        all round the translation: near a plane that is approached head on the likelihood has no corners.
    valley : float
        By how much less the motion halfway explains than either, in the same unit.
    """

    other: Explanation
    worse: float
    halfway: Explanation
    spread: Array
    valley: float


def better_of_two(problem: Problem, found: Explanation) -> tuple[Explanation, Twin | None]:
    """Return the better motion, by the same likelihood, where most inliers lie on a plane, and the other.

    Points on a plane do not tell which of two motions it is. Others do, and points behind the camera.
    """
    residual, T, used = problem.residual, found.view.errors.T, found.view.used
    if not isinstance(residual, Epipolar):
        return found, None
    plane = _plane(problem, T, found.view.inliers)
    candidates = [] if plane is None else _other_motions(T, plane)
    if not candidates:
        return found, None
    costs = [losses(problem, candidate, used).sum() for candidate in candidates]
    candidate = candidates[int(np.argmin(costs))]
    errors, log_prob = refine(problem, candidate)
    if _apart(errors.T, candidate) > _apart(errors.T, T):
        # two that are nearly one: it went over to the first
        errors = residual.at(candidate, problem.index)
    second = Explanation(problem.look(errors, used), log_prob)
    least, most = (losses(problem, e.view.errors.T, used) for e in (found, second))
    best, other = found, second
    if most.sum() < least.sum():
        best, other, least, most = second, found, most, least
    spread = 0.5 * _steps(best.view.errors, other.view.errors.T)
    between = residual.retract(best.view.errors.T, spread[0])
    halfway = Explanation(problem.at(between, used), other.log_prob)
    valley = _deviations(losses(problem, between, used) - most)
    return best, Twin(other, _deviations(most - least), halfway, spread, valley)


def _deviations(difference: Array) -> float:
    """Sum of differences (N,) over what it would be by chance, signs being drawn."""
    return float(difference.sum() / max(np.linalg.norm(difference), 1e-9))


def _steps(errors: Linearised, T: Array) -> Array:
    """Left tangents (2, 6) from the motion of errors to another, and that turned about its translation."""
    t = errors.T[:, 3]
    turn = transform(np.column_stack([T[:, :3] @ errors.T[:, :3].T, np.zeros(3)])).rotation
    step = errors.basis @ errors.basis.T @ np.concatenate([turn.as_rotvec(), T[:, 3] - turn.apply(t)])
    return np.stack([step, np.cross(t, step.reshape(2, 3)).ravel()])


def _plane(problem: Problem, T: Array, inliers: NDArray[np.bool_]) -> Array | None:
    """Normal over distance (3,) [1 / the translation's length] of a plane; None if it holds too few."""
    residual = problem.residual
    assert isinstance(residual, Epipolar)
    parallax, x = parallax_at(problem, T)
    usable = inliers & np.isfinite(parallax.inverse_depth)
    # inverse depth is linear in the ray: errors of it in units of the bound
    scale = (parallax.per_inverse_depth / problem.bound(x))[usable]
    rays, rho = residual.camera.rays(residual.measurements.pixels)[usable], parallax.inverse_depth[usable]
    weight = np.ones(len(rho))
    for _ in range(ROUNDS):
        A = (weight * scale**2)[:, None] * rays
        try:
            plane = np.asarray(np.linalg.solve(A.T @ rays, A.T @ rho), np.float64)
        except np.linalg.LinAlgError:
            return None
        off = scale * (rho - rays @ plane)
        weight = 1 / (1 + off**2)
    return plane if (np.abs(off) <= 1).mean() >= PLANE_SHARE else None


def _apart(first: Array, second: Array) -> float:
    """How far two motions (3, 4) of unit translation are apart, by rotation and direction."""
    return float(np.linalg.norm(first - second))


def _other_motions(T: Array, plane: Array) -> list[Array]:
    """Motions (3, 4) of unit translation with the homography of T and a plane, but not T, nor T reversed."""
    R, t = T[:, :3], T[:, 3]
    cv: Any = cv2
    _, rotations, translations, _ = cv.decomposeHomographyMat(R + np.outer(t, plane), np.eye(3))
    found = [np.column_stack([R2, t2 / np.linalg.norm(t2)]) for R2, t2 in zip(rotations, translations)
             if np.linalg.norm(t2) > 0]  # fmt: skip
    away = [min(_apart(M, T), _apart(np.column_stack([M[:, :3], -M[:, 3]]), T)) for M in found]
    # solutions come in pairs of opposite translation: the nearest pair is T's own
    own = np.min(away, initial=np.inf)
    return [M for M, distance in zip(found, away) if distance > own + 1e-6]
