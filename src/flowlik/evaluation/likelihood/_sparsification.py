"""Sparsification: does removing what the model calls uncertain leave small errors? From a sketch.

After Ilg et al., Uncertainty Estimates and Multi-Hypotheses Networks for Optical Flow (ECCV 2018), as PDC-Net
and others use it: the error of what stays, over the share removed, divided by the error of all. AUSE is the
area between this curve and the oracle's, which removes by the true error; here up to 99 % removed, since what
the last percent has is chance. The items are components.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.integrate import trapezoid

from flowlik.calibration.sketch import ErrorSketch, bin_centres, magnitude_centres
from flowlik.likelihood.likelihood import FlowLikelihood
from flowlik.likelihood.tables import magnitude_nodes
from flowlik.support.arrays import Array

CAP_PX = 100.0
SPREAD_CONFIDENCE = 0.9
STATISTICS = ("mean", "median", "rmse")
REMOVED = np.linspace(0, 0.99, 100)


@dataclass(frozen=True)
class Sparsification:
    """Error of what stays over the share removed, each divided by the error of all.

    Attributes
    ----------
    removed : array (G,)
        Shares removed.
    by_spread, oracle : dict of str to array (G,)
        Mean and median of abs(z), and its root mean square, after removal by the model's predicted spread
        and by abs(z) itself; in mean and rmse abs(z) is capped at 100 px.
    rank_correlation : float
        Spearman's, of predicted spread and abs(z); NaN where the model predicts one spread for all.
    """

    removed: Array
    by_spread: dict[str, Array]
    oracle: dict[str, Array]
    rank_correlation: float

    def ause(self, statistic: str = "mean") -> float:
        """Area between the model's curve and the oracle's: 0 is a perfect ranking."""
        return _area(self.by_spread[statistic] - self.oracle[statistic], self.removed)

    def ause_relative(self, statistic: str = "mean") -> float:
        """AUSE over that of removal at random: 0 is a perfect ranking, 1 none."""
        return self.ause(statistic) / _area(1 - self.oracle[statistic], self.removed)


def sparsification(sketch: ErrorSketch, likelihood: FlowLikelihood) -> Sparsification:
    """Sparsification by the predicted spread, the model's 90 % bound at each component's x.

    Components of equal spread are removed at random: their share of the bin, whatever their error.
    """
    spread = likelihood.bound(bin_centres(sketch.index), SPREAD_CONFIDENCE)
    # beyond the outer knots, and in a constant schedule, many bins have one spread
    _, group = np.unique(np.round(np.log(spread), 9), return_inverse=True)
    counts = np.zeros((group.max() + 1, sketch.counts.shape[2]))
    np.add.at(counts, group, sketch.magnitude_counts)
    counts = counts[counts.any(axis=1)]
    kept = (1 - REMOVED) * sketch.total
    total = np.concatenate([[0], np.cumsum(counts.sum(axis=1))])
    below = np.concatenate([np.zeros((1, counts.shape[1])), np.cumsum(counts, axis=0)])
    last = np.clip(np.searchsorted(total, kept) - 1, 0, len(counts) - 1)
    part = (kept - total[last]) / (total[last + 1] - total[last])
    by_spread = below[last] + part[:, None] * counts[last]
    pooled = counts.sum(axis=0)
    oracle = np.clip(kept[:, None] - (np.cumsum(pooled) - pooled), 0, pooled)
    return Sparsification(REMOVED, _curves(by_spread), _curves(oracle), _spearman(counts))


def sparsification_arrays(sketches: Mapping[str, tuple[ErrorSketch, FlowLikelihood]]) -> dict[str, Any]:
    """Arrays of the sparsification figure: mean and median of abs(z) of what stays, of each model."""
    found = [sparsification(*pair) for pair in sketches.values()]
    shown = STATISTICS[:2]
    return {
        "removed": REMOVED,
        "names": np.array(list(sketches)),
        "statistics": np.array(shown),
        "curves": np.array([[s.by_spread[k] for k in shown] for s in found]),
        "oracle": np.array([[s.oracle[k] for k in shown] for s in found]),
        "ause": np.array([[s.ause(k) for k in shown] for s in found]),
    }


def _area(curve: Array, removed: Array) -> float:
    return float(trapezoid(curve, removed))


def _curves(kept: Array) -> dict[str, Array]:
    """Statistics of what stays, counts (G, Z) by abs(z), over those of the first row."""
    magnitude = magnitude_centres()
    capped = np.minimum(magnitude, CAP_PX)
    total = kept.sum(axis=1)
    below = np.cumsum(kept, axis=1) / total[:, None]
    curves = {
        "mean": kept @ capped / total,
        "median": np.exp([np.interp(0.5, row, np.log(magnitude_nodes()[1:])) for row in below]),
        "rmse": np.sqrt(kept @ capped**2 / total),
    }
    return {name: curve / curve[0] for name, curve in curves.items()}


def _spearman(counts: Array) -> float:
    """Rank correlation of row and column in counts of both, ties sharing their middle rank."""
    share = counts / counts.sum()
    ranks = [np.cumsum(s) - 0.5 * s - 0.5 for s in (share.sum(axis=1), share.sum(axis=0))]
    variances = [r**2 @ s for r, s in zip(ranks, (share.sum(axis=1), share.sum(axis=0)))]
    if len(counts) < 2 or not min(variances) > 0:
        return float("nan")
    return float(ranks[0] @ share @ ranks[1] / np.sqrt(variances[0] * variances[1]))
