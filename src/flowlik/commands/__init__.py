"""The commands as Python functions of the same names; the command line only parses and prints."""

from __future__ import annotations

from typing import TYPE_CHECKING

from flowlik.support.lazy import lazily

if TYPE_CHECKING:
    from flowlik.commands._calibrate import calibrate as calibrate
    from flowlik.commands._doctor import doctor as doctor
    from flowlik.commands._drift import drift as drift
    from flowlik.commands._evaluate import evaluate as evaluate
    from flowlik.commands._flow import flow as flow
    from flowlik.commands._fuse import fuse as fuse
    from flowlik.commands._kitti import find_table_sequences as find_table_sequences
    from flowlik.commands._kitti import kitti_table as kitti_table
    from flowlik.commands._live import live_odometry as live_odometry
    from flowlik.commands._models import models as models
    from flowlik.commands._models import summary as summary
    from flowlik.commands._odometry import odometry as odometry
    from flowlik.commands._reproduce import reproduce as reproduce
    from flowlik.commands._simulate import simulate as simulate
    from flowlik.commands._without_truth import calibrate_without_truth as calibrate_without_truth

__all__, __getattr__, __dir__ = lazily(
    __name__,
    {
        "_calibrate": "calibrate",
        "_doctor": "doctor",
        "_drift": "drift",
        "_evaluate": "evaluate",
        "_flow": "flow",
        "_fuse": "fuse",
        "_kitti": "find_table_sequences kitti_table",
        "_live": "live_odometry",
        "_models": "models summary",
        "_odometry": "odometry",
        "_reproduce": "reproduce",
        "_simulate": "simulate",
        "_without_truth": "calibrate_without_truth",
    },
)
