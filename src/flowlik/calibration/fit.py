"""Fit of a look-up table to a sketch: minimise the negative log-likelihood J(u) of the paper's Eq. (12)."""

from __future__ import annotations

import numpy as np
from scipy.optimize import minimize

from flowlik.calibration.sketch import ErrorSketch, bin_centres, magnitude_centres, x_edges
from flowlik.camera import Array
from flowlik.errors import CalibrationError
from flowlik.families import ErrorFamily
from flowlik.schedule import Schedule

SMOOTHING_NAT = 1e-5
LEAST_COMPONENTS = 1000
OUTER_QUANTILE = 5e-4


def place_knots(sketch: ErrorSketch, knots: int = 16) -> Array:
    """Knots (M,) of x, evenly spaced over all but the outermost 0.05 % of the sketch on either side.

    Raises
    ------
    CalibrationError
        If the sketch holds fewer than 1000 components, or all lie in one bin of x.
    """
    if sketch.total < LEAST_COMPONENTS:
        raise CalibrationError(f"{sketch.total} error components are too few to calibrate (1000 at least)")
    cumulated = np.cumsum(sketch.counts.sum(axis=(1, 2))) / sketch.total
    edges = x_edges()
    low = edges[np.searchsorted(cumulated, OUTER_QUANTILE)]
    high = edges[np.searchsorted(cumulated, 1 - OUTER_QUANTILE) + 1]
    if high - low < 2 * (edges[1] - edges[0]):
        raise CalibrationError("all components have one texture: nothing to schedule over")
    return np.linspace(low, high, knots)


def fit(
    sketch: ErrorSketch, family: ErrorFamily, knots: Array | None = None, smoothing: float = SMOOTHING_NAT
) -> tuple[Schedule, dict[str, float]]:
    """Fit a family's table to a sketch by L-BFGS with analytic gradients.

    Parameters
    ----------
    sketch : ErrorSketch
        Errors.
    family : ErrorFamily
        Density.
    knots : array (M,), optional
        Knots of x; by default `place_knots`.
    smoothing : float
        Weight [nat a component] of the squared second differences of the free parameters between knots:
        just enough that knots with little data do not swap the roles of a mixture's components.

    Returns
    -------
    schedule : Schedule
        The fitted table.
    convergence : dict
        ``nll`` [nat a component], ``iterations`` and ``gradient`` (largest component at the end).

    Raises
    ------
    CalibrationError
        If there is too little data, or the optimiser ends without a finite table.
    """
    knots = place_knots(sketch) if knots is None else knots
    centres = bin_centres()
    counts = sketch.magnitude_counts
    filled = counts.sum(axis=1) > 0
    share = counts[filled] / sketch.total
    hats = Schedule(sketch.index, knots, np.zeros((1, len(knots)))).hats(centres[filled])
    magnitude = magnitude_centres()
    shape = (len(family.parameters), len(knots))

    def objective(flat: Array) -> tuple[float, Array]:
        free = flat.reshape(shape)
        theta = (family.to_theta(free) @ hats)[:, :, None]
        nll = -np.sum(share * family.logpdf(magnitude, theta))
        by_theta = -np.einsum("xz,pxz->px", share, family.gradient(magnitude, theta)[1])
        gradient = by_theta @ hats.T * family.link_derivative(free)
        bend = np.diff(free, n=2, axis=1)
        by_bend = np.zeros(shape)
        by_bend[:, :-2] += bend
        by_bend[:, 1:-1] -= 2 * bend
        by_bend[:, 2:] += bend
        return nll + smoothing * np.sum(bend**2), (gradient + 2 * smoothing * by_bend).ravel()

    start = family.to_free(np.stack([_start(family, share, row, magnitude) for row in hats], axis=1))
    result = minimize(
        objective, start.ravel(), jac=True, method="L-BFGS-B", bounds=[(-30, 30)] * start.size,
        options={"maxiter": 2000, "maxfun": 4000, "ftol": 1e-12, "gtol": 1e-7, "maxcor": 20},
    )  # fmt: skip
    values = family.to_theta(result.x.reshape(shape))
    if not np.isfinite(values).all():
        raise CalibrationError(f"the fit of {family.name} did not end at a finite table: {result.message}")
    convergence = {
        "nll": float(-np.sum(share * family.logpdf(magnitude, (values @ hats)[:, :, None]))),
        "iterations": float(result.nit),
        "gradient": float(np.abs(result.jac).max()),
    }
    return Schedule(sketch.index, knots, values), convergence


def _start(family: ErrorFamily, share: Array, hat: Array, magnitude: Array) -> Array:
    near = share.T @ hat
    # a knot without data starts from the whole population
    return family.start(magnitude, near if near.sum() > 1e-9 else share.sum(axis=0))
