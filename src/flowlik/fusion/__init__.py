"""Motions beside other sensors: a smoother of IMU, flow and GPS, and a monitor that tells when GPS lies."""

from flowlik.fusion.alignment import TurnOn, coarse_start, heading_sigma_rad
from flowlik.fusion.direction_factor import DirectionFactor, direction_factor
from flowlik.fusion.fuse import Fused, covers, fuse
from flowlik.fusion.gtsam_factor import gtsam_factor
from flowlik.fusion.innovations import GpsInnovations
from flowlik.fusion.integrity import (
    block_maxima,
    drawn_maxima,
    false_alarm_threshold,
    normalised_innovations_squared,
    trusted_fixes,
    windowed_nis,
)
from flowlik.fusion.lidar import LidarNoise, SparseDepth, lidar_motion, lidar_residual, sparse_depth
from flowlik.fusion.ramp_test import RampAlarm, RampTest, ramp_alarm, ramp_test
from flowlik.fusion.smoother import FixedLagSmoother
from flowlik.fusion.state import ColouredGps, FusedState, FusionSettings, GpsFix, ImuSegment
from flowlik.fusion.time_offset import TimeOffset, estimate_time_offset

__all__ = [
    "ColouredGps",
    "DirectionFactor",
    "FixedLagSmoother",
    "Fused",
    "FusedState",
    "FusionSettings",
    "GpsFix",
    "GpsInnovations",
    "ImuSegment",
    "LidarNoise",
    "RampAlarm",
    "RampTest",
    "SparseDepth",
    "TimeOffset",
    "TurnOn",
    "block_maxima",
    "coarse_start",
    "covers",
    "direction_factor",
    "drawn_maxima",
    "estimate_time_offset",
    "false_alarm_threshold",
    "fuse",
    "gtsam_factor",
    "heading_sigma_rad",
    "lidar_motion",
    "lidar_residual",
    "normalised_innovations_squared",
    "ramp_alarm",
    "ramp_test",
    "sparse_depth",
    "trusted_fixes",
    "windowed_nis",
]
