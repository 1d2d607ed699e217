"""Fit of a look-up table to a sketch: minimise the negative log-likelihood J(u) of the paper's Eq. (12)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.optimize import minimize

from flowlik.calibration.sketch import ErrorSketch, bin_centres, magnitude_centres, merge_all, x_edges
from flowlik.errors import CalibrationError
from flowlik.likelihood.families import ErrorFamily
from flowlik.likelihood.schedule import Schedule, hat_weights
from flowlik.support.arrays import Array

SMOOTHING_NAT = 1e-5
SMOOTHINGS_NAT = (1e-6, 1e-5, 1e-4, 1e-3)
LEAST_COMPONENTS = 1000
LEAST_AT_KNOT = 200
OUTER_QUANTILE = 5e-4
COARSER = 4
ROWS = 56


def place_knots(sketch: ErrorSketch, knots: int = 16) -> Array:
    """Knots (M,) of x, evenly spaced over all but the outermost 0.05 % of the sketch on either side.

    Knots with fewer than 200 components between their neighbours are left out.

    Raises
    ------
    CalibrationError
        If the sketch holds fewer than 1000 components, or all lie in one bin of x.
    """
    if sketch.total < LEAST_COMPONENTS:
        raise CalibrationError(f"{sketch.total} error components are too few to calibrate (1000 at least)")
    per_bin = sketch.counts.sum(axis=(1, 2))
    cumulated = np.cumsum(per_bin) / sketch.total
    edges = x_edges(sketch.index)
    low = edges[np.searchsorted(cumulated, OUTER_QUANTILE)]
    high = edges[np.searchsorted(cumulated, 1 - OUTER_QUANTILE) + 1]
    if high - low < 2 * (edges[1] - edges[0]):
        raise CalibrationError(f"all components have one {sketch.index.name}: nothing to schedule over")
    even = np.linspace(low, high, knots)
    below = np.interp(even, edges, np.concatenate([[0], np.cumsum(per_bin)]))
    supported = np.concatenate([[True], below[2:] - below[:-2] >= LEAST_AT_KNOT, [True]])
    return even[supported]


def fit(
    sketch: ErrorSketch,
    family: ErrorFamily,
    knots: Array | None = None,
    smoothing: float = SMOOTHING_NAT,
    start: Array | None = None,
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
    start : array (P, M), optional
        Parameters to begin from; by default each knot's own data decide, by expectation maximisation where
        the family is a mixture.

    Returns
    -------
    schedule : Schedule
        The fitted table.
    convergence : dict
        ``nll`` [nat a component], ``iterations``, ``gradient`` (largest component at the end), ``smoothing``.

    Raises
    ------
    CalibrationError
        If there is too little data, or the optimiser ends without a finite table.
    """
    knots = place_knots(sketch) if knots is None else knots
    x, magnitude, share = _cells(sketch)
    if start is None:
        hats = hat_weights(knots, x)
        begun = np.stack([_start(family, share, row, magnitude) for row in hats], axis=1)
        # most of the way on a grid of a sixteenth of the cells
        coarse = _coarser(x, magnitude, share)
        free, _, _ = _minimise(family, knots, *coarse, smoothing, family.to_free(begun))
    else:
        free = family.to_free(start)
    free, iterations, gradient = _minimise(family, knots, x, magnitude, share, smoothing, free)
    values = family.to_theta(free)
    if not np.isfinite(values).all():
        raise CalibrationError(f"the fit of {family.name} did not end at a finite table")
    schedule = Schedule(sketch.index, knots, values)
    theta = schedule.theta(x)[:, :, None]
    nll = float(-np.sum(share * family.logpdf(magnitude, theta)))
    convergence = {"nll": nll, "iterations": float(iterations), "gradient": gradient, "smoothing": smoothing}
    return schedule, convergence


def fit_constant(sketch: ErrorSketch, family: ErrorFamily) -> tuple[Schedule, dict[str, float]]:
    """Fit one set of parameters to all components, whatever their x; otherwise as `fit`."""
    _, magnitude, share = _cells(sketch)
    share = share.sum(axis=0, keepdims=True)
    start = family.to_free(family.start(magnitude, share[0])[:, None])
    free, iterations, gradient = _minimise(family, np.zeros(1), np.zeros(1), magnitude, share, 0.0, start)
    theta = family.to_theta(free)
    nll = float(-np.sum(share * family.logpdf(magnitude, theta[:, :, None])))
    convergence = {"nll": nll, "iterations": float(iterations), "gradient": gradient, "smoothing": 0.0}
    return Schedule.constant(theta[:, 0]), convergence


