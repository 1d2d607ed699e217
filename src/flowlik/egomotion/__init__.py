"""Ego-motion from flow: residuals, one estimator, and its result."""

from flowlik.egomotion.depth_errors import with_depth_errors
from flowlik.egomotion.epipolar import Epipolar
from flowlik.egomotion.estimator import Estimator
from flowlik.egomotion.inlier_rules import ByComponent, ByVector
from flowlik.egomotion.known_depth import KnownDepth
from flowlik.egomotion.posterior import GaussianPrior, LogProb, log_prob
from flowlik.egomotion.presets import lcmsac, mle, ransac
from flowlik.egomotion.residual import Residual
from flowlik.egomotion.result import EgoMotion, Status

__all__ = [
    "ByComponent",
    "ByVector",
    "EgoMotion",
    "Epipolar",
    "Estimator",
    "GaussianPrior",
    "KnownDepth",
    "LogProb",
    "Residual",
    "Status",
    "lcmsac",
    "log_prob",
    "mle",
    "ransac",
    "with_depth_errors",
]
