"""Motions beside other sensors: factors of a graph."""

from flowlik.fusion.gtsam_factor import gtsam_factor

__all__ = ["gtsam_factor"]
