"""Motions beside other sensors: factors of a graph."""

from flowlik.fusion.gtsam_factor import gtsam_factor
from flowlik.fusion.innovations import GpsInnovations

__all__ = ["GpsInnovations", "gtsam_factor"]
