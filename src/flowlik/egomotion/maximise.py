"""Maximum likelihood of a motion over chosen components: Fisher scoring, as the estimator refines."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform

from flowlik.egomotion import _kernels
from flowlik.egomotion.posterior import LOST_NAT, Tempered
from flowlik.egomotion.residual import Chosen, Residual
from flowlik.likelihood.likelihood import FlowLikelihood
from flowlik.support.arrays import Array

STEPS = 30
# a step that gains less is a tenth of a standard deviation at most
CONVERGED_NAT = 1e-3
HALVINGS = 3
WORTH_HALVING_NAT = 0.2
# lengths of a step in units of the Fisher information's
SHORTEST, LONGEST = 0.5, 8.0


def maximise(
    residual: Residual,
    likelihood: FlowLikelihood,
    T: Array,
    chosen: NDArray[np.bool_],
    steps: int = STEPS,
    widened: float = 1.0,
    prior: Tempered | None = None,
) -> tuple[Array, float]:
    """Fisher scoring from a motion over chosen components, whose coordinates x are held meanwhile.

    Where the density does not hold, its curvature is not the Fisher information: the steps' length follows
    the curvature along the last one (Barzilai and Borwein 1988).

    Parameters
    ----------
    residual, likelihood : Residual, FlowLikelihood
        Errors and their density, weighted as `residual.composite_weight` says.
    T : array (3, 4)
        Motion to start from.
    chosen : bool array (C,)
        Components that enter.
    steps : int
        Most steps.
    widened : float
        Errors are taken to be so many times as wide as the likelihood says.
    prior : Tempered, optional
        Belief that is added.

    Returns
    -------
    array (3, 4), float
        Motion, and the log-density there [nat].
    """
    held = Chosen.of(residual, likelihood, residual.coordinates(T, likelihood.schedule.index), chosen)

    def equations(T: Array) -> tuple[Array, Array, float]:
        H, b, log_prob, lost = residual.equations(T, held, widened)
        log_prob -= LOST_NAT * lost
        return (H, b, log_prob) if prior is None else prior.add(transform(T), H, b, log_prob)

    H, b, log_prob = equations(T)
    length = 1.0
    for _ in range(steps):
        B = residual.basis(T)
        step = B @ _solve(B.T @ H @ B, B.T @ b)
        gain = b @ step
        if gain < CONVERGED_NAT:
            break
        step = length * step
        # where little is left to gain, the cusp's rounding decides and a shorter step gains no more
        for _ in range(HALVINGS if gain > WORTH_HALVING_NAT else 1):
            candidate = residual.normalise(_kernels.retract(T, step))
            H_new, b_new, log_prob_new = equations(candidate)
            if log_prob_new > log_prob:
                break
            step = 0.5 * step
        else:
            break
        curvature = step @ (b - b_new)
        length = min(max(float(step @ H @ step / curvature), SHORTEST), LONGEST) if curvature > 0 else 1.0
        T, H, b, log_prob = candidate, H_new, b_new, log_prob_new
    return T, float(log_prob)


def transform(T: Array) -> RigidTransform:
    """RigidTransform of a matrix (3, 4)."""
    return RigidTransform.from_matrix(np.vstack([T, [0, 0, 0, 1]]))


def _solve(A: Array, b: Array) -> Array:
    """Solution of a positive definite system, or the shortest one where it is singular."""
    try:
        return np.asarray(np.linalg.solve(A, b), dtype=np.float64)
    except np.linalg.LinAlgError:
        return np.asarray(np.linalg.lstsq(A, b, rcond=1e-14)[0], dtype=np.float64)
