"""Does a likelihood tell the truth? Log score, K-S over texture and coverage, all from a sketch."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from flowlik.calibration.sketch import (
    BINS_PER_LEVEL,
    ErrorSketch,
    bin_centres,
    magnitude_centres,
    x_edges,
)
from flowlik.camera import Array
from flowlik.likelihood import FlowLikelihood
from flowlik.tables import magnitude_nodes

CONFIDENCES = (0.5, 0.68, 0.9, 0.95, 0.99)


@dataclass(frozen=True)
class KolmogorovSmirnov:
    """K-S statistic of abs(z) at texture levels, 8 a decade.

    Attributes
    ----------
    texture : array (L,)
        Level centres [intensity^2/px^2] (exp of x).
    statistic, signed : array (L,)
        D of the magnitude, and of the signed error; NaN at empty levels.
    counts : int64 array (L,)
        Components.
    counted : bool array (L,)
        Levels with enough components from enough image pairs.
    """

    texture: Array
    statistic: Array
    signed: Array
    counts: NDArray[np.int64]
    counted: NDArray[np.bool_]

    @property
    def median(self) -> float:
        """Unweighted median over the counted levels; NaN where there is none."""
        return float(np.median(self.statistic[self.counted])) if self.counted.any() else float("nan")

    @property
    def signed_median(self) -> float:
        """Median of the signed statistic over the counted levels."""
        return float(np.median(self.signed[self.counted])) if self.counted.any() else float("nan")

    @property
    def maximum(self) -> float:
        """Largest over the counted levels."""
        return float(self.statistic[self.counted].max()) if self.counted.any() else float("nan")

    @property
    def weighted_mean(self) -> float:
        """Mean over all levels, weighted by their counts."""
        filled = self.counts > 0
        return float(np.average(self.statistic[filled], weights=self.counts[filled]))

    @property
    def counted_share(self) -> float:
        """Share of all components that the counted levels hold."""
        return float(self.counts[self.counted].sum() / self.counts.sum())


@lru_cache(maxsize=16)
def _model(likelihood: FlowLikelihood) -> tuple[Array, Array]:
    """Log-density at bin centres and distribution function of abs(z) at upper bin edges, both (X, Z)."""
    theta = likelihood.schedule.theta(bin_centres())[:, :, None]
    log_prob = likelihood.family.logpdf(magnitude_centres(), theta)
    return log_prob, likelihood.family.magnitude_cdf(magnitude_nodes()[1:], theta)


def negative_log_likelihood(sketch: ErrorSketch, likelihood: FlowLikelihood) -> float:
    """Mean negative log-likelihood [nat a component] of the sketched errors."""
    log_prob, _ = _model(likelihood)
    return float(-np.sum(sketch.magnitude_counts * log_prob) / sketch.total)


def kolmogorov_smirnov(
    sketch: ErrorSketch, likelihood: FlowLikelihood, least_components: int = 100_000, least_frames: int = 30
) -> KolmogorovSmirnov:
    """K-S statistic at texture levels: ``max |F_n(|z|) - mean_i F(|z|; theta(x_i))|``.

    Parameters
    ----------
    sketch : ErrorSketch
        Errors.
    likelihood : FlowLikelihood
        Model.
    least_components, least_frames : int
        What a level needs to be counted.
    """
    per_bin = sketch.counts.sum(axis=(1, 2)).astype(np.float64)
    levels = len(per_bin) // BINS_PER_LEVEL

    def by_level(values: Array) -> Array:
        return values.reshape(levels, BINS_PER_LEVEL, *values.shape[1:]).sum(axis=1)

    counts = by_level(per_bin)
    with np.errstate(invalid="ignore"):
        predicted = by_level(_model(likelihood)[1] * per_bin[:, None]) / counts[:, None]
        negative, positive = np.moveaxis(by_level(sketch.counts.astype(np.float64)), 1, 0)
        below = np.cumsum(negative + positive, axis=1) / counts[:, None]
        # the signed distribution at -b and at +b
        share_negative = negative.sum(axis=1, keepdims=True) / counts[:, None]
        at_minus = share_negative - np.cumsum(negative, axis=1) / counts[:, None] - 0.5 * (1 - predicted)
        at_plus = share_negative + np.cumsum(positive, axis=1) / counts[:, None] - 0.5 * (1 + predicted)
    # the outermost bin also holds what lies beyond it
    below, predicted, at_minus, at_plus = (a[:, :-1] for a in (below, predicted, at_minus, at_plus))
    frames = sketch.frames.reshape(levels, BINS_PER_LEVEL).max(axis=1)
    edges = x_edges()[::BINS_PER_LEVEL]
    return KolmogorovSmirnov(
        np.exp(0.5 * (edges[1:] + edges[:-1])),
        np.abs(below - predicted).max(axis=1),
        np.maximum(np.abs(at_minus).max(axis=1), np.abs(at_plus).max(axis=1)),
        counts.astype(np.int64),
        (counts >= least_components) & (frames >= least_frames),
    )


def coverage(sketch: ErrorSketch, likelihood: FlowLikelihood, confidence: float) -> float:
    """Share of components within the model's own central region of that confidence."""
    bounds = likelihood.bound(bin_centres(), confidence)
    edges = magnitude_nodes()
    cumulated = np.cumsum(sketch.magnitude_counts, axis=1)
    inside = sum(np.interp(b, edges, np.concatenate([[0], row])) for b, row in zip(bounds, cumulated))
    return float(inside / sketch.total)


