"""How good the lengths are that a scale source tells, and whether they know it."""

from __future__ import annotations

from collections.abc import Sequence as Seq
from dataclasses import replace

import numpy as np

from flowlik.egomotion import EgoMotion
from flowlik.geometry.trajectory import Trajectory
from flowlik.results.records import Record
from flowlik.support.arrays import Array

# a normal error's 95 % bound, squared: NIS of one freedom
BOUND_95 = 1.96**2


def length_sigma(motion: EgoMotion) -> float:
    """Standard deviation of the length of a motion's translation, by its covariance; NaN without one."""
    t: Array = motion.T_k_prev.translation
    square = float(t @ t)
    variance = np.maximum(t @ motion.covariance[3:, 3:] @ t, 0.0)
    return float(np.sqrt(variance / square)) if square > 0 else float("nan")


def length_records(motions: Seq[EgoMotion], truth: Trajectory | None, base: Record) -> list[Record]:
    """Share of frames with a length told; against the truth its error, and how often it is within its bound.

    The normalised innovation squared is ``(length - true length)^2 / sigma^2``. Coverage is over all frames
    with a length that has a sigma, told or expected.

    Parameters
    ----------
    motions : sequence of EgoMotion
        Of every frame after the first.
    truth : Trajectory or None
        True poses of all frames.
    base : Record
        Keys of the records.
    """
    told = np.array([motion.scale_known and motion.solved for motion in motions])

    def record(metric: str, values: Array, unit: str = "", over: str = "frames") -> Record:
        value = float(np.mean(values)) if len(values) else None
        note = f"{base.protocol}; over={over}"
        return replace(base, metric=metric, value=value, unit=unit, count=len(values), protocol=note)

    records = [record("length_told_fraction", told)]
    if truth is None:
        return records
    true = np.linalg.norm(np.diff(truth.positions, axis=0), axis=1)
    found = np.array([np.linalg.norm(motion.T_k_prev.translation) for motion in motions])
    sigma = np.array([length_sigma(motion) for motion in motions])
    stated = np.isfinite(sigma) & (sigma > 0)
    nis = ((found - true)[stated] / sigma[stated]) ** 2
    relative = np.abs(found / true - 1)[told & (true > 0)]
    middle = [float(np.median(relative))] if len(relative) else []
    return [
        *records,
        record("length_coverage_95", nis <= BOUND_95, over="frames with a stated length"),
        record("length_nis_mean", nis, over="frames with a stated length"),
        record("length_error_median_percent", 100 * np.array(middle), "%", "frames with a length told"),
    ]
