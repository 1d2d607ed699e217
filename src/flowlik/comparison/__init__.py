"""Rivals on the same input: baselines, drives, and their records."""

from flowlik.comparison._drive_records import drive_figures, drive_records
from flowlik.comparison._drives import BASELINES, OURS, run_drive

__all__ = [
    "BASELINES",
    "OURS",
    "drive_figures",
    "drive_records",
    "run_drive",
]
