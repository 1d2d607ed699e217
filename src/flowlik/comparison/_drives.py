"""Estimators side by side on one drive's tracks: ours with three treatments of the camera, and rivals."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field, replace
from typing import Any

import cv2
import numpy as np
from scipy.spatial.transform import RigidTransform

from flowlik.comparison.baselines import opencv_essential, poselib_relative
from flowlik.datasets.base import ImageSequence
from flowlik.egomotion import EgoMotion, Epipolar, Estimator, Status, lcmsac
from flowlik.errors import DataError
from flowlik.evaluation.motion import true_trajectory
from flowlik.evaluation.motion.split_half import LEAST_STEP_M, difference_covariance
from flowlik.flow import flow_method
from flowlik.flow.base import FlowMethod
from flowlik.geometry.motion import scaled
from flowlik.geometry.trajectory import Trajectory
from flowlik.likelihood.likelihood import FlowLikelihood
from flowlik.measurement.halves import halves
from flowlik.measurement.measurements import Measurements
from flowlik.odometry.boresight import Boresight
from flowlik.odometry.loop import measure_sequence, true_move
from flowlik.odometry.odometry import Odometry
from flowlik.odometry.scale import scale_source, true_distance
from flowlik.odometry.self_calibration import Intrinsics, SelfCalibration
from flowlik.support.arrays import Array
from flowlik.support.progress import Progress, no_progress

OUTLIER_CONFIDENCE = 0.99
KNOWN_PX = 3.0

OURS: dict[str, dict[str, object]] = {
    "nominal": {"boresight": "none", "self_calibrate": False},
    "self-calibrated": {"boresight": "none", "self_calibrate": True},
    "boresight": {"boresight": "causal", "self_calibrate": False},
}
"""Treatments of the camera, and how a protocol names them."""

Solver = Callable[[Epipolar], RigidTransform | None]
BASELINES: dict[str, Solver] = {
    "opencv-ransac": lambda residual: opencv_essential(residual),
    "opencv-magsac": lambda residual: opencv_essential(residual, flag=cv2.USAC_MAGSAC),
    "poselib": lambda residual: poselib_relative(residual),
    "poselib-cauchy": lambda residual: poselib_relative(residual, cauchy_px=0.15),
}


@dataclass
class Row:
    """One estimator's motions of every frame, those of both halves, and processor seconds of the whole.

    ``pairs`` are of frames whose true step is above 0.3 m; motions of halves have unit translations.
    ``differences`` are the covariances (6, 6) predicted of theirs, where both are solved.
    """

    keys: dict[str, object]
    motions: list[RigidTransform] = field(default_factory=list)
    found: list[EgoMotion] = field(default_factory=list)
    pairs: list[tuple[RigidTransform, RigidTransform]] = field(default_factory=list)
    halves: list[tuple[EgoMotion, EgoMotion]] = field(default_factory=list)
    differences: list[Array] = field(default_factory=list)
    seconds: float = 0.0


@dataclass
class Drive:
    """What all estimators made of one drive.

    Attributes
    ----------
    sequence, flow : str
        Names.
    truth : Trajectory
        True poses.
    estimator : Estimator
        Ours.
    seed : int
        Of the samples.
    rows : dict of str to Row
        By estimator.
    intrinsics : list of Intrinsics
        States after every frame of the self-calibrated row.
    measuring_s : float
        Processor seconds of decoding, features and flow.
    outliers : dict of str to array
        The frame with the most vectors that contradict the nominal motion, as the figure takes it.
    """

    sequence: str
    flow: str
    truth: Trajectory
    estimator: Estimator
    seed: int
    rows: dict[str, Row] = field(default_factory=dict)
    intrinsics: list[Intrinsics] = field(default_factory=list)
    measuring_s: float = 0.0
    outliers: dict[str, Any] = field(default_factory=dict)


def run_drive(
    sequence: ImageSequence,
    likelihood: FlowLikelihood,
    frames: int | None = None,
    seed: int = 0,
    names: Iterable[str] = (*OURS, *BASELINES),
    progress: Progress = no_progress,
    measured: Iterable[Measurements] | None = None,
) -> Drive:
    """Run estimators on one drive, all on the same tracks and with the true steps' lengths.

    Parameters
    ----------
    sequence : ImageSequence
        Images of one camera, with poses.
    likelihood : FlowLikelihood
        Names the flow.
    frames : int, optional
        Only the first so many.
    seed : int
        Of the samples.
    names : iterable of str
        Estimators, of `OURS` and `BASELINES`.
    progress : Progress
        Told how far it is.
    measured : iterable of Measurements, optional
        Of every frame after the first, where they are not to be made here.

    Raises
    ------
    DataError
        If there are no poses.
    ModelError
        If the likelihood's flow method is not one of flowlik's own.
    """
    count = len(sequence) if frames is None else min(frames, len(sequence))
    truth = true_trajectory(sequence, count)
    if truth is None:
        raise DataError(f"{sequence.name}: the table needs poses")
    method, estimator, names = flow_method(likelihood.method or {}), lcmsac(likelihood), tuple(names)
    robots = _robots(sequence, method, estimator, seed, names)
    plain = {"boresight": "none", "self_calibrate": False}
    drive = Drive(sequence.name, method.name, truth, estimator, seed)
    drive.rows = {name: Row(dict(OURS.get(name, plain))) for name in names}
    turning, rivals = Boresight.none(), [name for name in BASELINES if name in names]
    if measured is None:
        # one after the other: the processor's seconds are those of all threads
        pairs = measure_sequence(sequence, method, likelihood, seed, frames=count, map=map)
        measured = (pair.measurements for pair in pairs)
    steps = zip(range(1, count), _timed(drive, measured))
    for k, m in progress(steps, sequence.name, count - 1):
        for name, robot in robots.items():
            _advance(drive.rows[name], robot, m)
        if "boresight" in names:
            turning = _turn(drive, turning, true_move(sequence, k))
        distance_m = true_distance(sequence, k)
        parts = [Epipolar.of(m.select(part), sequence.camera) for part in halves(m.pixels)]
        if "nominal" in robots:
            _keep_outliers(drive, m, sequence, k)
            if distance_m > LEAST_STEP_M:
                _halve(drive, parts)
        whole = Epipolar.of(m, sequence.camera)
        for name in rivals:
            _run_baseline(drive.rows[name], BASELINES[name], whole, parts, distance_m)
    if drive.outliers:
        drive.outliers["image"] = sequence.image(drive.outliers.pop("frame"))
    if "self-calibrated" in robots:
        drive.intrinsics = robots["self-calibrated"].intrinsics
    return drive


def _robots(
    sequence: ImageSequence, method: FlowMethod, estimator: Estimator, seed: int, names: tuple[str, ...]
) -> dict[str, Odometry]:
    """Odometries by name; what a boresight turns is what the nominal camera finds: no estimate twice."""
    own = [name for name in OURS if name in names and name != "boresight"]
    if "boresight" in names and "nominal" not in own:
        raise DataError("the row boresight turns the motions of the row nominal, which is not asked for")
    scale = scale_source("truth-norm", sequence)
    refined = {name: SelfCalibration() if OURS[name]["self_calibrate"] else None for name in own}
    return {name: Odometry(sequence.camera, method, estimator, seed, scale, refined[name]) for name in own}


def _timed(drive: Drive, measured: Iterable[Measurements]) -> Iterator[Measurements]:
    """Measurements as they come; the drive keeps what they cost."""
    start = time.process_time()
    for m in measured:
        drive.measuring_s += time.process_time() - start
        yield m
        start = time.process_time()


def _advance(row: Row, robot: Odometry, m: Measurements) -> None:
    start = time.process_time()
    motion = robot.advance(m)
    row.seconds += time.process_time() - start
    row.motions.append(motion.T_k_prev)
    row.found.append(motion)


def _turn(drive: Drive, turning: Boresight, true_move_m: Array) -> Boresight:
    """Turn the nominal motion by what earlier frames say; return what this one says too."""
    found = drive.rows["nominal"].found[-1]
    turned = replace(found, T_k_prev=turning.applied(found.T_k_prev))
    drive.rows["boresight"].motions.append(turned.T_k_prev)
    drive.rows["boresight"].found.append(turned)
    solved = found.status is Status.SOLVED
    return turning.updated(found.T_k_prev, true_move_m) if solved else turning


def _halve(drive: Drive, parts: list[Epipolar]) -> None:
    """Motions of both halves of the nominal camera's vectors."""
    row, estimator = drive.rows["nominal"], drive.estimator
    guess = row.found[-1].T_k_prev if row.found[-1].solved else None
    first, second = (estimator.estimate(part, drive.seed, guess) for part in parts)
    if first.solved and second.solved:
        row.halves.append((first, second))
        row.differences.append(difference_covariance(estimator, parts, (first, second)))
    row.pairs.append((first.T_k_prev, second.T_k_prev))


