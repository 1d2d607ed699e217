"""Motions beside other sensors: factors of a graph, and a monitor that tells when GPS lies."""

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
from flowlik.fusion.ramp_test import RampAlarm, RampTest, ramp_alarm, ramp_test

__all__ = [
    "GpsInnovations",
    "RampAlarm",
    "RampTest",
    "block_maxima",
    "drawn_maxima",
    "false_alarm_threshold",
    "gtsam_factor",
    "normalised_innovations_squared",
    "ramp_alarm",
    "ramp_test",
    "trusted_fixes",
    "windowed_nis",
]
