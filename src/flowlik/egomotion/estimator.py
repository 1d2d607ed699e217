"""One estimator in four steps (sample, propose, score, refine): RANSAC, LCMSAC and maximum likelihood."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform

from flowlik.egomotion.covariance import sandwich, temperature
from flowlik.egomotion.maximise import maximise, transform
from flowlik.egomotion.posterior import GaussianPrior, Tempered
from flowlik.egomotion.residual import Residual, draw_samples
from flowlik.egomotion.result import EgoMotion, Status, conditioned, unsolved
from flowlik.egomotion.score_moments import score_moments, sensitivity
from flowlik.errors import DataError
from flowlik.likelihood.likelihood import FlowLikelihood
from flowlik.support.arrays import Array

FIRST_BATCH = 12
BATCH = 50
REFINEMENTS = 5
LOCAL_STEPS = 3
ANNEALING = (8.0, 4.0, 2.0)
INFORMATIVE_PX = 1.0
NO_PARALLAX_SHARE = 0.95
ENOUGH_TELLING = 10


@dataclass(frozen=True, eq=False)
class Estimator:
    """Sampling consensus and maximum likelihood over one FlowLikelihood.

    Attributes
    ----------
    name : str
        As it appears in results.
    likelihood : FlowLikelihood
        Fits the inliers, weighs samples, and bounds inliers unless ``radius_px`` does.
    confidence : float
        A component is an inlier within the central region of this confidence (the paper's 90 %).
    radius_px : float or None
        If given, a flow *vector* is an inlier within this radius instead: RANSAC.
    refine_all : bool
        Refine over all components rather than over the inliers: maximum likelihood, whose heavy tails
        take care of outliers.
    gate : float or None
        Components with texture below it [intensity^2/px^2] are ignored (the paper's gate).
    most_hypotheses : int
        Most minimal samples drawn.
    success : float
        Probability of one good sample at which drawing stops.
    """

    name: str
    likelihood: FlowLikelihood
    confidence: float = 0.90
    radius_px: float | None = None
    refine_all: bool = False
    gate: float | None = None
    most_hypotheses: int = 1000
    success: float = 0.99

    def estimate(
        self,
        residual: Residual,
        seed: int | np.random.Generator = 0,
        start: RigidTransform | None = None,
        prior: GaussianPrior | None = None,
    ) -> EgoMotion:
        """Estimate the motion of a residual.

        Parameters
        ----------
        residual : Residual
            Measurements with known depth, or the epipolar constraint.
        seed : int or Generator
            Draws the samples; the same seed gives the same result.
        start : RigidTransform, optional
            A guess, for instance the previous motion: the first hypothesis, and where minimal solutions
            start; by default the prior's mean or no motion.
        prior : GaussianPrior, optional
            Belief before the images: the motion is then of maximum posterior probability and so is its
            covariance. Needs a residual with a metric translation.

        Returns
        -------
        EgoMotion
            With a status that says whether it was solved; too little data is no exception.

        Raises
        ------
        ModelError
            If the likelihood belongs to another flow method or texture definition.
        DataError
            If a prior is given for a residual whose translation has no scale.
        """
        if prior is not None and not residual.metric:
            raise DataError("a prior on the motion needs depth: without it the translation has no scale")
        self.likelihood.check(residual.measurements)
        kept = residual.measurements.t >= (self.gate or 0.0)
        excluded = {**residual.excluded, "texture gate": int(kept.size - kept.sum())}
        if (n := int(kept.any(axis=1).sum())) < residual.minimal:
            return unsolved(Status.TOO_FEW, f"{n} flow vectors, {residual.minimal} needed", excluded)
        if residual.still():
            return unsolved(Status.STILL, "the flow is zero", excluded)
        if start is None and prior is not None:
            start = prior.mean
        found, ambiguous, drawn = self._consensus(residual, kept, start, np.random.default_rng(seed))
        if found is None:
            return unsolved(Status.DEGENERATE, "no minimal sample has a solution", excluded)

        components = residual.kept_components(kept)
        T, log_prob = self._refine(residual, found, self.telling(residual, found, components))
        used = self.telling(residual, T, components)
        A, B = score_moments(self, residual, T, used)
        S = sensitivity(self, residual, T, used, A, B)
        if prior is not None:
            belief = Tempered(prior, temperature(S, B))
            T, log_prob = maximise(
                residual, self.likelihood, T, self._entering(residual, T, used), prior=belief
            )
            S, _ = belief.posterior(S, B)
            A, B = belief.posterior(A, B)
        inliers = self.inlying(residual, T, used)
        x = residual.coordinates(T, self.likelihood.schedule.index)
        status, reason = conditioned(residual.basis(T), A)
        determined = status is Status.SOLVED
        explained = residual.rotation_share(T, self.bound, self.likelihood.schedule.index)
        if explained > NO_PARALLAX_SHARE * inliers.sum() / used.sum():
            status, reason = (
                Status.DEGENERATE,
                "a rotation alone explains the flow: no parallax, no direction",
            )
        elif status is Status.SOLVED and ambiguous:
            status, reason = Status.AMBIGUOUS, "two motions have nearly as many points in front of the camera"
        return EgoMotion(
            T_k_prev=transform(residual.normalise(T)),
            information=A,
            covariance=sandwich(S, B, residual.basis(T)) if determined else np.full((6, 6), np.nan),
            status=status,
            reason=reason,
            scale_known=residual.metric,
            inliers=self._count(residual, inliers),
            informative=int((inliers & (self.bound(x) <= INFORMATIVE_PX)).sum()),
            components=int(used.sum()),
            inlier_unit="component" if self.radius_px is None else "vector",
            excluded=excluded,
            outside=self.likelihood.schedule.outside(x[used]),
            log_prob=log_prob,
            hypotheses=drawn,
            sensitivity=S,
        )

    def inliers(self, residual: Residual, T_k_prev: RigidTransform) -> NDArray[np.bool_]:
        """Which components (N, components a vector) of a residual's vectors are inliers of a motion."""
        kept = residual.measurements.t >= (self.gate or 0.0)
        T = residual.normalise(T_k_prev.as_matrix()[:3])
        found = self.inlying(residual, T, self.telling(residual, T, residual.kept_components(kept)))
        return found.reshape(len(residual), residual.components_per_vector)

    def telling(self, residual: Residual, T: Array, used: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Components (C,) of `used` that are no wider than the residual counts; all, where these are few."""
        if self.radius_px is not None or residual.counted_px == np.inf:
            return used
        x = residual.coordinates(T, self.likelihood.schedule.index)
        narrow = used & (self.bound(x) <= residual.counted_px)
        return narrow if narrow.sum() >= ENOUGH_TELLING * residual.minimal else used

    def bound(self, x: Array) -> Array:
        """Bounds [px] of inliers at coordinates x."""
        if self.radius_px is not None:
            return np.full(np.shape(x), self.radius_px)
        return self.likelihood.bound(x, self.confidence)

    def inlying(
        self, residual: Residual, T: Array, used: NDArray[np.bool_], widened: float = 1.0
    ) -> NDArray[np.bool_]:
        """Components (C,) of `used` that are inliers of a motion, or belong to inlier vectors."""
        z, _ = residual.linearise(T)
        if self.radius_px is None:
            x = residual.coordinates(T, self.likelihood.schedule.index)
            return used & (np.abs(z) <= widened * self.bound(x))
        length = np.linalg.norm(np.where(used, z, 0.0).reshape(len(residual), -1), axis=1)
        return used & np.repeat(length <= widened * self.radius_px, residual.components_per_vector)

    def _entering(self, residual: Residual, T: Array, used: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Components (C,) that the last maximisation is over."""
        return used if self.refine_all else self.inlying(residual, T, used)

    def _count(self, residual: Residual, inliers: NDArray[np.bool_]) -> int:
        """Number of inliers in the estimator's own unit."""
        vectors = inliers.reshape(len(residual), -1).any(axis=1)
        return int((inliers if self.radius_px is None else vectors).sum())

    def _consensus(
        self,
        residual: Residual,
        kept: NDArray[np.bool_],
        start: RigidTransform | None,
        rng: np.random.Generator,
    ) -> tuple[Array | None, bool, int]:
        """Sample, propose and score until a good sample has almost surely been drawn.

        A start is the first hypothesis: where it explains the data, few samples remain to check it by.
        Returns the motion with most inliers, whether it is ambiguous, and how many samples were drawn.
        """
        index = self.likelihood.schedule.index
        used = residual.kept_components(kept)
        bounds = residual.bounds(self.bound, index, kept)
        most_px = residual.counted_px if self.radius_px is None else np.inf
        telling = ((bounds >= 0) & (bounds <= most_px)).reshape(len(used), -1)
        if telling.any(axis=1).sum() >= ENOUGH_TELLING * residual.minimal:
            bounds = np.where(bounds <= most_px, bounds, -1.0)
        weights = self._sampling_weights(residual, kept)
        vectors = self.radius_px is not None

        def inliers_of(T: Array) -> NDArray[np.bool_]:
            return self.inlying(residual, T, self.telling(residual, T, used))

        def draws(inliers: NDArray[np.bool_]) -> int:
            """Samples until one of inliers alone has been drawn, as probable as asked."""
            shape = len(residual), -1
            good = (inliers | ~used).reshape(shape).all(axis=1) & inliers.reshape(shape).any(axis=1)
            share = float(weights[good].sum() / weights.sum()) ** residual.minimal
            if share <= 0:
                return self.most_hypotheses
            needed = np.log(1 - self.success) / np.log1p(-min(share, 1 - 1e-12))
            return min(self.most_hypotheses, int(needed) + 1)

        best, ambiguous, best_score, drawn, needed = None, False, 0, 0, self.most_hypotheses
        begin = np.eye(4)[:3] if start is None else start.as_matrix()[:3]
        if start is not None:
            tracked = self._anneal(residual, residual.normalise(begin), used)
            best, ambiguous = residual.motion(residual.hypothesis(tracked), inliers_of)
            inliers = inliers_of(best)
            best_score, needed = self._count(residual, inliers), draws(inliers)
        while drawn < needed:
            batch = BATCH if drawn else FIRST_BATCH
            samples = draw_samples(weights, min(batch, needed - drawn), residual.minimal, rng)
            drawn += len(samples)
            hypotheses = residual.propose(samples, begin)
            if not len(hypotheses):
                continue
            scores = residual.score(hypotheses, bounds, vectors)
            if scores.max() > best_score:
                hypothesis, best_score = hypotheses[scores.argmax()], int(scores.max())
                best, ambiguous = residual.motion(hypothesis, inliers_of)
                # local optimisation: a minimal sample carries its own noise
                inliers = inliers_of(best)
                better, _ = maximise(residual, self.likelihood, best, inliers, LOCAL_STEPS)
                chosen = inliers_of(better)
                if (score := self._count(residual, chosen)) >= best_score:
                    best, best_score, inliers = better, score, chosen
                needed = draws(inliers)
        return best, ambiguous, drawn

    def _anneal(self, residual: Residual, T: Array, used: NDArray[np.bool_]) -> Array:
        """Follow the likelihood from a guess, its errors first taken to be several times as wide."""
        for widened in ANNEALING:
            chosen = self.inlying(residual, T, used, widened)
            T, _ = maximise(residual, self.likelihood, T, chosen, LOCAL_STEPS, widened)
        return maximise(residual, self.likelihood, T, self.inlying(residual, T, used), LOCAL_STEPS)[0]

    def _sampling_weights(self, residual: Residual, kept: NDArray[np.bool_]) -> Array:
        """Draw a vector in proportion to the root of its weaker component's information; gated ones last."""
        x = residual.eigen_coordinates(self.likelihood.schedule.index)
        reliability = np.sqrt(np.where(kept, self.likelihood.fisher(x), 0.0).min(axis=1))
        return reliability + 1e-6 * reliability.max() + 1e-300

    def _refine(self, residual: Residual, T: Array, used: NDArray[np.bool_]) -> tuple[Array, float]:
        """Maximise the likelihood over inliers, chosen anew until they settle, then over all if asked."""
        log_prob = -np.inf
        for _ in range(REFINEMENTS):
            before = T
            T, log_prob = maximise(residual, self.likelihood, T, self.inlying(residual, T, used))
            if T is before:
                break
        return maximise(residual, self.likelihood, T, used) if self.refine_all else (T, log_prob)
