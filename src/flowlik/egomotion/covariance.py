"""Covariance of an estimated motion from correlated errors: the sandwich (docs/theory-covariance.md)."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numba import njit

from flowlik.likelihood.shared_errors import ScoreCorrelation, flow_directions
from flowlik.measurement.measurements import Measurements
from flowlik.support.arrays import Array

# two cubic B-splines on a grid of this spacing, in units of the scale, overlap like a Gaussian of it
SPACING = float(np.sqrt(1.5))
LEAST_CURVATURE = 0.05
# bias [px] that vectors of the same fraction of a pixel share, by flow method: images are interpolated alike
# (Schreier, Braasch and Sutton 2000); measured on planes of exact truth (docs/notebook/egomotion.md)
SUBPIXEL_BIAS_PX = {"dis": 0.03}
OTHER_SUBPIXEL_BIAS_PX = 0.01
# flows within a cell of this size [px] have the same fraction
SUBPIXEL_CELL_PX = 0.5


def sandwich(information: Array, variability: Array, basis: Array) -> Array:
    """Covariance (6, 6) ``A^-1 B A^-1`` within the observable directions, and 0 in the others.

    Parameters
    ----------
    information : array (6, 6)
        A, minus the expected derivative of the total score.
    variability : array (6, 6)
        B, covariance of the total score.
    basis : array (6, D)
        Observable directions, orthonormal.
    """
    inverse = basis @ np.linalg.inv(basis.T @ information @ basis) @ basis.T
    return inverse @ variability @ inverse


def observed_sensitivity(
    gradients: Callable[[Array], Array], expected: Array, covariance: Array, basis: Array
) -> Array:
    """Sensitivity A (6, 6) of the total score as this frame has it, over a standard deviation either way.

    The Fisher information is that of a density that holds. Where errors are wider than it says, the score
    changes more slowly with the motion, and a frame tells so itself.

    Parameters
    ----------
    gradients : callable
        Total scores (K, 6) after each of steps (K, 6) along the tangent.
    expected : array (6, 6)
        Fisher information, by which curvatures are measured: none is taken for less than a twentieth of it.
    covariance : array (6, 6)
        Of the motion's error, at first: its principal axes are the steps.
    basis : array (6, D)
        Observable directions, orthonormal.
    """
    C = basis.T @ covariance @ basis
    sigma = np.sqrt(np.diag(C))
    values, vectors = np.linalg.eigh(C / np.outer(sigma, sigma))
    steps = sigma[:, None] * vectors * np.sqrt(np.maximum(values, 1e-12))
    moves = steps.T @ basis.T
    before, after = gradients(np.concatenate([-moves, moves])).reshape(2, *moves.shape)
    A = 0.5 * basis.T @ (before - after).T @ np.linalg.inv(steps)
    root = np.linalg.cholesky(basis.T @ expected @ basis)
    relative = np.linalg.solve(root, np.linalg.solve(root, 0.5 * (A + A.T)).T)
    values, vectors = np.linalg.eigh(relative)
    half = basis @ root @ vectors * np.sqrt(np.maximum(values, LEAST_CURVATURE))
    return half @ half.T


def temperature(information: Array, variability: Array) -> float:
    """Power in (0, 1] of a product of likelihoods at which it is worth what it knows, against a prior.

    ``D / tr(A^-1 B)``: the magnitude adjustment of composite likelihoods (Pauli, Racugno and Ventura 2011).
    Directions that the measurements say nothing about are left out.
    """
    scale = np.sqrt(np.maximum(np.diag(information), 1e-300))
    inverse = np.linalg.pinv(information / np.outer(scale, scale), rcond=1e-9, hermitian=True)
    spread = float(np.trace(inverse @ (variability / np.outer(scale, scale))))
    rank = float(np.linalg.matrix_rank(inverse, hermitian=True))
    return min(rank / spread, 1.0) if spread > 0 else 1.0


def score_covariance(
    m: Measurements, directions: Array, J: Array, fisher: Array, correlation: ScoreCorrelation
) -> Array:
    """Covariance B (6, 6) of the total score ``sum_c J_c^T s_c``, whose terms are correlated over the image.

    Parameters
    ----------
    m : Measurements
        Flow vectors (N,).
    directions : array (C, 2)
        Unit vectors of the error components in {i}, those of a vector side by side.
    J : array (C, 6)
        Jacobian of the components.
    fisher : array (C,)
        Variance of each component's score [1/px^2], its information; 0 leaves it out.
    correlation : ScoreCorrelation
        Of the likelihood.
    """
    G = _whitened(directions, fisher, J, flow_directions(m.flow))
    # of scores along u, v and the flow: what is isotropic counts along both axes, what is vertical along v
    weights = np.stack(
        [correlation.isotropic, correlation.isotropic + correlation.vertical, correlation.along]
    )
    own, whole = _products(G)
    B = np.tensordot(weights[:, 0], own, axes=1) + whole.T @ (weights[:, -1:] * whole)
    for scale, of_scale in zip(correlation.scales_px, weights.T[1:-1]):
        if (of_scale > 0).any():
            B += smoothed_products(m.pixels, G, of_scale, SPACING * scale)
    return B


def subpixel_variability(m: Measurements, directions: Array, J: Array, information: Array) -> Array:
    """Covariance (6, 6) of the total score from the bias that vectors of the same flow share.

    It averages out where flow varies over the image. Where all of it is alike, as of a distant camera's pan
    or a plane that slides by, it is an error of the whole image.

    Parameters
    ----------
    m : Measurements
        Flow vectors (N,).
    directions, J : array (C, 2), (C, 6)
        As of `score_covariance`.
    information : array (C,)
        By how much a component's score changes with its error [1/px^2].
    """
    keys = np.floor(m.flow / SUBPIXEL_CELL_PX) @ [1 << 20, 1]
    _, cell = np.unique(keys, return_inverse=True)
    pulls = _pulls(cell, directions, J, information).reshape(-1, 6)
    return SUBPIXEL_BIAS_PX.get(m.method["name"], OTHER_SUBPIXEL_BIAS_PX) ** 2 * pulls.T @ pulls


def common_variability(bias_px: float, directions: Array, J: Array, information: Array) -> Array:
    """Covariance (6, 6) of the total score from a bias [px] that all of an image shares, else as above."""
    one = np.zeros(1, np.intp)
    pulls = _pulls(one, directions, J, information).reshape(-1, 6)
    return bias_px**2 * pulls.T @ pulls


@njit(cache=True, nogil=True)
def _pulls(cell, directions, J, information):  # type: ignore[no-untyped-def]
    """Sums (cells, 2, 6) over each cell's components of information times direction times Jacobian."""
    pulls, each = np.zeros((cell.max() + 1, 2, 6)), len(directions) // len(cell)
    for c in range(len(directions)):
        for axis in range(2):
            pull = information[c] * directions[c, axis]
            for j in range(6):
                pulls[cell[c // each], axis, j] += pull * J[c, j]
    return pulls


@njit(cache=True, nogil=True)
def _whitened(directions, fisher, J, along):  # type: ignore[no-untyped-def]
    """Scores in units of the root information (N, 3, 6) along u, v and the unit vectors `along` (N, 2)."""
    n = len(along)
    G, each = np.zeros((n, 3, 6)), len(fisher) // n
    for i in range(n):
        for c in range(each * i, each * i + each):
            root = np.sqrt(fisher[c])
            for j in range(6):
                G[i, 0, j] += root * directions[c, 0] * J[c, j]
                G[i, 1, j] += root * directions[c, 1] * J[c, j]
        for j in range(6):
            G[i, 2, j] = along[i, 0] * G[i, 0, j] + along[i, 1] * G[i, 1, j]
    return G


@njit(cache=True, nogil=True, fastmath={"contract", "reassoc"})
def _products(G):  # type: ignore[no-untyped-def]
    """Sums over vectors of ``G_k^T G_k`` (K, 6, 6) and of G_k (K, 6).

    A library's product would wake a thread for it, which spins where other work wants the core.
    """
    kinds = G.shape[1]
    own, whole = np.zeros((kinds, 6, 6)), np.zeros((kinds, 6))
    for i in range(len(G)):
        for k in range(kinds):
            g = G[i, k]
            for j in range(6):
                whole[k, j] += g[j]
                for m in range(6):
                    own[k, j, m] += g[j] * g[m]
    return own, whole


@njit(cache=True, inline="always")
def _spline(a, w):  # type: ignore[no-untyped-def]
    """Weights of the four nodes around a position at fraction a, with a sum of squares of 1."""
    b = 1.0 - a
    w[0], w[3] = b * b * b / 6, a * a * a / 6
    w[1], w[2] = 2.0 / 3 - a * a * (1 - 0.5 * a), 2.0 / 3 - b * b * (1 - 0.5 * b)
    norm = 1 / np.sqrt(w[0] * w[0] + w[1] * w[1] + w[2] * w[2] + w[3] * w[3])
    for k in range(4):
        w[k] *= norm


def smoothed_products(pixels: Array, G: Array, weights: Array, spacing: float) -> Array:
    """``sum_kij w_k k(p_i - p_j) G_ik^T G_jk`` (6, 6) of G (N, K, 6) and weights w (K,).

    k is the overlap of two splines: G is spread over a grid and the nodes' squares are added up.
    """
    cells = (pixels - pixels.min(axis=0)) / spacing
    columns, rows = cells.max(axis=0).astype(np.intp) + 4
    kinds = np.flatnonzero(weights)
    each = _spread(cells, G, kinds, np.sqrt(weights[kinds]), rows, columns).reshape(-1, 6)
    return np.asarray(each.T @ each)


@njit(cache=True, nogil=True, fastmath={"contract", "reassoc"})
def _spread(cells, G, kinds, roots, rows, columns):  # type: ignore[no-untyped-def]
    """G spread over a grid of nodes one cell apart: (rows, columns x kinds x 6)."""
    width = len(kinds) * 6
    grid = np.zeros((rows, columns * width))
    flat, line, wu, wv = np.empty(width), np.empty(4 * width), np.empty(4), np.empty(4)
    for i in range(len(cells)):
        u, v = cells[i, 0], cells[i, 1]
        c0, r0 = int(u), int(v)
        _spline(u - c0, wu)
        _spline(v - r0, wv)
        for k in range(len(kinds)):
            for j in range(6):
                flat[6 * k + j] = roots[k] * G[i, kinds[k], j]
        # four nodes side by side are one row of numbers
        for c in range(4):
            for j in range(width):
                line[c * width + j] = wu[c] * flat[j]
        for r in range(4):
            nodes = grid[r0 + r, c0 * width : (c0 + 4) * width]
            for j in range(4 * width):
                nodes[j] += wv[r] * line[j]
    return grid
