"""Calibration: errors against truth, their sketch, and the fit of a look-up table."""

from flowlik.calibration.fit import fit, place_knots
from flowlik.calibration.run import Block, calibrate, pair_errors, sketch_blocks, split_blocks
from flowlik.calibration.sketch import ErrorSketch, merge_all

__all__ = [
    "Block",
    "ErrorSketch",
    "calibrate",
    "fit",
    "merge_all",
    "pair_errors",
    "place_knots",
    "sketch_blocks",
    "split_blocks",
]
