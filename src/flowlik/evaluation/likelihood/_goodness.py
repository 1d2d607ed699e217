"""Does a likelihood tell the truth? Log score, K-S over texture and coverage, all from a sketch."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from flowlik.calibration.sketch import ErrorSketch, bin_centres, level_centres, magnitude_centres
from flowlik.likelihood.likelihood import FlowLikelihood
from flowlik.likelihood.tables import magnitude_nodes
from flowlik.support.arrays import Array

CONFIDENCES = (0.5, 0.68, 0.9, 0.95, 0.99)


@dataclass(frozen=True)
class Counting:
    """What a texture level needs to be counted: so many components, from so many image pairs."""

    least_components: int = 100_000
    least_frames: int = 30

    def counted(self, components: NDArray[np.int64], frames: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Whether levels of so many components (L,), from so many image pairs (L,), are counted."""
        return (components >= self.least_components) & (frames >= self.least_frames)

    def __str__(self) -> str:
        """How a protocol says it."""
        return f"≥{self.least_components} components from ≥{self.least_frames} frames"


@dataclass(frozen=True)
class KolmogorovSmirnov:
    """K-S statistic of abs(z) at texture levels, 8 a decade.

    Attributes
    ----------
    texture : array (L,)
        Level centres [intensity^2/px^2].
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
    theta = likelihood.schedule.theta(bin_centres(likelihood.schedule.index))[:, :, None]
    log_prob = likelihood.family.logpdf(magnitude_centres(), theta)
    return log_prob, likelihood.family.magnitude_cdf(magnitude_nodes()[1:], theta)


def magnitude_cdf(likelihood: FlowLikelihood) -> Array:
    """Distribution function (X, Z) of abs(z) at the bins' centres of x and upper edges of abs(z)."""
    return _model(likelihood)[1]


def negative_log_likelihood(sketch: ErrorSketch, likelihood: FlowLikelihood) -> float:
    """Mean negative log-likelihood [nat a component] of the sketched errors."""
    return float(nll_by_bin(sketch, likelihood).sum() / sketch.total)


def nll_by_bin(sketch: ErrorSketch, likelihood: FlowLikelihood) -> Array:
    """Summed negative log-likelihood (X,) [nat] of the components in each bin of x."""
    return -np.einsum("xz,xz->x", sketch.magnitude_counts, _model(likelihood)[0])


def kolmogorov_smirnov(
    sketch: ErrorSketch, likelihood: FlowLikelihood, counting: Counting = Counting()
) -> KolmogorovSmirnov:
    """K-S statistic at texture levels: ``max |F_n(|z|) - mean_i F(|z|; theta(x_i))|``.

    Parameters
    ----------
    sketch : ErrorSketch
        Errors.
    likelihood : FlowLikelihood
        Model.
    counting : Counting
        What a level needs to be counted.
    """
    counts = sketch.by_level.sum(axis=1)
    with np.errstate(invalid="ignore"):
        shares = sketch.by_level / counts[:, None]
        predicted = shares @ _model(likelihood)[1]
        negative, positive = np.moveaxis(sketch.errors / counts[:, None, None], 1, 0)
        below = np.cumsum(negative + positive, axis=1)
        # the signed distribution at -b and at +b
        share_negative = negative.sum(axis=1, keepdims=True)
        at_minus = share_negative - np.cumsum(negative, axis=1) - 0.5 * (1 - predicted)
        at_plus = share_negative + np.cumsum(positive, axis=1) - 0.5 * (1 + predicted)
    # the outermost bin also holds what lies beyond it
    below, predicted, at_minus, at_plus = (a[:, :-1] for a in (below, predicted, at_minus, at_plus))
    return KolmogorovSmirnov(
        level_centres(),
        np.abs(below - predicted).max(axis=1),
        np.maximum(np.abs(at_minus).max(axis=1), np.abs(at_plus).max(axis=1)),
        counts,
        counting.counted(counts, sketch.frames),
    )


def level_bound(sketch: ErrorSketch, likelihood: FlowLikelihood, confidence: float) -> Array:
    """Half-width (L,) [px] that the model says holds that share of all errors at each texture level.

    That is of the mixture of the level's distributions; NaN where there are no components.
    """
    with np.errstate(invalid="ignore"):
        shares = sketch.by_level / sketch.by_level.sum(axis=1, keepdims=True)
    ln_edges = np.log(magnitude_nodes()[1:])
    return np.exp([np.interp(confidence, row, ln_edges) for row in shares @ magnitude_cdf(likelihood)])


def held_out_floor(
    first: ErrorSketch, second: ErrorSketch, counting: Counting = Counting()
) -> KolmogorovSmirnov:
    """K-S distance between two populations' empirical distributions at the same texture levels.

    A model calibrated on the one can do no better on the other than this by much: it is the floor of what
    its K-S can mean. A level counts where it counts in both; ``counts`` are the smaller ones.
    """
    counts = np.stack([s.errors.sum(axis=(1, 2)) for s in (first, second)])
    with np.errstate(invalid="ignore"):
        shares = [s.errors / n[:, None, None] for s, n in zip((first, second), counts)]
        magnitudes, signed = (
            np.cumsum(shape(shares[0]) - shape(shares[1]), axis=1)
            for shape in (lambda e: e.sum(axis=1), lambda e: np.concatenate([e[:, 0, ::-1], e[:, 1]], axis=1))
        )
    frames = np.minimum(first.frames, second.frames)
    least = counts.min(axis=0)
    return KolmogorovSmirnov(
        level_centres(),
        np.abs(magnitudes).max(axis=1),
        np.abs(signed).max(axis=1),
        least,
        counting.counted(least, frames),
    )


def coverage(sketch: ErrorSketch, likelihood: FlowLikelihood, confidence: float) -> float:
    """Share of components within the model's own central region of that confidence."""
    return float(inside_by_bin(sketch, likelihood, confidence).sum() / sketch.total)


def inside_by_bin(sketch: ErrorSketch, likelihood: FlowLikelihood, confidence: float) -> Array:
    """Components (X,) of each bin of x within the model's central region of that confidence."""
    bounds = likelihood.bound(bin_centres(sketch.index), confidence)
    edges = magnitude_nodes()
    cumulated = np.cumsum(sketch.magnitude_counts, axis=1)
    return np.array([np.interp(b, edges, np.concatenate([[0], row])) for b, row in zip(bounds, cumulated)])


def outside_range(sketch: ErrorSketch, likelihood: FlowLikelihood) -> float:
    """Share of components outside the model's calibrated range of x."""
    centres, knots = bin_centres(sketch.index), likelihood.schedule.knots
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
    drawn = ErrorSketch.empty(blocks[0].index, blocks[0].columns)
    for i, times in zip(*np.unique(draw, return_counts=True)):
        for name in ("counts", "by_level", "errors", "frames"):
            np.add(getattr(drawn, name), times * getattr(blocks[i], name), out=getattr(drawn, name))
    return replace(drawn, pairs=sum(blocks[i].pairs for i in draw))
