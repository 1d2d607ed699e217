"""Raw components of sketches: a random choice of each block's, weighted to stand for all of them."""

from __future__ import annotations

from collections.abc import Sequence as Seq
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flowlik.calibration.sketch import ErrorSketch
from flowlik.likelihood.schedule import Index
from flowlik.support.arrays import Array


@dataclass(frozen=True)
class Reservoir:
    """Raw components (N,).

    Attributes
    ----------
    covariates : dict of str to array (N,)
        By name.
    z : array (N,)
        Signed errors ``s z`` [px].
    weights : array (N,)
        How many components each stands for.
    """

    covariates: dict[str, Array]
    z: Array
    weights: Array

    @classmethod
    def of(cls, blocks: Seq[ErrorSketch]) -> Reservoir:
        """Rows of blocks that keep the same covariates."""
        rows = np.concatenate([block.rows for block in blocks])
        weights = np.concatenate(
            [np.full(len(block.rows), block.total / max(len(block.rows), 1)) for block in blocks]
        )
        names = blocks[0].columns
        return cls({name: rows[:, j].copy() for j, name in enumerate(names)}, rows[:, -1].copy(), weights)

    def x(self, index: Index) -> Array:
        """Coordinates (N,) of an index of the covariates."""
        return index.combine(self.covariates)

    def select(self, chosen: NDArray[np.bool_]) -> Reservoir:
        """Some of the components."""
        covariates = {name: column[chosen] for name, column in self.covariates.items()}
        return Reservoir(covariates, self.z[chosen], self.weights[chosen])
