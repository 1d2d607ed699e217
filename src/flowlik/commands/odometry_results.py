"""Records and figures of `flowlik odometry`."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from flowlik.datasets.base import ImageSequence
from flowlik.datasets.selection import Skipped
from flowlik.egomotion import EgoMotion, Estimator
from flowlik.evaluation.motion.drift import relative_pose_errors
from flowlik.evaluation.motion.motion_records import status_records, trajectory_records
from flowlik.flow import describe, method_label
from flowlik.flow.base import FlowMethod
from flowlik.geometry.trajectory import Trajectory
from flowlik.results.records import Record, protocol
from flowlik.results.runs import RunFolder


def run_records(
    sequence: ImageSequence,
    estimated: Trajectory,
    truth: Trajectory | None,
    motions: list[EgoMotion],
    estimator: Estimator,
    flow: FlowMethod,
    seed: int,
    keys: dict[str, object],
    seconds: float,
) -> list[Record]:
    """Records of a run: errors where the truth is known, states of frames, speed."""
    family, schedule = estimator.likelihood.family.name, estimator.likelihood.schedule.name
    name = method_label(describe(flow))
    base = Record(
        "frames_per_second", len(motions) / seconds, "1/s", sequence.name, name, family, schedule,
        estimator.name, len(motions), seed,
        protocol(**keys, includes="decoding, flow, estimation, compilation"),
    )  # fmt: skip
    records = [base, *status_records(motions, replace(base, protocol=protocol(**keys)))]
    if truth is None:
        return records
    errors = trajectory_records(
        estimated, truth, sequence.name, name, family, schedule, estimator.name, seed, **keys
    )
    if keys["scale"] == "none":
        unscaled = "; " + protocol(reason="without a scale the trajectory has no unit of length")
        errors = [
            r if r.metric == "rpe_rot_median_deg" else replace(r, value=None, protocol=r.protocol + unscaled)
            for r in errors
        ]
    return [*errors, *records]


def save_figures(
    run: RunFolder,
    estimated: Trajectory,
    truth: Trajectory | None,
    unsolved: NDArray[np.bool_],
    name: str,
    flow: FlowMethod,
    metric: bool,
) -> None:
    """Save what the figures of a run show."""
    label = method_label(describe(flow))
    origin = estimated.poses[0] if truth is None else truth.poses[0]
    positions = origin.apply(estimated.positions)[None]
    arrays = {
        "names": np.array([name]),
        "positions": positions,
        "timestamps": estimated.timestamps,
        "unit": np.array("m" if metric else "steps"),
        "unsolved": unsolved[None],
    }
    if truth is not None and metric:
        arrays["truth"] = truth.positions
        steps = relative_pose_errors(estimated, truth)
        errors = {"translation": steps.translation_m[None], "rotation": steps.rotation_deg[None]}
        shown = {"names": arrays["names"], "timestamps": estimated.timestamps[1:], **errors}
        run.save("frame-errors", label, shown)
    run.save("trajectories", label, arrays)


def skipped_record(base: Record, skipped: list[Skipped]) -> Record:
    """Record of how many frames were skipped, with the keys of another record."""
    return replace(base, metric="skipped_frames", value=float(len(skipped)), unit="", count=None, protocol="")
