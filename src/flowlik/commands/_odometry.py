"""`flowlik odometry`: a sequence of images to a trajectory."""

from __future__ import annotations

import time
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import cast

import numpy as np

from flowlik.commands._odometry_files import write_frames, write_intrinsics
from flowlik.commands._odometry_results import Flown, report_odometry
from flowlik.commands._reading import warn_of_doubts
from flowlik.commands.options import OdometryOptions
from flowlik.datasets import masked, open_sequence, resized
from flowlik.datasets.base import ImageSequence
from flowlik.datasets.selection import Selection, Skipped, select_frames
from flowlik.datasets.truth import with_truth
from flowlik.egomotion import EgoMotion, Estimator, lcmsac, mle, ransac
from flowlik.errors import DataError, MissingFieldError
from flowlik.evaluation.motion import agreement, true_trajectory
from flowlik.flow import coded, confirmed_method, describe, flow_method
from flowlik.flow.base import FlowMethod
from flowlik.geometry.trajectory import Trajectory, write_kitti, write_tum
from flowlik.likelihood.model_file import load_likelihood
from flowlik.odometry.adaptation import adapting
from flowlik.odometry.keyframes import moving_frames
from flowlik.odometry.loop import ResidualKind, run_odometry
from flowlik.odometry.odometry import Odometry
from flowlik.odometry.ros_odometry import write_odometry_bag
from flowlik.odometry.scale import SCALES, scale_source
from flowlik.odometry.self_calibration import SelfCalibration
from flowlik.odometry.trajectory_covariance import write_covariance
from flowlik.report import finish
from flowlik.report.viewer import viewer, watched_by
from flowlik.results.runs import RunFolder
from flowlik.support.extras import extra
from flowlik.support.progress import Progress, no_progress

ESTIMATORS = ("ransac", "lcmsac", "mle")


def odometry(
    data: Path,
    out: Path,
    options: OdometryOptions = OdometryOptions(),
    *,
    command: str = "flowlik odometry",
    progress: Progress = no_progress,
) -> RunFolder:
    """Estimate the trajectory of a sequence, and its errors where the data set has poses.

    Parameters
    ----------
    data : Path
        Folder of a sequence, or a video file.
    out : Path
        Run folder: trajectory in KITTI's and TUM's format, its covariance as ``covariance.csv`` and, with the
        poses, ``trajectory.npz``; ``frames.csv`` with each frame's status.
    options : OdometryOptions
        How; the run records them, with the residual that was chosen.
    command : str
        Command line that repeats the run.
    progress : Progress
        Told how far it is.

    Raises
    ------
    DataError
        If options contradict one another or the data, or no frame at all could be solved.
    ModelError
        If there is no such model or method, or the model is for another method than the one given.
    MissingExtraError
        If a bag is asked for and rosbags is not installed.
    """
    flow = flow_of(options)
    if options.scale not in SCALES:
        raise DataError(f"unknown scale source {options.scale!r}: known are {', '.join(SCALES)}")
    if options.boresight not in ("none", "causal"):
        raise DataError(f"unknown boresight {options.boresight!r}: known are none, causal")
    if options.bag:
        extra("rosbags", "--save-bag")
    elif options.bag_unscaled:
        raise DataError("--save-bag-unscaled says what --save-bag writes: give both")
    sequence, skipped = opened_frames(data, options, flow, progress)
    kind = residual_kind(sequence, options.residual)
    options = replace(options, residual=kind)
    source = scale_source(options.scale, sequence, options.camera_height_m)
    if kind == "depth" and options.self_calibrate:
        raise DataError("--self-calibrate refines the camera where depth is unknown: --residual epipolar")
    # a pose file that cannot be used is told before the work, not after it
    truth = true_trajectory(sequence, len(sequence))
    if options.boresight == "causal" and truth is None:
        raise DataError(f"{sequence.name}: --boresight causal needs poses, which this data set does not have")
    estimator = estimator_of(options)
    run = RunFolder(
        out, command, {"data": str(data), **options.asdict(), "flow": describe(flow)}, options.seed
    )
    doubted = warn_of_doubts(run, sequence, flow)

    settings = SelfCalibration() if options.self_calibrate else None
    robot = Odometry(
        sequence.camera, flow, estimator, options.seed, source, settings, options.boresight == "causal"
    )
    record = run.begin() / "view.rrd" if options.record else None
    motions = run_odometry(sequence, robot, kind)
    if options.adapt:
        motions = adapting(motions, robot)
    motions = watched_by(viewer(options.view, record), motions, sequence, robot)
    what = f"{options.estimator} on {sequence.name}, image pairs"
    flown = _flown(sequence, robot, truth, progress(motions, what, len(sequence) - 1))
    write_files(run.begin(), flown, options)
    report_odometry(run, flown, options, skipped, doubted)
    finish(run)
    return run


