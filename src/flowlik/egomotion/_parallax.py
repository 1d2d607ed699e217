"""Parallax: what flow has beyond a rotation, along the epipolar lines and across them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from flowlik.egomotion.epipolar import Epipolar
from flowlik.egomotion.problem import Problem
from flowlik.geometry.camera import Pinhole
from flowlik.measurement.measurements import Measurements
from flowlik.support.arrays import Array

# errors count as if at most so many times their bound, in comparisons of motions
FARTHEST_BOUNDS = 3.0
# where this share of the points have a parallax beyond that, they tell by themselves where points are
NEAR_SHARE = 0.05


class Parallax(NamedTuple):
    """Of a motion without scale (3, 4) and flow vectors (N,).

    Attributes
    ----------
    along : array (N,)
        Flow beyond the rotation along the epipolar line [px], positive where the point is in front.
    line : array (N, 2)
        Unit vectors in {i} along which points in front move.
    per_inverse_depth : array (N,)
        Length of that move for a small inverse depth [px times the translation's length].
    inverse_depth : array (N,)
        Inverse depth along z in image k-1 [1 / the translation's length].
    """

    along: Array
    line: Array
    per_inverse_depth: Array
    inverse_depth: Array

    @classmethod
    def of(cls, m: Measurements, camera: Pinhole, T: Array) -> Parallax:
        """Parallax of measurements at a motion; NaN where a ray points behind the camera."""
        turned, t = camera.rays(m.pixels) @ T[:, :3].T, T[:, 3]
        with np.errstate(divide="ignore", invalid="ignore"):
            move = camera.v2p_jacobian(turned) @ t
            length = np.linalg.norm(move, axis=1)
            line = move / length[:, None]
            along = np.einsum("ij,ij->i", m.pixels + m.flow - camera.v2p(turned), line)
            # along = inverse_depth * length / (1 + inverse_depth * t_z / turned_z)
            inverse_depth = along / (length - along * t[2] / turned[:, 2])
        return cls(along, line, length, inverse_depth)


def parallax_at(problem: Problem, T: Array) -> tuple[Parallax, Array]:
    """Parallax of a problem without depth at a motion (3, 4), and coordinates (N,) along its lines."""
    residual = problem.residual
    assert isinstance(residual, Epipolar)
    parallax = Parallax.of(residual.measurements, residual.camera, T)
    held = residual.isotropic(problem.index)
    return parallax, problem.index.along(residual.measurements, parallax.line, held)


def lost_log_prob(problem: Problem, errors: Array, x: Array) -> Array:
    """By how much errors (N,) [px] are less probable than none [nat], each taken to be 3 bounds at most."""
    z = np.minimum(np.abs(errors), FARTHEST_BOUNDS * problem.bound(x))
    likelihood = problem.likelihood
    return np.nan_to_num(likelihood.log_prob(0.0 * z, x) - likelihood.log_prob(z, x))


def losses(problem: Problem, T: Array, used: NDArray[np.bool_]) -> Array:
    """Least loss of log-density [nat] of vectors (N,) at a motion (3, 4) whose points are all in front.

    A vector costs what its error across the line costs and, where it would be behind the camera, what its
    parallax costs as an error: there the best depth is infinite.
    """
    across, (parallax, x) = problem.residual.at(T, problem.index), parallax_at(problem, T)
    behind = np.where(parallax.along < 0, lost_log_prob(problem, parallax.along, x), 0.0)
    return np.where(used, lost_log_prob(problem, across.z, across.x) + behind, 0.0)


def share_in_front(problem: Problem, T: Array, used: NDArray[np.bool_]) -> float:
    """How much of the parallax is of points in front of the camera: 1 all, 0 as much as is behind, or less.

    Each vector is weighed by how far its parallax is from an error. Where flow is a rotation and errors, as
    many point one way as the other. Few near points before many far ones are asked alone.
    """
    parallax, x = parallax_at(problem, T)
    side = np.where(used & np.isfinite(parallax.along), np.sign(parallax.along), 0.0)
    lost = np.abs(side) * lost_log_prob(problem, parallax.along, x)
    share = float((side * lost).sum() / max(lost.sum(), 1e-9))
    near = (side != 0) & (np.abs(parallax.along) > FARTHEST_BOUNDS * problem.bound(x))
    if near.sum() > NEAR_SHARE * used.sum():
        share = max(share, float(side[near].mean()))
    return max(share, 0.0)
