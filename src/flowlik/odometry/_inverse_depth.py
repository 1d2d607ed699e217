"""Flow along epipolar lines as a measurement of inverse depths, and a robust fit of a model of these."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform

from flowlik.geometry.camera import Pinhole
from flowlik.likelihood.likelihood import FlowLikelihood
from flowlik.likelihood.tables import look_up
from flowlik.measurement.measurements import Measurements
from flowlik.support.arrays import Array

LEAST_VECTORS = 15.0
# the model explains at least this share of the vectors that it is asked about
LEAST_SHARE = 0.2
# what is not the model's lies anywhere along a line, up to this many times a vector's own parallax
CLUTTER = 3.0
# vectors share what a model leaves out: so many count as one (docs/theory-scale.md)
ALIKE = 20.0
ITERATIONS = 50


@dataclass(frozen=True, eq=False)
class EpipolarFlow:
    """Flow vectors of one motion, each with its place along its epipolar line.

    Attributes
    ----------
    measurements : Measurements
        Flow vectors (N,).
    camera : Pinhole
        Camera of both images.
    far : array (N, 3)
        Rays of image k-1, turned into {c} of image k: where a point at infinity is seen.
    t : array (3,)
        Unit translation of the motion.
    direction : array (N, 2)
        Unit vectors in {i} along the epipolar lines, the way in which a point moves that comes nearer.
    """

    measurements: Measurements
    camera: Pinhole
    far: Array
    t: Array
    direction: Array

    @classmethod
    def of(cls, m: Measurements, camera: Pinhole, T_k_prev: RigidTransform) -> EpipolarFlow:
        """Vectors of a motion whose translation is not zero; those without a line are left out."""
        far = T_k_prev.rotation.apply(camera.rays(m.pixels)).reshape(-1, 3)
        t = T_k_prev.translation / np.linalg.norm(T_k_prev.translation)
        with np.errstate(divide="ignore", invalid="ignore"):
            along = camera.v2p_jacobian(far) @ t
        length = np.linalg.norm(along, axis=1)
        seen = (far[:, 2] > 0) & (length > 0)
        return cls(m.select(seen), camera, far[seen], t, along[seen] / length[seen, None])

    def select(self, which: NDArray[np.bool_]) -> EpipolarFlow:
        """Return the vectors at a mask (N,)."""
        return EpipolarFlow(
            self.measurements.select(which), self.camera, self.far[which], self.t, self.direction[which]
        )

    def at(self, w: Array) -> tuple[Array, Array]:
        """Errors (N,) [px] along the lines of points at inverse depths w (N,), and how fast they fall with w.

        Inverse depths are of z in image k-1, times the motion's length.
        """
        points = self.far + w[:, None] * self.t
        m = self.measurements
        with np.errstate(divide="ignore", invalid="ignore"):
            errors = ((m.pixels + m.flow - self.camera.v2p(points)) * self.direction).sum(axis=1)
            slopes = (self.camera.v2p_jacobian(points) @ self.t * self.direction).sum(axis=1)
        behind = points[:, 2] <= 0
        return np.where(behind, np.inf, errors), np.where(behind, 0.0, slopes)

    def by_motion(self, w: Array) -> Array:
        """Derivative (N, 6) of the errors by the left tangent of the motion."""
        x, y, z = (self.far + w[:, None] * self.t).T
        fx, fy, zero = self.camera.fx, self.camera.fy, np.zeros_like(x)
        x, y, near = x / z, y / z, w / z
        along_u = fx * np.stack([x * y, -1 - x * x, y, -near, zero, x * near], axis=1)
        along_v = fy * np.stack([1 + y * y, -x * y, -x, zero, -near, y * near], axis=1)
        return self.direction[:, :1] * along_u + self.direction[:, 1:] * along_v


@dataclass(frozen=True, eq=False)
class Fit:
    """Parameters q (P,) of a linear model of inverse depths, and how well vectors tell them.

    Attributes
    ----------
    q : array (P,)
        Parameters.
    covariance : array (P, P)
        Of their error, the motion given.
    by_motion : array (P, 6)
        Their derivative by the left tangent of the motion.
    belongs : array (N,)
        Probability that each vector is of the model.
    """

    q: Array
    covariance: Array
    by_motion: Array
    belongs: Array


def fit_inverse_depths(
    seen: EpipolarFlow,
    X: Array,
    starts: Array,
    prior: Callable[[Array], Array],
    likelihood: FlowLikelihood,
    spread: Array | float = 0.0,
) -> Fit | None:
    """Fit ``w = X q`` to inverse depths: a mixture of vectors of the model and of others, by EM.

    Parameters
    ----------
    seen : EpipolarFlow
        Vectors (N,).
    X : array (N, P)
        What inverse depths are linear in.
    starts : array (S, P)
        Parameters to begin with; the likeliest is taken.
    prior : callable
        Information (P, P) of a prior with mean 0, given q.
    likelihood : FlowLikelihood
        Of errors along the lines.
    spread : array (N,) or float
        Relative standard deviation of the model's inverse depths at each vector.

    Returns
    -------
    Fit or None
        None where fewer than 15 vectors, or a fifth of them, are of the model.
    """
    likelihood.check_components()
    m = seen.measurements
    if len(m) < LEAST_VECTORS:
        return None
    x = likelihood.schedule.index.along(m, seen.direction)
    tables, rows = likelihood.compiled, likelihood.compiled.rows(x)
    flow, _ = seen.at(np.zeros(len(m)))
    clutter = 1 / (CLUTTER * np.maximum(np.abs(flow), 1.0))
    widened = np.hypot(1.0, spread * flow / likelihood.bound(x, 0.68))

    def density(q: Array) -> Array:
        z, _ = seen.at(X @ q)
        return np.exp(look_up(tables.log_prob, rows, z / widened)) / widened

    q = max(starts, key=lambda q: float(np.log(density(q) + clutter).sum()))
    share = 0.5
    for _ in range(ITERATIONS):
        of_model = share * density(q)
        belongs = of_model / (of_model + (1 - share) * clutter)
        if belongs.sum() < LEAST_VECTORS:
            return None
        share = float(np.clip(belongs.mean(), 0.01, 0.99))
        z, slopes = seen.at(X @ q)
        J = slopes[:, None] * X
        weight = belongs * look_up(tables.weight, rows, z / widened) / (widened**2 * ALIKE)
        weight[slopes == 0] = 0.0
        P = prior(q)
        H = J.T @ (weight[:, None] * J) + P
        step = np.linalg.solve(H, J.T @ (weight * np.where(weight > 0, z, 0.0)) - P @ q)
        q = q + step
        if np.abs(step).max() < 1e-5 * np.linalg.norm(q):
            break
    if share < LEAST_SHARE:
        return None
    fisher = belongs * likelihood.fisher(x) / (widened**2 * ALIKE)
    # where data and prior contradict each other both are less sure: Birge's ratio of the prior's freedoms
    A, pull = J.T @ (fisher[:, None] * J), P @ q
    strain = float(q @ pull + pull @ np.linalg.pinv(A, hermitian=True) @ pull)
    strain /= max(np.linalg.matrix_rank(P, hermitian=True), 1)
    covariance = max(strain, 1.0) * np.asarray(np.linalg.inv(A + P))
    by_motion: Array = np.linalg.solve(H, J.T @ (weight[:, None] * seen.by_motion(X @ q)))
    return Fit(q, covariance, by_motion, belongs)
