"""Calibration: errors against truth, their sketch, and the fit of a look-up table."""

from flowlik.calibration.cache import SketchCache
from flowlik.calibration.executors import executor
from flowlik.calibration.fit import bootstrap, choose_smoothing, fit, place_knots
from flowlik.calibration.run import (
    Block,
    Task,
    calibrate,
    gather,
    pair_errors,
    sketch_blocks,
    split_blocks,
)
from flowlik.calibration.sketch import ErrorSketch, merge_all

__all__ = [
    "Block",
    "ErrorSketch",
    "SketchCache",
    "Task",
    "bootstrap",
    "calibrate",
    "choose_smoothing",
    "executor",
    "fit",
    "gather",
    "merge_all",
    "pair_errors",
    "place_knots",
    "sketch_blocks",
    "split_blocks",
]
