"""How well a likelihood describes errors."""

from flowlik.evaluation.likelihood._bias import bias_records
from flowlik.evaluation.likelihood._eigenbasis import kept_for_eigenbasis
from flowlik.evaluation.likelihood._evidence import little_data_warning, outside_warning, table_arrays
from flowlik.evaluation.likelihood._goodness import (
    CONFIDENCES,
    Counting,
    coverage,
    held_out_floor,
    kolmogorov_smirnov,
    negative_log_likelihood,
    nll_interval,
    outside_range,
)
from flowlik.evaluation.likelihood._levels import levels
from flowlik.evaluation.likelihood._model_records import blocks_over, figures, model_records

__all__ = [
    "CONFIDENCES",
    "Counting",
    "bias_records",
    "blocks_over",
    "coverage",
    "figures",
    "held_out_floor",
    "kept_for_eigenbasis",
    "kolmogorov_smirnov",
    "levels",
    "little_data_warning",
    "model_records",
    "negative_log_likelihood",
    "nll_interval",
    "outside_range",
    "outside_warning",
    "table_arrays",
]
