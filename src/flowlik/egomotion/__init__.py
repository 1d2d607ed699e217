"""Ego-motion from flow: residuals, one estimator, and its result."""

from flowlik.egomotion.estimator import Estimator, lcmsac, mle, ransac
from flowlik.egomotion.residuals import Epipolar, KnownDepth, Residual
from flowlik.egomotion.result import EgoMotion, Status

__all__ = [
    "EgoMotion",
    "Epipolar",
    "Estimator",
    "KnownDepth",
    "Residual",
    "Status",
    "lcmsac",
    "mle",
    "ransac",
]
