"""`flowlik reproduce --kitti`: the paper's Table III on KITTI odometry, beside other estimators."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from scipy.spatial.transform import RigidTransform

from flowlik.datasets.base import Sequence
from flowlik.datasets.kitti import KittiOdometry, find_sequences
from flowlik.egomotion import EgoMotion, Epipolar, Estimator, mle
from flowlik.egomotion.self_calibration import SelfCalibration
from flowlik.errors import DataError
from flowlik.evaluation.baselines import opencv_essential, poselib_relative
from flowlik.evaluation.motion_records import status_records, trajectory_records, true_trajectory
from flowlik.evaluation.resampling import t_err_interval
from flowlik.evaluation.split_half import (
    LEAST_STEP_M,
    direction_noise_mrad,
    half_coverage,
    half_distances,
    halves,
    rotation_noise_mdeg,
)
from flowlik.features import features_of, measure_features
from flowlik.flow import flow_method
from flowlik.likelihood import FlowLikelihood
from flowlik.measurements import Measurements
from flowlik.model_file import load_likelihood
from flowlik.odometry import Odometry, scaled, true_move
from flowlik.progress import Progress, no_progress
from flowlik.records import Record, protocol
from flowlik.runs import RunFolder
from flowlik.scale import scale_source, true_distance
from flowlik.trajectory import Trajectory, chain

TABLE_III = ("00", "01", "03")
PUBLISHED = {
    "lcmsac-paper": {"00": 0.655, "01": 0.942, "03": 0.536},
    "voldor": {"00": 1.09, "01": 2.31, "03": 1.46},
}
"""t_err [%] as published: the paper's Table III; VOLDOR's scale is from the camera's height."""

Solver = Callable[[Epipolar], RigidTransform | None]
BASELINES: dict[str, Solver] = {
    "opencv-ransac": lambda residual: opencv_essential(residual),
    "opencv-magsac": lambda residual: opencv_essential(residual, flag=cv2.USAC_MAGSAC),
    "poselib": lambda residual: poselib_relative(residual),
}


@dataclass
class Row:
    """One row of the table: motions of every frame, those of both halves, and seconds spent."""

    keys: dict[str, object]
    motions: list[RigidTransform]
    pairs: list[tuple[RigidTransform, RigidTransform]]
    seconds: float = 0.0


def kitti_table(
    data: Path,
    model: Path,
    out: Path,
    sequences: tuple[str, ...] = TABLE_III,
    frames: int | None = None,
    seed: int = 0,
    command: str = "flowlik reproduce --kitti",
    progress: Progress = no_progress,
) -> RunFolder:
    """Run KITTI odometry sequences with one camera and the true steps' lengths.

    Rows are ours with nominal intrinsics, self-calibrated from images, and with a causal boresight; OpenCV
    (RANSAC, USAC_MAGSAC) and PoseLib on the same tracks.

    Parameters
    ----------
    data : Path
        Root of KITTI odometry (``sequences/NN`` and ``poses/NN.txt``, or folders ``NN`` of clips).
    model : Path
        Model file, calibrated in simulation.
    out : Path
        Run folder.
    sequences : tuple of str
        Names; those that are not there are left out.
    frames : int, optional
        Only the first so many of each.
    seed : int
        Seed of samples.
    command : str
        Command line that repeats the run.
    progress : Progress
        Told how far it is.

    Raises
    ------
    DataError
        If none of the sequences is there.
    """
    likelihood = load_likelihood(model)
    found = find_sequences(data)
    there = [name for name in sequences if name in found]
    if not there:
        raise DataError(
            f"{data}: none of the sequences {', '.join(sequences)} (there are {', '.join(found)})"
        )
    run = RunFolder(out, command, {"sequences": there, "frames": frames, "model": model.name}, seed)
    for name in there:
        run.records += sequence_records(KittiOdometry(found[name]), likelihood, frames, seed, progress)
        for label, values in PUBLISHED.items():
            if name in values:
                note = protocol(align="none", source="published", frames="all")
                run.records.append(
                    Record(
                        "t_err_percent", values[name], "%", f"kitti/{name}", estimator=label, protocol=note
                    )
                )
    run.finish()
    return run


