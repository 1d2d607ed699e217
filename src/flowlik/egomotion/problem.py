"""A residual seen through a likelihood and an inlier rule: what every step of an estimate looks at."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from flowlik.egomotion.inlier_rules import InlierRule
from flowlik.egomotion.residual import Chosen, Linearised, Residual, Weighting, weighting
from flowlik.likelihood.likelihood import FlowLikelihood
from flowlik.likelihood.schedule import Index
from flowlik.support.arrays import Array

# narrow components for each vector of a minimal sample; where there are fewer, wide ones count as well
ENOUGH_INFORMATIVE = 10


class View(NamedTuple):
    """Errors at a motion, bounds (C,) [px] of inliers, which components count, and which are inliers."""

    errors: Linearised
    bounds: Array
    used: NDArray[np.bool_]
    inliers: NDArray[np.bool_]


class Explanation(NamedTuple):
    """A refined motion: the view there, and its log-density [nat]."""

    view: View
    log_prob: float


@dataclass(frozen=True, eq=False)
class Problem:
    """A residual, the likelihood of its errors, and the rule that tells its inliers.

    Attributes
    ----------
    residual, likelihood, rule : Residual, FlowLikelihood, InlierRule
        What is estimated from, and by what.
    refine_all : bool
        Whether all components that count are refined over, not the inliers alone.
    gate : float
        Eigen-components of less texture [intensity^2/px^2] are left out.
    """

    residual: Residual
    likelihood: FlowLikelihood
    rule: InlierRule
    refine_all: bool
    gate: float

    @cached_property
    def kept(self) -> NDArray[np.bool_]:
        """Eigen-components (N, 2) that the gate keeps."""
        return np.asarray(self.residual.measurements.t >= self.gate)

    @cached_property
    def components(self) -> NDArray[np.bool_]:
        """Components (C,) of the residual that the gate keeps."""
        return self.residual.sampling.components(self.kept)

    @cached_property
    def coordinates(self) -> Array:
        """Schedule coordinates x (N, 2) of the vectors' eigen-components."""
        return self.residual.sampling.coordinates(self.index)

    @cached_property
    def excluded(self) -> dict[str, int]:
        """What is left out, by reason: vectors, and components by the gate."""
        return {**self.residual.excluded, "texture gate": int(self.kept.size - self.kept.sum())}

    @property
    def vectors(self) -> int:
        """Number of flow vectors."""
        return len(self.residual.measurements)

    @property
    def index(self) -> Index:
        """Index that gives the errors' coordinates."""
        return self.likelihood.schedule.index

    @cached_property
    def weighting(self) -> Weighting:
        """How components enter."""
        return weighting(self.residual, self.likelihood)

    @property
    def widest_px(self) -> float:
        """Widest bound [px] of a component that counts."""
        return self.rule.widest(self.weighting.widest_px)

    @property
    def enough(self) -> int:
        """So many narrow components do without wide ones."""
        return ENOUGH_INFORMATIVE * self.residual.sampling.minimal

    def bound(self, x: Array) -> Array:
        """Bounds [px] of inliers at coordinates x."""
        return self.rule.bound(self.likelihood, x)

    def at(self, T: Array, used: NDArray[np.bool_] | None = None, widened: float = 1.0) -> View:
        """Look at a motion (3, 4); which components count is decided there unless it is given."""
        return self.look(self.residual.at(T, self.index), used, widened)

    def look(self, errors: Linearised, used: NDArray[np.bool_] | None = None, widened: float = 1.0) -> View:
        """Look at errors, as `at` does at a motion."""
        bounds = self.bound(errors.x)
        if used is None:
            narrow = self.components & (bounds <= self.widest_px)
            used = narrow if narrow.sum() >= self.enough else self.components
        inliers = self.rule.inliers(errors.z, widened * bounds, used, self.vectors)
        return View(errors, bounds, used, inliers)

    def among(self, which: NDArray[np.bool_]) -> Problem:
        """Return the problem of some of the vectors (N,)."""
        return replace(self, residual=self.residual.sampling.among(which))

    def chosen(self, x: Array, used: NDArray[np.bool_]) -> Chosen:
        """Components at coordinates x (C,) for a maximisation over `used`."""
        return Chosen.of(self.likelihood, self.weighting, x, used)

    def information(self, view: View) -> Array:
        """Information (C,) [1/px^2] of each component's score; 0 where it is left out."""
        if self.refine_all:
            return np.where(view.used, self.likelihood.fisher(view.errors.x), 0.0)
        return self.rule.information(self.likelihood, view.errors.x, view.used, view.inliers)

    def count(self, inliers: NDArray[np.bool_]) -> int:
        """Number of inliers, in the rule's unit."""
        return self.rule.count(inliers, self.vectors)
