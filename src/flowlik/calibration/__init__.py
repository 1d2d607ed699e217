"""Calibration: errors against truth, their sketch, and the fit of a look-up table."""

from flowlik.calibration._fit import SMOOTHING_NAT, bootstrap, fit
from flowlik.calibration._learn import Rows, learn_index
from flowlik.calibration._pairs import calibration_pixels, pair_errors
from flowlik.calibration._schedules import (
    FLOW_INDEX,
    SCHEDULES,
    IndexForm,
    check_schedule,
    index_form,
    schedule_index,
)
from flowlik.calibration._sketch_file import load_sketch, save_sketch
from flowlik.calibration.cache import SketchCache
from flowlik.calibration.executors import executor
from flowlik.calibration.run import (
    BOOTSTRAP_BLOCKS,
    fit_likelihood,
    gather,
    sketch_blocks,
    split_blocks,
)
from flowlik.calibration.shared_errors import measured_pairs, spread_pairs, with_shared_errors
from flowlik.calibration.sketch import ErrorSketch, merge_all
from flowlik.calibration.tasks import Block, Task

__all__ = [
    "BOOTSTRAP_BLOCKS",
    "FLOW_INDEX",
    "SCHEDULES",
    "SMOOTHING_NAT",
    "Block",
    "ErrorSketch",
    "IndexForm",
    "Rows",
    "SketchCache",
    "Task",
    "bootstrap",
    "calibration_pixels",
    "check_schedule",
    "executor",
    "fit",
    "fit_likelihood",
    "gather",
    "index_form",
    "learn_index",
    "load_sketch",
    "measured_pairs",
    "merge_all",
    "pair_errors",
    "save_sketch",
    "schedule_index",
    "sketch_blocks",
    "split_blocks",
    "spread_pairs",
    "with_shared_errors",
]
