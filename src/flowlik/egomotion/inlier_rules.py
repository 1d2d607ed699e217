"""Which components are inliers of a motion: beside the likelihood, all that tells LCMSAC from RANSAC."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Protocol

import numpy as np
from numpy.typing import NDArray

from flowlik.likelihood.likelihood import FlowLikelihood
from flowlik.support.arrays import Array

Mask = NDArray[np.bool_]


class InlierRule(Protocol):
    """What an estimator asks of a rule. Errors z and bounds are (C,) [px], masks (C,)."""

    unit: ClassVar[str]
    """What is counted: ``"component"`` or ``"vector"``."""

    def bound(self, likelihood: FlowLikelihood, x: Array) -> Array:
        """Bounds [px] at coordinates x."""
        ...

    def widest(self, widest_px: float) -> float:
        """Widest bound [px] of a component that counts, where a residual counts none above `widest_px`."""
        ...

    def inliers(self, z: Array, bounds: Array, used: Mask, vectors: int) -> Mask:
        """Components of `used` that are inliers, or belong to inlier vectors, of so many `vectors`."""
        ...

    def count(self, inliers: Mask, vectors: int) -> int:
        """Number of inliers, in the rule's unit."""
        ...

    def information(self, likelihood: FlowLikelihood, x: Array, used: Mask, inliers: Mask) -> Array:
        """Information (C,) [1/px^2] of each component's score as the rule cuts it; 0 where it is left out."""
        ...


@dataclass(frozen=True)
class ByComponent:
    """A component is an inlier within its likelihood's central region (paper, Sec. II-G).

    Attributes
    ----------
    confidence : float
        Of the region; the paper's is 90 %.
    """

    confidence: float = 0.90
    unit: ClassVar[str] = "component"

    def bound(self, likelihood: FlowLikelihood, x: Array) -> Array:
        """Half-widths [px] of the likelihood's region."""
        return likelihood.bound(x, self.confidence)

    def widest(self, widest_px: float) -> float:
        """Return the residual's limit."""
        return widest_px

    def inliers(self, z: Array, bounds: Array, used: Mask, vectors: int) -> Mask:
        """Components within their bounds."""
        return used & (np.abs(z) <= bounds)

    def count(self, inliers: Mask, vectors: int) -> int:
        """Inlier components."""
        return int(inliers.sum())

    def information(self, likelihood: FlowLikelihood, x: Array, used: Mask, inliers: Mask) -> Array:
        """Information of scores cut off at their bounds: inliers change with the motion, so all count."""
        return np.where(used, likelihood.fisher(x, self.confidence), 0.0)


@dataclass(frozen=True)
class ByVector:
    """A vector is an inlier within one radius, whatever its texture: RANSAC's rule.

    Attributes
    ----------
    radius_px : float
        Radius [px].
    """

    radius_px: float = 0.5
    unit: ClassVar[str] = "vector"

    def bound(self, likelihood: FlowLikelihood, x: Array) -> Array:
        """Return the radius everywhere."""
        return np.full(np.shape(x), self.radius_px)

    def widest(self, widest_px: float) -> float:
        """Return infinity: one radius tells no component from another."""
        return np.inf

    def inliers(self, z: Array, bounds: Array, used: Mask, vectors: int) -> Mask:
        """Components of the vectors whose error is no longer than the bound."""
        length = np.linalg.norm(np.where(used, z, 0.0).reshape(vectors, -1), axis=1)
        return used & (np.repeat(length, len(z) // vectors) <= bounds)

    def count(self, inliers: Mask, vectors: int) -> int:
        """Inlier vectors."""
        return int(inliers.reshape(vectors, -1).any(axis=1).sum())

    def information(self, likelihood: FlowLikelihood, x: Array, used: Mask, inliers: Mask) -> Array:
        """Information of the inliers, as least squares has it."""
        return np.where(inliers, likelihood.fisher(x), 0.0)
