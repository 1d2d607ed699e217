"""Maximum likelihood of a motion over chosen components: Fisher scoring."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform

from flowlik.egomotion.posterior import LOST_NAT, Tempered
from flowlik.egomotion.problem import Problem
from flowlik.egomotion.residual import Linearised
from flowlik.support.arrays import Array

# most steps of a refinement, and rounds in which inliers are chosen anew
STEPS, REFINEMENTS = 30, 5
# a step that gains less is a tenth of a standard deviation at most
CONVERGED_NAT = 1e-3
# most halvings of a step that gains nothing, where more than this is left to gain
HALVINGS, WORTH_HALVING_NAT = 3, 0.2
# lengths of a step in units of the Fisher information's
SHORTEST, LONGEST = 0.5, 8.0


def maximise(
    problem: Problem,
    errors: Linearised,
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
    problem : Problem
        Errors and their density, weighted as `flowlik.egomotion.residual.weighting` says.
    errors : Linearised
        Errors at the motion to start from.
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
    residual, held, T = problem.residual, problem.chosen(errors.x, chosen), errors.T

    def equations(T: Array) -> tuple[Array, Array, float, Array]:
        H, b, log_prob, lost, basis = residual.equations(T, held, widened)
        log_prob -= LOST_NAT * lost
        return *((H, b, log_prob) if prior is None else prior.add(transform(T), H, b, log_prob)), basis

    H, b, log_prob, B = equations(T)
    length = 1.0
    for _ in range(steps):
        step = B @ _solve(B.T @ H @ B, B.T @ b)
        gain = b @ step
        if gain < CONVERGED_NAT:
            break
        step = length * step
        # where little is left to gain, the cusp's rounding decides and a shorter step gains no more
        for _ in range(HALVINGS if gain > WORTH_HALVING_NAT else 1):
            candidate = residual.retract(T, step)
            H_new, b_new, log_prob_new, B_new = equations(candidate)
            if log_prob_new > log_prob:
                break
            step = 0.5 * step
        else:
            break
        curvature = step @ (b - b_new)
        length = min(max(float(step @ H @ step / curvature), SHORTEST), LONGEST) if curvature > 0 else 1.0
        T, H, b, log_prob, B = candidate, H_new, b_new, log_prob_new, B_new
    return T, float(log_prob)


def refine(problem: Problem, T: Array) -> tuple[Linearised, float]:
    """Maximise over inliers, chosen anew until they settle, then over all components if the problem asks.

    Which components count is decided at the motion given. Returns the errors at the motion found, and the
    log-density there [nat].
    """
    view = problem.at(T)
    for _ in range(REFINEMENTS):
        T, log_prob = maximise(problem, view.errors, view.inliers)
        if T is view.errors.T:
            break
        view = problem.at(T, view.used)
    if not problem.refine_all:
        return view.errors, log_prob
    T, log_prob = maximise(problem, view.errors, view.used)
    return problem.residual.at(T, problem.index), log_prob


def transform(T: Array) -> RigidTransform:
    """RigidTransform of a matrix (3, 4)."""
    return RigidTransform.from_matrix(np.vstack([T, [0, 0, 0, 1]]))


def _solve(A: Array, b: Array) -> Array:
    """Solution of a positive definite system, or the shortest one where it is singular."""
    try:
        return np.asarray(np.linalg.solve(A, b), dtype=np.float64)
    except np.linalg.LinAlgError:
        return np.asarray(np.linalg.lstsq(A, b, rcond=1e-14)[0], dtype=np.float64)