def _keep_outliers(drive: Drive, m: Measurements, sequence: ImageSequence, k: int) -> None:
    """Keep the frame if more of its well-known vectors contradict the motion than of any before."""
    motion, likelihood = drive.rows["nominal"].found[-1], drive.estimator.likelihood
    if motion.status is not Status.SOLVED:
        return
    T = motion.T_k_prev.as_matrix()[:3]
    errors = Epipolar.of(m, sequence.camera).at(T, likelihood.schedule.index)
    bound = likelihood.bound(errors.x, OUTLIER_CONFIDENCE)
    known = bound < KNOWN_PX
    inlier = np.abs(errors.z) <= bound
    most = (~drive.outliers["inlier"]).sum() if drive.outliers else -1
    if (known & ~inlier).sum() > most:
        drive.outliers = {
            "frame": k - 1, "pixels": m.pixels[known], "flow": m.flow[known], "inlier": inlier[known],
        }  # fmt: skip


def _run_baseline(
    row: Row, solve: Solver, residual: Epipolar, parts: list[Epipolar], distance_m: float
) -> None:
    start = time.process_time()
    found = solve(residual)
    row.seconds += time.process_time() - start
    row.motions.append(RigidTransform.identity() if found is None else scaled(found, distance_m))
    if distance_m > LEAST_STEP_M:
        first, second = (solve(part) for part in parts)
        if first is not None and second is not None:
            row.pairs.append((first, second))
