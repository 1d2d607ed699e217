"""Learning an index: weights of log-covariates and their table together, by maximum likelihood.

The index x = w^T phi is the coordinate of a one-dimensional table theta(x; u), as ln t is the paper's; w and
u minimise the same negative log-likelihood, the paper's Eq. (12), over the reservoirs of sketches.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations_with_replacement

import numpy as np
from scipy.optimize import minimize

from flowlik.calibration._fit import OUTER_QUANTILE, SMOOTHING_NAT, bend
from flowlik.calibration.sketch import ErrorSketch
from flowlik.errors import CalibrationError
from flowlik.likelihood.covariates import covariate
from flowlik.likelihood.families import ErrorFamily
from flowlik.likelihood.families.base import MAGNITUDE_FLOOR_PX
from flowlik.likelihood.schedule import Index, Input, Term
from flowlik.support.arrays import Array

KNOTS = 20
RIDGE_NAT = 1e-4
ROWS_A_POPULATION = 6_000
ITERATIONS = 300
FIRST_ROWS = 8
# relative, of a few 1e-6 nat: far below what the bootstrap says of the table
TOLERANCE = 1e-6
RANGE_LN_PX = (float(np.log(1e-4)), float(np.log(1e3)))


@dataclass(frozen=True)
class Rows:
    """Components from which an index is learned: covariates (N,) by name, and errors z (N,) [px]."""

    covariates: dict[str, Array]
    z: Array

    @classmethod
    def of(cls, populations: Sequence[ErrorSketch], most: int = ROWS_A_POPULATION) -> Rows:
        """Rows of the reservoirs of several populations (flights, data sets), at most so many of each.

        Equal shares keep one long flight from deciding for all others.

        Raises
        ------
        CalibrationError
            If the sketches keep different covariates.
        """
        columns = populations[0].columns
        if any(p.columns != columns for p in populations):
            raise CalibrationError("the sketches keep different covariates")
        # the keys are random, so that the first rows are a fair choice
        rows = np.concatenate([p.rows[:most] for p in populations])
        return cls({name: rows[:, j] for j, name in enumerate(columns)}, rows[:, -1])


def learn_index(
    rows: Rows,
    family: ErrorFamily,
    names: Sequence[str],
    products: bool = False,
    smoothing: float = SMOOTHING_NAT,
) -> Index:
    """Index of some covariates with the best likelihood, its x in ln px: about the logarithm of the error.

    Parameters
    ----------
    rows : Rows
        Components.
    family : ErrorFamily
        Density of the table that is fitted along.
    names : sequence of str
        Covariates, in `rows`.
    products : bool
        Whether products of two covariates' logarithms, squares among them, enter besides the logarithms.
    smoothing : float
        Smoothness prior of the table [nat].

    Raises
    ------
    CalibrationError
        If there are fewer than 1000 components.
    """
    if len(rows.z) < 1000:
        raise CalibrationError(
            f"{len(rows.z)} error components are too few to learn an index (1000 at least)"
        )
    inputs = tuple(_input(name, rows.covariates[name]) for name in names)
    terms: list[tuple[str, ...]] = [(name,) for name in names]
    if products:
        terms += list(combinations_with_replacement(names, 2))
    logs = {i.covariate: np.log(np.clip(rows.covariates[i.covariate], i.low, i.high)) for i in inputs}
    # products of centred logarithms: nearly uncorrelated with the logarithms themselves
    centre = {name: float(column.mean()) for name, column in logs.items()}
    phi = np.stack([np.prod([logs[n] - centre[n] for n in term], axis=0) for term in terms], axis=1)
    mean, scale = phi.mean(axis=0), phi.std(axis=0)
    if not (scale > 0).all():
        raise CalibrationError("a covariate is constant over the components; leave it out of the index")
    weights = _fit_weights((phi - mean) / scale, rows.z, family, smoothing)

    # x in ln px: the best line through ln |z|
    x = (phi - mean) / scale @ weights
    ln_error = np.log(np.maximum(np.abs(rows.z), MAGNITUDE_FLOOR_PX))
    slope, offset = np.polyfit(x, ln_error, 1)
    weights = slope * weights / scale
    return _expanded(inputs, terms, weights, offset - float(weights @ mean), centre)


def _input(name: str, values: Array) -> Input:
    finite = values[np.isfinite(values)]
    low = max(covariate(name).floor, float(np.quantile(finite, OUTER_QUANTILE)))
    return Input(name, low, max(float(np.quantile(finite, 1 - OUTER_QUANTILE)), 1.01 * low))


def _expanded(
    inputs: tuple[Input, ...],
    terms: list[tuple[str, ...]],
    weights: Array,
    offset: float,
    centre: dict[str, float],
) -> Index:
    """Index over plain logarithms, of weights over centred ones."""
    linear = dict.fromkeys((i.covariate for i in inputs), 0.0)
    pairs = {}
    for term, weight in zip(terms, weights):
        if len(term) == 1:
            linear[term[0]] += weight
            offset -= weight * centre[term[0]]
        else:
            a, b = term
            pairs[term] = weight
            linear[a] -= weight * centre[b]
            linear[b] -= weight * centre[a]
            offset += weight * centre[a] * centre[b]
    all_terms = [*(((name,), weight) for name, weight in linear.items()), *pairs.items()]
    return Index(inputs, tuple(Term(names, float(w)) for names, w in all_terms), float(offset), *RANGE_LN_PX)


def _fit_weights(phi: Array, z: Array, family: ErrorFamily, smoothing: float) -> Array:
    """Weights (J,) of standardised features (N, J), fitted together with a table over x = phi w."""
    magnitude = np.abs(z)
    ln_error = np.log(np.maximum(magnitude, MAGNITUDE_FLOOR_PX))
    gram = phi.T @ phi + 1e-3 * len(phi) * np.eye(phi.shape[1])
    first = np.linalg.solve(gram, phi.T @ (ln_error - ln_error.mean()))
    x = phi @ first
    low, high = np.quantile(x, [OUTER_QUANTILE, 1 - OUTER_QUANTILE])
    knots = np.linspace(float(low), float(high), KNOTS)
    free = family.to_free(_first_table(family, magnitude, x, knots))
    shape, step = free.shape, knots[1] - knots[0]

    def objective(flat: Array, phi: Array, magnitude: Array) -> tuple[float, Array]:
        free, weights = flat[:free_size].reshape(shape), flat[free_size:]
        values = family.to_theta(free)
        position = (phi @ weights - knots[0]) / step
        i = np.clip(position.astype(np.intp), 0, KNOTS - 2)
        f = np.clip(position - i, 0.0, 1.0)
        rise = values[:, i + 1] - values[:, i]
        log_prob, by_theta = family.logpdf_and_gradient(magnitude, values[:, i] + f * rise)
        by_values = np.stack(
            [np.bincount(i, g * (1 - f), KNOTS) + np.bincount(i + 1, g * f, KNOTS) for g in by_theta]
        )
        inside = (position > 0) & (position < KNOTS - 1)
        by_x = np.where(inside, (by_theta * rise).sum(axis=0) / step, 0.0)
        cost, by_free = bend(free, smoothing)
        away = weights - first
        cost += RIDGE_NAT * float(away @ away) - float(log_prob.mean())
        by_free = by_free - by_values / len(phi) * family.link_derivative(free)
        by_weights = 2 * RIDGE_NAT * away - phi.T @ by_x / len(phi)
        return cost, np.concatenate([by_free.ravel(), by_weights])

    free_size = free.size
    solution = np.concatenate([free.ravel(), first])
    # most of the way on a share of the rows; all of them settle the rest in a few steps
    for every in (FIRST_ROWS, 1):
        result = minimize(
            objective, solution, (phi[::every], magnitude[::every]), jac=True, method="L-BFGS-B",
            bounds=[(-30, 30)] * (free_size + len(first)),
            options={"maxiter": ITERATIONS, "ftol": TOLERANCE, "gtol": 1e-6, "maxcor": 20},
        )  # fmt: skip
        solution = result.x
    return np.asarray(solution[free_size:])


def _first_table(family: ErrorFamily, magnitude: Array, x: Array, knots: Array) -> Array:
    """Parameters (P, M) of the components near each knot, or of all where there are few."""
    reach = knots[1] - knots[0]
    columns = []
    for knot in knots:
        near = magnitude[np.abs(x - knot) < reach]
        near = np.sort(near if len(near) > 100 else magnitude)
        columns.append(family.start(np.maximum(near, MAGNITUDE_FLOOR_PX / 2), np.ones(len(near))))
    return np.stack(columns, axis=1)