def sequence_records(
    sequence: Sequence,
    likelihood: FlowLikelihood,
    frames: int | None = None,
    seed: int = 0,
    progress: Progress = no_progress,
) -> list[Record]:
    """Records of every row on one sequence."""
    count = len(sequence) if frames is None else min(frames, len(sequence))
    truth = true_trajectory(sequence, count)
    if truth is None:
        raise DataError(f"{sequence.name}: the table needs poses")
    method = flow_method(likelihood.method or {})
    estimator = mle(likelihood)

    def robot(settings: SelfCalibration | None = None, boresight: bool = False) -> Odometry:
        scale = scale_source("truth-norm", sequence)
        return Odometry(sequence.camera, method, estimator, seed, scale, settings, boresight)

    ours = {
        "nominal": robot(),
        "self-calibrated": robot(SelfCalibration()),
        "boresight": robot(boresight=True),
    }
    found: dict[str, list[EgoMotion]] = {name: [] for name in ours}
    rows = {name: Row({"boresight": "none", "self_calibrate": False}, [], []) for name in (*ours, *BASELINES)}
    rows["self-calibrated"].keys["self_calibrate"] = True
    rows["boresight"].keys["boresight"] = "causal"
    half_motions: list[tuple[EgoMotion, EgoMotion]] = []
    for k in progress(iter(range(1, count)), sequence.name, count - 1):
        m = _measured(sequence, k, likelihood, seed)
        distance, parts = true_distance(sequence, k), halves(m.pixels)
        for name, each in ours.items():
            start = time.process_time()
            motion = each.advance(m, reference_m=true_move(sequence, k))
            rows[name].seconds += time.process_time() - start
            rows[name].motions.append(motion.T_k_prev)
            found[name].append(motion)
        residuals = [Epipolar.of(m.select(part), sequence.camera) for part in parts]
        if distance > LEAST_STEP_M:
            begin = ours["nominal"].last
            guess = begin.motion.T_k_prev if begin is not None and begin.motion.solved else None
            pair = [estimator.estimate(residual, seed, guess) for residual in residuals]
            half_motions.append((pair[0], pair[1]))
            rows["nominal"].pairs.append((pair[0].T_k_prev, pair[1].T_k_prev))
        for name, solve in BASELINES.items():
            start = time.process_time()
            motion_ = solve(Epipolar.of(m, sequence.camera))
            rows[name].seconds += time.process_time() - start
            rows[name].motions.append(
                RigidTransform.identity() if motion_ is None else scaled(motion_, distance)
            )
            if distance > LEAST_STEP_M:
                first, second = (solve(residual) for residual in residuals)
                if first is not None and second is not None:
                    rows[name].pairs.append((first, second))
    records = []
    for name, row in rows.items():
        base = _base(sequence, estimator if name in ours else None, name, method.name, seed)
        records += _row_records(row, truth, base, features_of(method))
        if name in found:
            records += status_records(found[name], base)
    records += _coverage(half_motions, _base(sequence, estimator, "nominal", method.name, seed))
    return records


def _measured(sequence: Sequence, k: int, likelihood: FlowLikelihood, seed: int) -> Measurements:
    method, signals = flow_method(likelihood.method or {}), likelihood.schedule.index.signals
    return measure_features(
        sequence.image(k - 1), sequence.image(k), method, likelihood.texture, seed + k, signals
    )


def _base(sequence: Sequence, estimator: Estimator | None, name: str, flow: str, seed: int) -> Record:
    family = None if estimator is None else estimator.likelihood.family.name
    schedule = None if estimator is None else estimator.likelihood.schedule.name
    label = name if estimator is None else f"{estimator.name}-{name}"
    return Record("", None, "", sequence.name, flow, family, schedule, label, seed=seed)


def _row_records(row: Row, truth: Trajectory, base: Record, features: str) -> list[Record]:
    estimated = Trajectory(truth.timestamps, chain(row.motions))
    keys: dict[str, Any] = {"scale": "truth-norm", "residual": "epipolar", **row.keys, "features": features}
    names = (base.dataset or "", base.flow, base.family, base.schedule, base.estimator)
    records = trajectory_records(estimated, truth, *names, base.seed, **keys)

    def record(metric: str, value: float | None, unit: str, n: int, **extra: Any) -> Record:
        return Record(metric, value, unit, *names, n, base.seed, protocol(**keys, **extra))

    try:
        interval = t_err_interval(estimated, truth, np.random.default_rng(base.seed))
        ends: tuple[float | None, float | None] = (interval.low, interval.high)
        note: dict[str, Any] = {"blocks": "10 frames", "confidence": 0.95}
    except DataError as error:
        ends, note = (None, None), {"reason": str(error)}
    for end, value in zip(("low", "high"), ends):
        records.append(record(f"t_err_percent_{end}", value, "%", len(truth), **note))
    if row.pairs:
        first, second = (RigidTransform.concatenate([pair[i] for pair in row.pairs]) for i in (0, 1))
        halves_ = {"halves": "64 px chessboard"}
        n = len(row.pairs)
        records.append(
            record("split_half_direction_mrad", direction_noise_mrad(first, second), "mrad", n, **halves_)
        )
        records.append(
            record("split_half_rotation_mdeg", rotation_noise_mdeg(first, second), "0.001 deg", n, **halves_)
        )
    each = 1000 * row.seconds / max(len(row.motions), 1)
    records.append(record("estimation_ms", each, "CPU-ms", len(row.motions), includes="estimation"))
    return records


def _coverage(pairs: list[tuple[EgoMotion, EgoMotion]], base: Record) -> list[Record]:
    solved = [(a, b) for a, b in pairs if a.solved and b.solved]
    if not solved:
        return []
    distances = half_distances([a for a, _ in solved], [b for _, b in solved])
    note = protocol(halves="64 px chessboard", degrees_of_freedom=5)
    return [
        Record(
            f"split_half_coverage_{level}", half_coverage(distances, level / 100), "", base.dataset,
            base.flow, base.family, base.schedule, base.estimator, len(solved), base.seed, note,
        )
        for level in (50, 90, 95)
    ]  # fmt: skip
