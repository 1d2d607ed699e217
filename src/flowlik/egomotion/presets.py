"""The estimators by name: RANSAC, LCMSAC and maximum likelihood."""

from __future__ import annotations

from flowlik.egomotion.estimator import Estimator
from flowlik.egomotion.inlier_rules import ByComponent, ByVector
from flowlik.likelihood.likelihood import FlowLikelihood


def ransac(radius_px: float = 0.5, gate: float | None = None) -> Estimator:
    """RANSAC with a Gaussian: vectors within a radius, least squares on the inliers."""
    likelihood = FlowLikelihood.constant_gaussian(radius_px)
    return Estimator("ransac", likelihood, ByVector(radius_px), gate=gate)


def lcmsac(likelihood: FlowLikelihood, confidence: float = 0.90, gate: float | None = None) -> Estimator:
    """Sampling consensus by component within the likelihood's own region (paper, Sec. II-G)."""
    return Estimator("lcmsac", likelihood, ByComponent(confidence), gate=gate)


def mle(likelihood: FlowLikelihood, confidence: float = 0.90, gate: float | None = None) -> Estimator:
    """Maximum likelihood over all components, started from sampling consensus."""
    return Estimator("mle", likelihood, ByComponent(confidence), refine_all=True, gate=gate)
