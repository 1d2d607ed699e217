"""What it costs to take the eigenbasis as certain where t1 and t2 are alike and its orientation is not.

The paper's likelihood is a product over the eigen-components. At t2/t1 near 1 the orientation of these is
arbitrary, and the two should share one distribution. `eigenbasis_cost` measures log score and K-S of the
components against t2/t1, of the model as it is and with the remedy of *pooling*: each component's x is
replaced by ``(1 - w/2) x + (w/2) x_other`` with ``w = (t2/t1)^power``.
"""

from __future__ import annotations

from collections.abc import Sequence as Seq
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flowlik.calibration import fit
from flowlik.calibration.sketch import ErrorSketch, x_edges
from flowlik.errors import CalibrationError
from flowlik.evaluation.likelihood._evidence import Recorder
from flowlik.evaluation.likelihood._goodness import magnitude_cdf
from flowlik.evaluation.likelihood._reservoir import Reservoir
from flowlik.likelihood.likelihood import FlowLikelihood
from flowlik.likelihood.schedule import Index
from flowlik.likelihood.tables import magnitude_nodes
from flowlik.results.records import Record, protocol
from flowlik.support.arrays import Array

ACROSS = {name: f"{name}-across" for name in ("texture", "discrepancy", "patch-discrepancy")}
RATIO_EDGES = np.array([0.0, 0.05, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0])
COARSE_EDGES = np.array([0.0, 0.1, 0.3, 0.5, 0.7, 1.0])
ALIKE = 0.7
SMOOTHING_NAT = 1e-3
POWER = 2.0


def kept_for_eigenbasis(index: Index) -> tuple[str, ...]:
    """Covariates that reservoirs must keep besides those of an index, to tell the other component's x."""
    names = {"texture", *index.covariates}
    names |= {other for pair in ACROSS.items() if set(pair) & names for other in pair}
    if "flow-along" in names:
        names.add("flow")
    return tuple(sorted(names - set(index.covariates) - {"texture"}))


def tells_eigenbasis(sketch: ErrorSketch, likelihood: FlowLikelihood) -> bool:
    """Whether a sketch's reservoir keeps what `eigenbasis_cost` needs."""
    needed = {"texture-across", *kept_for_eigenbasis(likelihood.schedule.index)}
    return needed <= set(sketch.columns) and len(sketch.rows) > 0


@dataclass(frozen=True)
class EigenbasisCost:
    """Fit of the components over t2/t1.

    Attributes
    ----------
    edges : array (R + 1,)
        Edges of the bins of t2/t1.
    counts : array (R,)
        Components in each.
    nll, nll_pooled : array (R,)
        Negative log-likelihood [nat a component] of the model as it is, and with pooling; NaN where empty.
    ks, ks_pooled : array (R,)
        K-S distance of abs(z), likewise.
    """

    edges: Array
    counts: Array
    nll: Array
    nll_pooled: Array
    ks: Array
    ks_pooled: Array


def eigenbasis_cost(
    blocks: Seq[ErrorSketch],
    likelihood: FlowLikelihood,
    power: float = POWER,
    edges: Array = RATIO_EDGES,
) -> EigenbasisCost:
    """Log score and K-S of a model over t2/t1, from reservoirs that keep both components' covariates.

    Parameters
    ----------
    blocks : sequence of ErrorSketch
        Sketches whose reservoirs keep `kept_for_eigenbasis`.
    likelihood : FlowLikelihood
        Model.
    power : float
        How fast pooling sets in as t2/t1 goes to 1.
    edges : array (R + 1,)
        Edges of the bins of t2/t1.

    Raises
    ------
    CalibrationError
        If the reservoirs lack a covariate of the other component.
    """
    rows, index = Reservoir.of(blocks), likelihood.schedule.index
    ratio = _texture_ratio(rows)
    x = rows.x(index)
    pooled = x + 0.5 * ratio**power * (index.combine(of_other_component(rows, index)) - x)
    bins = np.clip(np.digitize(ratio, edges) - 1, 0, len(edges) - 2)
    figures = []
    for chosen in (bins == i for i in range(len(edges) - 1)):
        part = rows.select(chosen)
        figures.append([f(part, c[chosen], likelihood) for f in (_nll, _ks) for c in (x, pooled)])
    counts = np.bincount(bins, rows.weights, len(edges) - 1).astype(np.float64)
    return EigenbasisCost(edges, counts, *np.array(figures).T)