def opened_frames(
    data: Path, options: OdometryOptions, flow: FlowMethod, progress: Progress
) -> tuple[Selection, list[Skipped]]:
    """Frames that the options choose of a data set, and those that cannot be used.

    Raises
    ------
    DataError
        If it is no data set, or has no such frames.
    """
    lenient = options.skip_bad_frames
    opened = open_sequence(
        data, options.format, options.camera, options.frames_per_second, lenient, options.topic,
        options.depth_topic,
    )  # fmt: skip
    whole = resized(masked(opened, options.mask), options.resize)
    if options.truth is not None:
        whole = with_truth(whole, options.truth, lenient)
    sequence, skipped = select_frames(whole, options.start, options.frames, lenient, options.stride)
    if options.parallax is not None:
        what = f"parallax of {sequence.name}, images"
        sequence = moving_frames(
            sequence, flow, options.parallax, lambda frames: progress(frames, what, len(sequence) - 1)
        )
    return sequence, skipped


def _flown(
    sequence: Selection, robot: Odometry, truth: Trajectory | None, motions: Iterable[EgoMotion]
) -> Flown:
    """All motions of an odometry, each compared with the true one as it comes."""
    begin = time.perf_counter()
    found, agreements = [], []
    for motion in motions:
        found.append(motion)
        if truth is not None and robot.last is not None:
            k = len(found)
            T = truth.poses[k].inv() * truth.poses[k - 1]
            agreements.append(agreement(robot.last.measurements, robot.last.camera, T, motion.T_k_prev))
    seconds = time.perf_counter() - begin
    if all(motion.predicted for motion in found):
        reason = found[0].reason if found else "there is only one image"
        raise DataError(f"{sequence.name}: no frame could be solved ({reason})")
    return Flown(sequence, sequence.numbers, robot, truth, found, agreements, seconds)


def write_files(folder: Path, flown: Flown, options: OdometryOptions) -> None:
    """Write trajectory, covariances and states of frames to a run's folder.

    Raises
    ------
    DataError
        If the place cannot be written to.
    """
    estimated, frames = flown.estimated, flown.numbers
    write_kitti(folder / "trajectory_kitti.txt", estimated)
    write_tum(folder / "trajectory_tum.txt", estimated)
    persistence = flown.robot.persistence
    write_covariance(folder, estimated, flown.motions, persistence)
    if options.bag:
        bag = folder / "odometry_bag"
        write_odometry_bag(
            bag, estimated, flown.motions, unscaled=options.bag_unscaled, persistence=persistence
        )
    write_frames(folder / "frames.csv", estimated, flown.motions, frames[1:])
    if flown.robot.intrinsics:
        write_intrinsics(folder / "intrinsics.csv", flown.robot.intrinsics, frames)


def flow_of(options: OdometryOptions) -> FlowMethod:
    """Flow method of the options of a run.

    Raises
    ------
    DataError
        If estimator or gate are none, or a model is missing.
    ModelError
        If there is no such model or method, or the model is for another method than the one given.
    """
    estimator, gate = options.estimator, options.gate
    if options.adapt and estimator == "ransac":
        raise DataError("--adapt follows a model's errors: --estimator ransac has none")
    if estimator not in ESTIMATORS:
        raise DataError(f"unknown estimator {estimator!r}: known are {', '.join(ESTIMATORS)}")
    if gate is not None and not 0 <= gate < np.inf:
        raise DataError(f"--min-texture must be a texture of at least 0, not {gate}")
    if options.model is None:
        if estimator != "ransac":
            raise DataError(
                f"--estimator {estimator} needs --model: a shipped model's name (`flowlik models`) or a file "
                "that `flowlik calibrate` makes"
            )
        return coded(flow_method(options.method or "lucas-kanade"), options.flow_png)
    likelihood = load_likelihood(options.model)
    return coded(confirmed_method(likelihood.method or {}, options.method), options.flow_png)


def estimator_of(options: OdometryOptions) -> Estimator:
    """Estimator of the options of a run.

    Raises
    ------
    ModelError
        If there is no such model.
    """
    if options.model is None or options.estimator == "ransac":
        return ransac(gate=options.gate)
    make = lcmsac if options.estimator == "lcmsac" else mle
    return make(load_likelihood(options.model), gate=options.gate)


def residual_kind(sequence: ImageSequence, asked: str | None) -> ResidualKind:
    """The residual that is asked for, or else known depth where the data has it.

    Raises
    ------
    DataError
        If there is no such residual.
    """
    if asked not in (None, "depth", "epipolar"):
        raise DataError(f"unknown residual {asked!r}: known are depth, epipolar")
    if asked is not None:
        return cast(ResidualKind, asked)
    try:
        sequence.depth(0)
    except MissingFieldError:
        return "epipolar"
    return "depth"
