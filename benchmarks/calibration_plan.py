"""What is calibrated, tried and reported in `benchmarks/calibration.py`: the standard flights."""

from flowlik.commands.standard_plan import CALIBRATION, FOREST, REPORT, VALIDATION, strict

__all__ = ["CALIBRATION", "FOREST", "REPORT", "VALIDATION", "strict"]
