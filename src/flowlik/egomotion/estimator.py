"""One estimator in four steps, sample, propose, count, refine: RANSAC, LCMSAC and maximum likelihood."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform

from flowlik.egomotion._at_infinity import at_infinity, hidden_parallax_px
from flowlik.egomotion._plane import better_of_two
from flowlik.egomotion._second_consensus import second_consensus
from flowlik.egomotion.consensus import consensus
from flowlik.egomotion.inlier_rules import ByComponent, InlierRule
from flowlik.egomotion.maximise import maximise, refine, transform
from flowlik.egomotion.moments import Moments, score_moments
from flowlik.egomotion.observability import INFORMATIVE_PX, Verdict, judged, too_little
from flowlik.egomotion.posterior import GaussianPrior
from flowlik.egomotion.problem import Explanation, Problem
from flowlik.egomotion.residual import Residual, check_serves
from flowlik.egomotion.result import EgoMotion, Status, of_rotation, unsolved
from flowlik.errors import DataError
from flowlik.likelihood.likelihood import FlowLikelihood


@dataclass(frozen=True, eq=False)
class Estimator:
    """Sampling consensus and maximum likelihood over one FlowLikelihood.

    Attributes
    ----------
    name : str
        As it appears in results.
    likelihood : FlowLikelihood
        Fits the inliers and weighs samples.
    rule : InlierRule
        Which components are inliers: `ByComponent` for LCMSAC, `ByVector` for RANSAC.
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
    rule: InlierRule = ByComponent()  # noqa: RUF009
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
        problem = self.problem(residual)
        if (why := too_little(problem)) is not None:
            return unsolved(*why, problem.excluded)
        if start is None and prior is not None:
            start = prior.mean

        # sample, propose, count support
        rng = np.random.default_rng(seed)
        found = consensus(problem, start, rng, self.most_hypotheses, self.success)
        if found.T is None:
            return unsolved(Status.DEGENERATE, "no minimal sample has a solution", problem.excluded)
        # refine
        errors, log_prob = refine(problem, found.T)
        # of a plane's two motions take the better
        best, twin = better_of_two(problem, Explanation(problem.look(errors), log_prob))
        # say how well the errors determine it
        moments = score_moments(problem, best.view)
        # add what was believed before
        if prior is not None:
            belief = moments.tempered(prior)
            entering = best.view.used if self.refine_all else best.view.inliers
            T, log_prob = maximise(problem, best.view.errors, entering, prior=belief)
            best = Explanation(problem.at(T, best.view.used), log_prob)
            moments = moments.with_prior(belief)
        # ask what is left over
        other = second_consensus(problem, best.view, rng, self.most_hypotheses, self.success)
        # judge
        verdict = judged(problem, best.view, moments, twin, other)
        return self._result(problem, best, moments, verdict, found.drawn)

    def problem(self, residual: Residual) -> Problem:
        """Return the residual as this estimator looks at it.

        Raises
        ------
        ModelError
            If the likelihood belongs to another flow method or texture definition.
        """
        check_serves(self.likelihood, residual)
        return Problem(residual, self.likelihood, self.rule, self.refine_all, self.gate or 0.0)

    def inliers(self, residual: Residual, T_k_prev: RigidTransform) -> NDArray[np.bool_]:
        """Which components (N, components a vector) of a residual's vectors are inliers of a motion.

        Raises
        ------
        ModelError
            If the likelihood belongs to another flow method or texture definition.
        """
        T = residual.retract(T_k_prev.as_matrix()[:3], np.zeros(6))
        return self.problem(residual).at(T).inliers.reshape(len(residual.measurements), -1)

    def _result(
        self, problem: Problem, found: Explanation, moments: Moments, verdict: Verdict, drawn: int
    ) -> EgoMotion:
        """Result of a motion, of the rotation alone if that is all there is, and beside an alternative."""
        told, alternative = Verdict(verdict.status, verdict.reason), None
        if (turn := verdict.rotation) is not None:
            far = at_infinity(problem)
            turned = score_moments(far, turn.view, hidden_parallax_px(far, turn.view))
            result = self._result(far, turn, turned, told, drawn)
            return replace(result, covariance=of_rotation(result.covariance, np.nan), scale_known=False)
        if (other := verdict.alternative) is not None:
            alternative = self._result(problem, other, score_moments(problem, other.view), told, drawn)
        if verdict.between is not None:
            found, moments = verdict.between, score_moments(problem, verdict.between.view)
        view, moments = found.view, moments.facing(verdict.in_front)
        T = problem.residual.retract(view.errors.T, np.zeros(6))
        return EgoMotion(
            T_k_prev=transform(T),
            information=moments.information,
            covariance=moments.covariance(view.errors.basis) + verdict.spread.T @ verdict.spread,
            status=verdict.status,
            reason=verdict.reason,
            scale_known=problem.residual.metric,
            inliers=problem.count(view.inliers),
            informative=int((view.inliers & (view.bounds <= INFORMATIVE_PX)).sum()),
            components=int(view.used.sum()),
            inlier_unit=self.rule.unit,
            excluded=problem.excluded,
            outside=self.likelihood.schedule.outside(view.errors.x[view.used]),
            log_prob=found.log_prob,
            hypotheses=drawn,
            sensitivity=moments.sensitivity,
            alternative=alternative,
        )
