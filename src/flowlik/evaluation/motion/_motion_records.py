"""Records of estimated trajectories and motions against the truth, each with its protocol."""

from __future__ import annotations

from collections.abc import Sequence as Seq
from dataclasses import replace
from typing import cast

import numpy as np
from scipy.spatial.transform import RigidTransform

from flowlik.datasets.base import ImageSequence
from flowlik.egomotion import EgoMotion
from flowlik.errors import DataError, MissingFieldError
from flowlik.evaluation.motion._drift import (
    Align,
    aligned,
    direction_offset,
    drift_percent,
    kitti_errors,
    relative_pose_errors,
    remove_direction_offset,
)
from flowlik.geometry.trajectory import Trajectory
from flowlik.results.records import Record, protocol


def true_trajectory(sequence: ImageSequence, frames: int) -> Trajectory | None:
    """Truth of a sequence's first frames, or None where the data set has no poses."""
    try:
        poses = RigidTransform.concatenate([sequence.T_n_c(k) for k in range(frames)])
    except MissingFieldError:
        return None
    return Trajectory(np.array([sequence.timestamp(k) for k in range(frames)]), poses)


def trajectory_records(
    estimated: Trajectory,
    truth: Trajectory,
    dataset: str,
    flow: str | None = None,
    family: str | None = None,
    schedule: str | None = None,
    estimator: str | None = None,
    seed: int | None = None,
    **keys: object,
) -> list[Record]:
    """Drift, KITTI errors (with and without the constant direction offset) and per-frame errors.

    Nothing is aligned but where it is asked for; the first pose is shared. Figures that the data does not
    allow are null, with the reason in the protocol.

    Parameters
    ----------
    estimated, truth : Trajectory
        Poses of the same frames.
    dataset, flow, family, schedule, estimator, seed
        Keys of the records.
    **keys
        Keys of the protocol, such as ``scale``. ``align`` (none, se3 or sim3) is one that also lays the
        estimate onto the truth, see `flowlik.evaluation.motion._drift.aligned`.

    Raises
    ------
    DataError
        If the true path has no length, or the trajectories differ in length.
    """
    align = cast(Align, keys.pop("align", "none"))
    note = protocol(align=align, **keys, frames=len(truth))

    def record(metric: str, value: float | None, unit: str, count: int, extra: str = "") -> Record:
        full = f"{note}; {extra}" if extra else note
        return Record(metric, value, unit, dataset, flow, family, schedule, estimator, count, seed, full)

    drift = drift_percent(estimated, truth, align)
    estimated = aligned(estimated, truth, align)
    steps = relative_pose_errors(estimated, truth)
    kitti = kitti_errors(estimated, truth)
    why = protocol(metric="kitti-devkit", reason=kitti.reason or None)
    try:
        offset = direction_offset(estimated, truth)
        without = kitti_errors(remove_direction_offset(estimated, offset), truth)
        shown = " ".join(f"{1000 * value:.2f}" for value in offset)
        removed = (
            without.t_err_percent,
            protocol(metric="kitti-devkit", offset_mrad=shown, reason=without.reason or None),
        )
    except DataError as error:
        removed = None, protocol(metric="kitti-devkit", reason=str(error))
    count = len(kitti.segments)
    return [
        record("drift_percent", drift, "%", len(truth)),
        record("t_err_percent", kitti.t_err_percent, "%", count, why),
        record("r_err_deg_per_100m", kitti.r_err_deg_per_100m, "deg/100 m", count, why),
        record("t_err_offset_removed_percent", removed[0], "%", count, removed[1]),
        record("rpe_trans_median_m", float(np.median(steps.translation_m)), "m", len(truth) - 1),
        record("rpe_rot_median_deg", float(np.median(steps.rotation_deg)), "deg", len(truth) - 1),
    ]


def status_records(motions: Seq[EgoMotion], base: Record) -> list[Record]:
    """Share of frames not solved and of components outside the model's range, keyed as `base`."""
    counts: dict[str, int] = {}
    for motion in motions:
        counts[motion.status.value] = counts.get(motion.status.value, 0) + 1
    statuses = protocol(statuses=", ".join(f"{n} {status}" for status, n in sorted(counts.items())))
    unsolved = float(np.mean([not motion.solved for motion in motions]))
    outside = float(np.mean([motion.outside for motion in motions if motion.components] or [0.0]))
    note = base.protocol
    return [
        replace(
            base,
            metric="unsolved_fraction",
            value=unsolved,
            unit="",
            count=len(motions),
            protocol=f"{note}; {statuses}",
        ),
        replace(base, metric="outside_fraction", value=outside, unit="", count=len(motions)),
    ]
