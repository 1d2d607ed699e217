"""Ego-motion from flow: residuals, one estimator, and its result."""

from flowlik.egomotion.epipolar import Epipolar
from flowlik.egomotion.estimator import Estimator, lcmsac, mle, ransac
from flowlik.egomotion.known_depth import KnownDepth
from flowlik.egomotion.residual import Residual
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
