"""Split-half noise: what two disjoint halves of the measurements disagree by. It needs no truth.

Truth has its own noise, which on real roads is larger than that of the estimates; an error that both halves
share, as that of wrong intrinsics, does not show here.
"""

from __future__ import annotations

from collections.abc import Sequence as Seq
from dataclasses import replace

import numpy as np
from scipy.spatial.transform import RigidTransform
from scipy.stats import chi2

from flowlik.egomotion import EgoMotion, Epipolar, Estimator
from flowlik.egomotion.covariance import score_covariance, subpixel_variability
from flowlik.support.arrays import Array

LEAST_STEP_M = 0.3
# median length of a two-dimensional normal, and median absolute value of a normal, of unit deviation
RAYLEIGH_MEDIAN, NORMAL_MEDIAN = 1.177, 0.6745


def direction_noise_mrad(first: RigidTransform, second: RigidTransform) -> float:
    """Noise [mrad] of a pair's direction an axis, from the motions T_k_prev (K,) of both halves.

    The difference of the unit directions across the optical axis has a median length of 1.177 deviations
    and twice a half's variance, which is twice a whole pair's.
    """
    difference = (_direction(first) - _direction(second))[:, :2]
    return float(1000 * np.median(np.linalg.norm(difference, axis=1)) / (2 * RAYLEIGH_MEDIAN))


def rotation_noise_mdeg(first: RigidTransform, second: RigidTransform) -> float:
    """Noise [0.001 deg] of a pair's rotation an axis, the three axes pooled."""
    omega = np.rad2deg((first.rotation * second.rotation.inv()).as_rotvec())
    return float(1000 * np.median(np.abs(omega)) / (2 * NORMAL_MEDIAN))


def direction_errors_mrad(motions: RigidTransform, truth: RigidTransform) -> Array:
    """Angles (K,) [mrad] between the directions of motions T_k_prev and of true ones; 180 deg if still."""
    cosines = np.nan_to_num((_direction(motions) * _direction(truth)).sum(axis=1), nan=-1.0)
    return np.asarray(1000 * np.arccos(np.clip(cosines, -1.0, 1.0)))


def half_distances(
    first: Seq[EgoMotion], second: Seq[EgoMotion], covariances: Seq[Array] | None = None
) -> Array:
    """Squared Mahalanobis distances (K,) between both halves' motions, of five degrees of freedom.

    Lengths of translation are unit. ``covariances`` are those of the differences (`difference_covariance`);
    by default the sums of the halves' own, as if the halves shared no errors.
    """
    if covariances is None:
        covariances = [a.covariance + b.covariance for a, b in zip(first, second)]
    pairs = zip(first, second, covariances)
    return np.array([_distance(a.T_k_prev, b.T_k_prev, C) for a, b, C in pairs])


def difference_covariance(estimator: Estimator, halves_: Seq[Epipolar], motions: Seq[EgoMotion]) -> Array:
    """Covariance (6, 6) of the difference of two halves' motions, which share errors of the whole image.

    The likelihood's correlation of scores and the bias of a fraction of a pixel are those of all vectors,
    within a half and across: a score of the
    first half moves the difference by the inverse of its own sensitivity, one of the second against it.
    """
    effects, fishers, directions = [], [], []
    for residual, motion, sign in zip(halves_, motions, (1.0, -1.0)):
        T = motion.T_k_prev.as_matrix()[:3]
        problem = estimator.problem(residual)
        view = problem.at(T)
        basis = view.errors.basis
        assert motion.sensitivity is not None
        inverse = basis @ np.linalg.inv(basis.T @ motion.sensitivity @ basis) @ basis.T
        effects.append(sign * view.errors.J @ inverse)
        fishers.append(problem.information(view))
        directions.append(view.errors.directions)
    effect, fisher = np.concatenate(effects), np.concatenate(fishers)
    if (correlation := estimator.likelihood.shared_errors.correlation) is None:
        return np.asarray(effect.T @ (fisher[:, None] * effect))
    first, second = (residual.measurements for residual in halves_)
    together = replace(
        first,
        pixels=np.concatenate([first.pixels, second.pixels]),
        flow=np.concatenate([first.flow, second.flow]),
    )
    along = np.concatenate(directions)
    shared = score_covariance(together, along, effect, fisher, correlation)
    return shared + subpixel_variability(together, along, effect, fisher)


def truth_distances(found: Seq[EgoMotion], truth: Seq[RigidTransform]) -> Array:
    """Squared Mahalanobis distances (K,) of motions from true ones, of five degrees of freedom.

    Lengths of translation do not count.
    """
    return np.array(
        [_distance(_unit(a.T_k_prev), _unit(T), _unit_covariance(a)) for a, T in zip(found, truth)]
    )


def _unit(T_k_prev: RigidTransform) -> RigidTransform:
    """Motion with a translation of unit length."""
    t = T_k_prev.translation
    return RigidTransform.from_components(t / np.linalg.norm(t), T_k_prev.rotation)


def _unit_covariance(motion: EgoMotion) -> Array:
    """Covariance (6, 6) of the motion with a translation of unit length."""
    factor = np.repeat([1.0, float(np.linalg.norm(motion.T_k_prev.translation))], 3)
    return np.asarray(motion.covariance / np.outer(factor, factor))


def _distance(a: RigidTransform, b: RigidTransform, covariance: Array) -> float:
    """Squared distance along the left tangent: rotation, and translation orthogonal to its direction."""
    plane = np.linalg.svd(a.translation[None])[2][1:]
    basis = np.zeros((6, 5))
    basis[:3, :3], basis[3:, 3:] = np.eye(3), plane.T
    e, C = basis.T @ (a * b.inv()).as_exp_coords(), basis.T @ covariance @ basis
    return float(e @ np.linalg.solve(C, e))


def half_coverage(distances: Array, confidence: float) -> float:
    """Share of split-half differences within the predicted region of a confidence."""
    return float(np.mean(distances <= chi2.ppf(confidence, 5)))


def _direction(motions: RigidTransform) -> Array:
    """Unit directions (K, 3) from the previous camera's centre to the current one's, in its frame."""
    moves = np.atleast_2d(motions.inv().translation)
    lengths = np.linalg.norm(moves, axis=1, keepdims=True)
    return np.asarray(np.divide(moves, lengths, out=np.full_like(moves, np.nan), where=lengths > 0))
