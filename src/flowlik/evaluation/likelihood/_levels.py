"""Coverage and log score at every texture level, whatever the schedule's coordinate is."""

from __future__ import annotations

from collections.abc import Mapping
from collections.abc import Sequence as Seq
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flowlik.calibration.sketch import LEVELS, ErrorSketch, level_centres, level_edges, merge_all
from flowlik.evaluation.likelihood._goodness import Counting, inside_by_bin, nll_by_bin
from flowlik.evaluation.likelihood._reservoir import Reservoir
from flowlik.likelihood.likelihood import FlowLikelihood
from flowlik.likelihood.schedule import Index
from flowlik.support.arrays import Array

LEAST_ROWS = 500


@dataclass(frozen=True)
class Levels:
    """Coverage and negative log-likelihood at texture levels, 8 a decade.

    Attributes
    ----------
    texture : array (L,)
        Level centres [intensity^2/px^2].
    confidence : float
        Of the intervals.
    coverage, nll : array (L,)
        Share of components within their own intervals, and nat a component; NaN where there are none.
    counts : int64 array (L,)
        Components.
    counted : bool array (L,)
        Levels with enough components from enough image pairs.
    rows : int or None
        Raw components it was measured on, drawn from all; None where the counts tell it exactly.
    """

    texture: Array
    confidence: float
    coverage: Array
    nll: Array
    counts: NDArray[np.int64]
    counted: NDArray[np.bool_]
    rows: int | None

    @property
    def worst(self) -> int | None:
        """Counted level whose coverage is farthest from the confidence; None if none is counted."""
        if not self.counted.any():
            return None
        return int(np.argmax(np.where(self.counted, np.abs(self.coverage - self.confidence), -1)))


def levels(
    blocks: Seq[ErrorSketch],
    likelihood: FlowLikelihood,
    counting: Counting = Counting(),
    confidence: float = 0.9,
) -> Levels:
    """Coverage and log score by texture level.

    Where x is the texture, from counts. Else a sketch does not keep what x a level's errors had, and the
    blocks' reservoirs tell it: a level then needs 500 raw components to be counted.
    """
    sketch = merge_all(blocks)
    counts = sketch.by_level.sum(axis=1)
    counted = counting.counted(counts, sketch.frames)
    if sketch.index == Index():
        by_bin = np.stack([inside_by_bin(sketch, likelihood, confidence), nll_by_bin(sketch, likelihood)])
        sums, weights, rows = by_bin.reshape(2, LEVELS, -1).sum(axis=2), counts.astype(np.float64), None
    else:
        reservoir = Reservoir.of(blocks)
        x, magnitude = reservoir.x(sketch.index), np.abs(reservoir.z)
        inside = magnitude <= likelihood.bound(x, confidence)
        edges = np.log(level_edges())
        level = np.digitize(np.log(np.maximum(reservoir.covariates["texture"], 1e-12)), edges[1:-1])
        values = (inside, -likelihood.log_prob(magnitude, x))
        sums = np.stack([np.bincount(level, v * reservoir.weights, LEVELS) for v in values])
        weights, rows = np.bincount(level, reservoir.weights, LEVELS), len(level)
        counted &= np.bincount(level, minlength=LEVELS) >= LEAST_ROWS
    with np.errstate(invalid="ignore", divide="ignore"):
        coverage, nll = sums / weights
    return Levels(level_centres(), confidence, coverage, nll, counts, counted, rows)


def levels_arrays(found: Mapping[str, Levels]) -> dict[str, Any]:
    """Arrays of the figure of coverage and log score over texture, of each model."""
    first = next(iter(found.values()))
    shown = first.counts > 0
    return {
        "texture": first.texture[shown],
        "names": np.array(list(found)),
        "coverage": np.array([f.coverage[shown] for f in found.values()]),
        "nll": np.array([f.nll[shown] for f in found.values()]),
        "counted": np.array([f.counted[shown] for f in found.values()]),
        "confidence": np.array(first.confidence),
    }
