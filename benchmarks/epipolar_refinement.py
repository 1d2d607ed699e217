"""Two more readings of the epipolar likelihood, to compare with the one the estimator uses.

The estimator looks the error orthogonal to an epipolar line up at the covariates *along the line's normal*.
Here stand the exact density of that error as a sum of two independent eigen-components, and the likelihood
of both components maximised over each point's own positive depth. Neither is fast.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from flowlik.egomotion.epipolar import Epipolar, observable
from flowlik.likelihood.likelihood import FlowLikelihood
from flowlik.likelihood.tables import look_up
from flowlik.support.arrays import Array

STEPS = 12
EVALUATIONS = 150
NODES = 120
PARALLEL = 1e-3
DEPTHS = (2.0, 8.0, 40.0, 400.0)


def log_convolution(likelihood: FlowLikelihood, z: Array, x: Array, c: Array) -> Array:
    """Log-density (N,) [nat] of ``z = c1 z1 + c2 z2`` with independent z1, z2 at their coordinates.

    Parameters
    ----------
    likelihood : FlowLikelihood
        Of one component.
    z : array (N,)
        Error along the normal [px].
    x : array (N, 2)
        Coordinates of the eigen-components.
    c : array (N, 2)
        The normal in the eigenbasis, of unit length.
    """
    c = np.abs(c)
    safe = np.maximum(c, PARALLEL)
    s = np.linspace(np.log(1e-5), np.log(1e4), NODES)
    nodes = np.concatenate([-np.exp(s), np.exp(s)])
    weights = np.tile(np.exp(s) * (s[1] - s[0]), 2)
    density = np.zeros(len(z))
    # a grid around each component's own peak; the share of the other one hands over smoothly between them
    for i, j in ((0, 1), (1, 0)):
        others = (z[:, None] - safe[:, i, None] * nodes) / safe[:, j, None]
        mine, far = (safe[:, i, None] * nodes) ** 2, (safe[:, j, None] * others) ** 2
        p = np.exp(_log_prob(likelihood, nodes, x[:, i, None]) + _log_prob(likelihood, others, x[:, j, None]))
        density += (p * far / (mine + far) * weights).sum(axis=1) / safe[:, j]
    log_density = np.log(np.maximum(density, 1e-300))
    for i in (0, 1):
        alone = c[:, 1 - i] <= PARALLEL
        log_density[alone] = likelihood.log_prob(z[alone], x[alone, i])
    return np.asarray(log_density)


def refine_convolution(residual: Epipolar, likelihood: FlowLikelihood, T: Array, steps: int = STEPS) -> Array:
    """Motion (3, 4) of greatest likelihood by `log_convolution`, from one nearby."""
    m = residual.measurements
    x = likelihood.schedule.index.of(m)
    for _ in range(steps):
        z, normal, J = residual.linearise(T)
        c = np.einsum("nij,ni->nj", m.R_i_e, normal)
        h = np.maximum(0.05 * np.abs(z), 2e-3)
        ahead, behind = (log_convolution(likelihood, np.abs(z) + d, x, c) for d in (h, -0.5 * h))
        weight = np.maximum(-(ahead - behind) / (1.5 * h) / np.maximum(np.abs(z), h), 0.0)
        T = _step(residual, T, J.T @ (weight[:, None] * J), -J.T @ (weight * z))
    return T


def profile_depths(residual: Epipolar, likelihood: FlowLikelihood, T: Array, x: Array) -> tuple[Array, Array]:
    """Inverse ranges rho >= 0 (N,) of greatest likelihood, and the errors z (N, 2) [px] there.

    Lengths are in units of the translation. By reweighted least squares along each line, from several depths.
    """
    m, camera = residual.measurements, residual.camera
    scale = 1.0 / np.linalg.norm(camera.rays(m.pixels), axis=1)
    best, best_rho, best_z = np.full(len(m), -np.inf), np.zeros(len(m)), np.zeros((len(m), 2))
    for depth in DEPTHS:
        rho = scale / depth
        for _ in range(6):
            z, slope = _along_line(residual, T, rho)
            weight = _table(likelihood.compiled.weight, likelihood, z, x)
            step = -(weight * slope * z).sum(axis=1) / np.maximum((weight * slope**2).sum(axis=1), 1e-12)
            rho = np.clip(rho + step, 0.0, scale)
        z, slope = _along_line(residual, T, rho)
        log_prob = np.where(np.isfinite(z).all(axis=1), _log_prob(likelihood, z, x).sum(axis=1), -np.inf)
        better = log_prob > best
        best, best_rho = np.where(better, log_prob, best), np.where(better, rho, best_rho)
        best_z = np.where(better[:, None], z, best_z)
    return best_rho, best_z


def refine_profile(residual: Epipolar, likelihood: FlowLikelihood, T: Array) -> Array:
    """Motion (3, 4) of greatest likelihood over every point's own positive depth, from one nearby.

    By the simplex method: each depth rests on the cusp of one component, where gradients and reweighting
    stall.
    """
    m, index = residual.measurements, likelihood.schedule.index
    x = index.of(m)
    errors = residual.at(T, index)
    usable, B = np.isfinite(errors.z), errors.basis
    J, fisher = errors.J[usable], likelihood.fisher(errors.x[usable])
    information = B.T @ (J.T @ (fisher[:, None] * J)) @ B
    root = B @ np.linalg.inv(np.linalg.cholesky(information)).T

    def moved(u: Array) -> Array:
        return residual.retract(T, root @ u)

    def cost(u: Array) -> float:
        _, z = profile_depths(residual, likelihood, moved(u), x)
        return -float(_log_prob(likelihood, z, x).sum())

    simplex = np.vstack([np.zeros(5), np.eye(5)])
    options = {"initial_simplex": simplex, "maxfev": EVALUATIONS, "xatol": 0.05, "fatol": 0.05}
    return moved(minimize(cost, np.zeros(5), method="Nelder-Mead", options=options).x)


def _along_line(residual: Epipolar, T: Array, rho: Array) -> tuple[Array, Array]:
    """Errors (N, 2) [px] of points at inverse ranges, and their derivative by these."""
    m, camera = residual.measurements, residual.camera
    moved = camera.p2v(m.pixels) @ T[:, :3].T + rho[:, None] * T[:, 3]
    moved[:, 2] = np.maximum(moved[:, 2], 1e-6)
    z = m.errors(camera.v2p(moved) - m.pixels)
    slope = -np.einsum("nij,ni->nj", m.R_i_e, camera.v2p_jacobian(moved) @ T[:, 3])
    return z, slope


def _log_prob(likelihood: FlowLikelihood, z: Array, x: Array) -> Array:
    return _table(likelihood.compiled.log_prob, likelihood, z, x)


def _table(table: NDArray[np.float32], likelihood: FlowLikelihood, z: Array, x: Array) -> Array:
    """Values of a compiled table at errors z and coordinates x of any shapes."""
    z, x = np.broadcast_arrays(z, x)
    values = look_up(table, likelihood.compiled.rows(x).ravel(), np.ascontiguousarray(z).ravel())
    return np.asarray(values).reshape(z.shape)


def _step(residual: Epipolar, T: Array, H: Array, b: Array) -> Array:
    B = observable(T)
    return residual.retract(T, B @ np.linalg.lstsq(B.T @ H @ B, B.T @ b, rcond=None)[0])