def choose_smoothing(blocks: Sequence[ErrorSketch], family: ErrorFamily, knots: Array | None = None) -> float:
    """Smoothness prior [nat] of best held-out score: fitted to one half of the blocks, scored on the other.

    Parameters
    ----------
    blocks : sequence of ErrorSketch
        Sketches of runs of frames; every second one is held out in turn. A single block gives the default.
    family : ErrorFamily
        Density.
    knots : array (M,), optional
        Knots of x; by default `place_knots` of all blocks.

    Raises
    ------
    CalibrationError
        If there is too little data.
    """
    filled = [block for block in blocks if block.total]
    if len(filled) < 2:
        return SMOOTHING_NAT
    halves = [merge_all(filled[i::2]) for i in (0, 1)]
    knots = place_knots(merge_all(halves)) if knots is None else knots
    scores = []
    for smoothing in SMOOTHINGS_NAT:
        score = 0.0
        for mine, other in (halves, halves[::-1]):
            schedule, _ = fit(mine, family, knots, smoothing)
            x, magnitude, share = _cells(other)
            score -= np.sum(share * family.logpdf(magnitude, schedule.theta(x)[:, :, None]))
        scores.append(score)
    return SMOOTHINGS_NAT[int(np.argmin(scores))]


def bootstrap(
    blocks: Sequence[ErrorSketch],
    family: ErrorFamily,
    schedule: Schedule,
    rng: np.random.Generator,
    replicates: int = 40,
    smoothing: float = SMOOTHING_NAT,
) -> Array:
    """Tables (B, P, M) fitted to blocks drawn with replacement, each begun from the table itself.

    Raises
    ------
    CalibrationError
        If the optimiser ends without a finite table.
    """
    filled = [block for block in blocks if block.total]
    tables = []
    for _ in range(replicates):
        drawn = merge_all([filled[i] for i in rng.integers(len(filled), size=len(filled))])
        tables.append(fit(drawn, family, schedule.knots, smoothing, schedule.values)[0].values)
    return np.stack(tables)


def _cells(sketch: ErrorSketch) -> tuple[Array, Array, Array]:
    """Centres of the filled bins of x (X,) and of abs(z) (Z,), and each cell's share (X, Z)."""
    counts = sketch.magnitude_counts
    rows, columns = counts.any(axis=1), counts.any(axis=0)
    share = counts[rows][:, columns] / sketch.total
    return bin_centres(sketch.index)[rows], magnitude_centres()[columns], share


def _coarser(x: Array, magnitude: Array, share: Array) -> tuple[Array, Array, Array]:
    rows, columns = np.arange(0, len(x), COARSER), np.arange(0, len(magnitude), COARSER)
    share = np.add.reduceat(np.add.reduceat(share, rows, axis=0), columns, axis=1)
    sizes = [np.diff(np.append(a, n)) for a, n in ((rows, len(x)), (columns, len(magnitude)))]
    return (
        np.add.reduceat(x, rows) / sizes[0],
        np.exp(np.add.reduceat(np.log(magnitude), columns) / sizes[1]),
        share,
    )


def _minimise(
    family: ErrorFamily,
    knots: Array,
    x: Array,
    magnitude: Array,
    share: Array,
    smoothing: float,
    start: Array,
) -> tuple[Array, int, float]:
    """Free parameters (P, M) of least cost, iterations, and the largest component of the gradient."""
    hats = hat_weights(knots, x)

    def objective(flat: Array) -> tuple[float, Array]:
        free = flat.reshape(start.shape)
        theta = family.to_theta(free) @ hats
        cost, by_free = bend(free, smoothing)
        slope = np.empty_like(theta)
        # the cells of a few rows at a time stay in the cache
        for first in range(0, len(x), ROWS):
            rows = slice(first, first + ROWS)
            log_prob, by_theta = family.logpdf_and_gradient(magnitude, theta[:, rows, None])
            cost -= float(np.sum(share[rows] * log_prob))
            slope[:, rows] = -np.einsum("xz,pxz->px", share[rows], by_theta)
        return cost, (slope @ hats.T * family.link_derivative(free) + by_free).ravel()

    result = minimize(
        objective, start.ravel(), jac=True, method="L-BFGS-B", bounds=[(-30, 30)] * start.size,
        options={"maxiter": 2000, "maxfun": 4000, "ftol": 1e-12, "gtol": 1e-7, "maxcor": 20},
    )  # fmt: skip
    return result.x.reshape(start.shape), int(result.nit), float(np.abs(result.jac).max())


def bend(free: Array, smoothing: float) -> tuple[float, Array]:
    """Smoothness prior of free parameters (P, M), weighted squared second differences, and its gradient."""
    second = np.diff(free, n=2, axis=1)
    by_free = np.zeros_like(free)
    by_free[:, :-2] += second
    by_free[:, 1:-1] -= 2 * second
    by_free[:, 2:] += second
    return smoothing * float(np.sum(second**2)), 2 * smoothing * by_free


def _start(family: ErrorFamily, share: Array, hat: Array, magnitude: Array) -> Array:
    near = share.T @ hat
    # a knot without data starts from the whole population
    return family.start(magnitude, near if near.sum() > 1e-9 else share.sum(axis=0))