def own_table_gain(
    blocks: Seq[ErrorSketch],
    likelihood: FlowLikelihood,
    rng: np.random.Generator,
    edges: Array = COARSE_EDGES,
) -> Array:
    """Log score (R,) [nat a component] that a table of its own for each bin of t2/t1 gains over one for all.

    Both tables, over the model's index and of its family, are fitted to one half of the raw components and
    scored on the other. The gain bounds what any remedy at t2/t1 near 1 can do that leaves x one-dimensional;
    NaN where there are too few components to fit.

    Raises
    ------
    CalibrationError
        If the sketch does not keep t2/t1, or a fit fails.
    """
    rows, index, family = Reservoir.of(blocks), likelihood.schedule.index, likelihood.family
    ratio, first = _texture_ratio(rows), rng.random(len(rows.z)) < 0.5

    def fitted(chosen: NDArray[np.bool_]) -> FlowLikelihood:
        part = rows.select(chosen)
        sketch = ErrorSketch.of(index, part.covariates, part.z, np.ones(len(part.z)), rng)
        return FlowLikelihood(family, fit(sketch, family, smoothing=SMOOTHING_NAT)[0])

    common, gains = fitted(first), []
    for low, high in pairwise(edges):
        inside = (ratio >= low) & ((ratio < high) | (high == edges[-1]))
        test = rows.select(inside & ~first)
        x = test.x(index)
        try:
            gains.append(_nll(test, x, common) - _nll(test, x, fitted(inside & first)))
        except CalibrationError:
            gains.append(float("nan"))
    return np.array(gains)


def eigenbasis_records(cost: EigenbasisCost, record: Recorder, note: str) -> list[Record]:
    """K-S of components whose t2/t1 exceeds 0.7 and of the others, and what pooling gains for the former."""
    alike = cost.edges[:-1] >= ALIKE

    def mean(values: Array, bins: NDArray[np.bool_]) -> float | None:
        used = bins & (cost.counts > 0)
        return float(np.average(values[used], weights=cost.counts[used])) if used.any() else None

    note += "; " + protocol(alike=f"t2/t1>{ALIKE}", mean="over bins of t2/t1", power=POWER)
    return [
        record("ks_textures_alike", mean(cost.ks, alike), "", note),
        record("ks_textures_apart", mean(cost.ks, ~alike), "", note),
        record("nll_gain_of_pooling", mean(cost.nll - cost.nll_pooled, alike), "nat", note),
    ]


def _texture_ratio(rows: Reservoir) -> Array:
    """t2/t1 (N,) of the vector that each component belongs to."""
    if "texture-across" not in rows.covariates:
        raise CalibrationError("the sketch keeps no texture-across: t2/t1 is not known")
    pair = np.stack([rows.covariates["texture"], rows.covariates["texture-across"]])
    return pair.min(axis=0) / np.maximum(pair.max(axis=0), 1e-12)


def of_other_component(rows: Reservoir, index: Index) -> dict[str, Array]:
    """Covariates (N,) of the other component of each component's vector, as far as an index needs them.

    Raises
    ------
    CalibrationError
        If the sketch keeps too little of it.
    """
    missing = set(kept_for_eigenbasis(index)) - set(rows.covariates)
    if missing:
        raise CalibrationError(f"the sketch keeps no {', '.join(sorted(missing))} of the other component")
    own = rows.covariates
    swapped = ACROSS | {across: name for name, across in ACROSS.items()}
    other = {name: own[swapped.get(name, name)] for name in index.covariates}
    if "flow-along" in other:
        other["flow-along"] = np.sqrt(np.maximum(own["flow"] ** 2 - own["flow-along"] ** 2, 0.0))
    return other


def eigenbasis_arrays(cost: EigenbasisCost) -> dict[str, Any]:
    """Arrays of the figure of the fit over t2/t1."""
    return {
        "ratio_edges": cost.edges,
        "counts": cost.counts,
        "nll": np.stack([cost.nll, cost.nll_pooled]),
        "ks": np.stack([cost.ks, cost.ks_pooled]),
        "names": np.array(["as it is", "pooled"]),
    }


def _nll(rows: Reservoir, x: Array, likelihood: FlowLikelihood) -> float:
    total = rows.weights.sum()
    return float(-(rows.weights @ likelihood.log_prob(rows.z, x)) / total) if total else float("nan")


def _ks(rows: Reservoir, x: Array, likelihood: FlowLikelihood) -> float:
    total = rows.weights.sum()
    if not total:
        return float("nan")
    edges = x_edges(likelihood.schedule.index)
    inside = np.clip(x, edges[0], edges[-1])
    share = np.histogram(inside, edges, weights=rows.weights)[0] / total
    predicted = share @ magnitude_cdf(likelihood)
    found = np.histogram(np.abs(rows.z), magnitude_nodes(), weights=rows.weights)[0]
    small = rows.weights[np.abs(rows.z) < magnitude_nodes()[0]].sum()
    return float(np.abs((small + np.cumsum(found)) / total - predicted)[:-1].max())