def outside_range(sketch: ErrorSketch, likelihood: FlowLikelihood) -> float:
    """Share of components outside the model's calibrated range of x."""
    centres, knots = bin_centres(), likelihood.schedule.knots
    beyond = (centres < knots[0]) | (centres > knots[-1])
    return float(sketch.counts[beyond].sum() / sketch.total)


def nll_interval(
    blocks: Sequence[ErrorSketch],
    likelihood: FlowLikelihood,
    rng: np.random.Generator,
    replicates: int = 1000,
    confidence: float = 0.95,
) -> tuple[float, float]:
    """Bootstrap interval of the negative log-likelihood [nat a component] over blocks of frames."""
    totals = np.array([block.total for block in blocks], dtype=np.float64)
    sums = totals * [negative_log_likelihood(block, likelihood) for block in blocks]
    draws = rng.integers(len(blocks), size=(replicates, len(blocks)))
    return _percentiles(sums[draws].sum(axis=1) / totals[draws].sum(axis=1), confidence)


def block_interval(
    blocks: Sequence[ErrorSketch],
    statistic: Callable[[ErrorSketch], float],
    rng: np.random.Generator,
    replicates: int = 100,
    confidence: float = 0.95,
) -> tuple[float, float]:
    """Bootstrap interval of a statistic over blocks of frames, each block a sketch."""
    draws = rng.integers(len(blocks), size=(replicates, len(blocks)))
    values = [statistic(_resampled(blocks, draw)) for draw in draws]
    return _percentiles(np.array(values), confidence)


def _percentiles(values: Array, confidence: float) -> tuple[float, float]:
    tail = 50 * (1 - confidence)
    low, high = np.nanpercentile(values, [tail, 100 - tail])
    return float(low), float(high)


def _resampled(blocks: Sequence[ErrorSketch], draw: NDArray[np.int64]) -> ErrorSketch:
    """Sketch of blocks drawn with replacement; its reservoir stays empty."""
    empty = ErrorSketch.empty(blocks[0].index)
    frames = empty.frames
    for i, times in zip(*np.unique(draw, return_counts=True)):
        np.add(empty.counts, times * blocks[i].counts, out=empty.counts)
        frames = frames + times * blocks[i].frames
    pairs = sum(blocks[i].pairs for i in draw)
    return ErrorSketch(empty.index, empty.counts, frames, pairs, empty.keys, empty.rows)
