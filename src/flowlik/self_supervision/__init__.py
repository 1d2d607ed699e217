"""Calibration without truth: errors of a sequence's own vectors against its own motions."""

from flowlik.self_supervision.cross_fit import MotionErrors, SeenPair, errors_against, half_motions
from flowlik.self_supervision.learning import (
    Calibrated,
    learn_without_truth,
    model_of_errors,
    shared_by,
    truthless_form,
    truthless_signals,
)
from flowlik.self_supervision.measuring import seen_pairs, self_calibrated, spread_firsts
from flowlik.self_supervision.passes import Pass, pass_over
from flowlik.self_supervision.readings import LEVELS, Reading, by_fifths, predicted_and_found

__all__ = [
    "LEVELS",
    "Calibrated",
    "MotionErrors",
    "Pass",
    "Reading",
    "SeenPair",
    "by_fifths",
    "errors_against",
    "half_motions",
    "learn_without_truth",
    "model_of_errors",
    "pass_over",
    "predicted_and_found",
    "seen_pairs",
    "self_calibrated",
    "shared_by",
    "spread_firsts",
    "truthless_form",
    "truthless_signals",
]
