"""`flowlik odometry`: a sequence of images to a trajectory."""

from __future__ import annotations

import time
from pathlib import Path
from typing import cast

import numpy as np
from scipy.spatial.transform import RigidTransform

from flowlik.commands.odometry_files import write_frames, write_intrinsics
from flowlik.commands.odometry_results import run_records, save_figures, skipped_record
from flowlik.datasets import open_sequence
from flowlik.datasets.base import ImageSequence
from flowlik.datasets.selection import select_frames
from flowlik.egomotion import Estimator, lcmsac, mle, ransac
from flowlik.errors import DataError, MissingFieldError
from flowlik.evaluation.likelihood.evidence import outside_warning
from flowlik.evaluation.motion.data_check import agreement, disagreement_warning
from flowlik.evaluation.motion.motion_records import true_trajectory
from flowlik.flow import confirmed_method, describe, flow_method
from flowlik.flow.base import FlowMethod
from flowlik.geometry.trajectory import Trajectory, write_kitti, write_tum
from flowlik.likelihood.model_file import load_likelihood
from flowlik.measurement.features import features_of
from flowlik.odometry.loop import ResidualKind, run_odometry
from flowlik.odometry.odometry import Odometry
from flowlik.odometry.ros_odometry import write_odometry_bag
from flowlik.odometry.scale import SCALES, scale_source
from flowlik.odometry.self_calibration import SelfCalibration
from flowlik.odometry.trajectory_covariance import write_covariance
from flowlik.report import finish
from flowlik.report.viewer import viewer, watched_by
from flowlik.results.records import select
from flowlik.results.runs import RunFolder
from flowlik.support.extras import extra
from flowlik.support.progress import Progress, no_progress

ESTIMATORS = ("ransac", "lcmsac", "mle")


def odometry(
    data: Path,
    out: Path,
    model: Path | None = None,
    method: str | None = None,
    estimator: str = "lcmsac",
    residual: str | None = None,
    scale: str = "none",
    height_m: float = 1.65,
    self_calibrate: bool = False,
    boresight: str = "none",
    gate: float | None = None,
    frames: int | None = None,
    format: str | None = None,
    seed: int = 0,
    command: str = "flowlik odometry",
    progress: Progress = no_progress,
    camera: str | None = None,
    frames_per_second: float | None = None,
    start: int = 0,
    skip_bad_frames: bool = False,
    topic: str | None = None,
    bag: bool = False,
    view: bool = False,
    record: bool = False,
) -> RunFolder:
    """Estimate the trajectory of a sequence, and its errors where the data set has poses.

    Parameters
    ----------
    data : Path
        Folder of a sequence, or a video file.
    out : Path
        Run folder: trajectory in KITTI's and TUM's format, its covariance as ``covariance.csv`` and, with the
        poses, ``trajectory.npz``; ``frames.csv`` with each frame's status.
    model : Path, optional
        Model file; needed for lcmsac and mle. It names the flow method.
    method : str, optional
        Flow method for RANSAC without a model; beside a model it may only confirm it, and must
        where that is an object or flow on disk.
    estimator : {"lcmsac", "ransac", "mle"}
        Estimator.
    residual : {"depth", "epipolar"}, optional
        By default known depth if the data has it.
    scale : {"none", "truth-norm", "gps-norm", "camera-height", "stereo"}
        Where the length of each motion comes from without depth.
    height_m : float
        Height of the camera over the road [m], for the scale ``camera-height``.
    self_calibrate : bool
        Refine principal point and radial distortion from the images, without depth.
    boresight : {"none", "causal"}
        Whether motions are turned into the frame of the true poses, by what past frames say.
    gate : float, optional
        Texture gate [intensity^2/px^2].
    frames : int, optional
        Only the first so many frames.
    format : str, optional
        Data format; guessed by default.
    seed : int
        Seed of pixels and samples.
    command : str
        Command line that repeats the run.
    progress : Progress
        Told how far it is.
    camera : str, optional
        ``f,cx,cy`` or ``fx,fy,cx,cy`` [px], or a camera file, for data without a camera of its own.
    frames_per_second : float, optional
        Frame rate [Hz], for images without times.
    start : int
        First frame; what comes before is not looked at.
    skip_bad_frames : bool
        Go on over frames that are missing or unreadable, or whose time does not advance; the report tells
        which.
    topic : str, optional
        Topic of the images of a ROS bag.
    bag : bool
        Also write the trajectory as a ROS 2 bag, ``odometry_bag``.
    view, record : bool
        Show the run live in the rerun viewer; record it as ``view.rrd``.

    Raises
    ------
    DataError
        If options contradict one another or the data, or no frame at all could be solved.
    """
    flow, chosen = choose(estimator, model, method, gate)
    if scale not in SCALES:
        raise DataError(f"unknown scale source {scale!r}: known are {', '.join(SCALES)}")
    if boresight not in ("none", "causal"):
        raise DataError(f"unknown boresight {boresight!r}: known are none, causal")
    if bag:
        extra("rosbags", "--bag")
    whole = open_sequence(data, format, camera, frames_per_second, skip_bad_frames, topic)
    sequence, skipped = select_frames(whole, start, frames, skip_bad_frames)
    kind = _residual_kind(sequence, residual)
    source = scale_source(scale, sequence, height_m)
    if kind == "depth":
        if self_calibrate:
            raise DataError("--self-calibrate refines the camera where depth is unknown: --residual epipolar")
        scale = "depth"
    config = {
        "data": str(data), "model": None if model is None else str(model), "estimator": estimator,
        "residual": kind, "scale": scale, "gate": gate, "frames": frames, "method": describe(flow),
        "camera": camera, "frames_per_second": frames_per_second, "topic": topic,
        "start": start, "skip_bad_frames": skip_bad_frames,
    }  # fmt: skip
    count = len(sequence)
    # a pose file that cannot be used is told before the work, not after it
    truth = true_trajectory(sequence, count)
    if boresight == "causal" and truth is None:
        raise DataError(f"{sequence.name}: --boresight causal needs poses, which this data set does not have")
    run = RunFolder(out, command, config, seed)

    settings = SelfCalibration() if self_calibrate else None
    robot = Odometry(sequence.camera, flow, chosen, seed, source, settings, boresight == "causal")
    loop = run_odometry(sequence, robot, kind)
    watched = watched_by(viewer(view, run.begin() / "view.rrd" if record else None), loop, sequence, robot)
    begin = time.perf_counter()
    motions, agreements = [], []
    for motion in progress(watched, f"{estimator} on {sequence.name}, image pairs", count - 1):
        motions.append(motion)
        if truth is not None and robot.last is not None:
            k = len(motions)
            T = truth.poses[k].inv() * truth.poses[k - 1]
            agreements.append(agreement(robot.last.measurements, robot.last.camera, T, motion.T_k_prev))
    seconds = time.perf_counter() - begin
    if not any(motion.solved for motion in motions):
        reason = motions[0].reason if motions else "there is only one image"
        raise DataError(f"{sequence.name}: no frame could be solved ({reason})")

    estimated = Trajectory(np.array(robot.timestamps), RigidTransform.concatenate(robot.poses))
    write_kitti(run.begin() / "trajectory_kitti.txt", estimated)
    write_tum(run.path / "trajectory_tum.txt", estimated)
    write_covariance(run.path, estimated, motions)
    if bag:
        write_odometry_bag(run.path / "odometry_bag", estimated, motions)
    write_frames(run.path / "frames.csv", estimated, motions, sequence.frames[1:])
    if robot.intrinsics:
        write_intrinsics(run.path / "intrinsics.csv", robot.intrinsics, sequence.frames)
    keys = {
        "residual": kind, "scale": scale, "boresight": boresight, "self_calibrate": self_calibrate,
        "gate": "none" if gate is None else gate, "features": features_of(flow),
        "timestamps": getattr(sequence, "times_source", None),
    }  # fmt: skip
    run.records = run_records(sequence, estimated, truth, motions, chosen, flow, seed, keys, seconds)
    unsolved = np.array([False, *(not motion.solved for motion in motions)])
    save_figures(run, estimated, truth, unsolved, estimator, flow, metric=scale != "none")
    (outside,) = select(run.records, metric="outside_fraction")
    if skip_bad_frames:
        run.records.append(skipped_record(run.records[0], skipped))
    if message := disagreement_warning(sequence.name, sequence.frames[1:], agreements):
        run.warn(message)
    for bad in skipped:
        run.warn(f"{sequence.name}: frame {bad.frame} skipped: {bad.reason}")
    if message := outside_warning(outside.value or 0.0, sequence.name):
        run.warn(message)
    if predicted := sum(motion.predicted for motion in motions):
        run.warn(
            f"{sequence.name}: {predicted} of {len(motions)} frames could not be solved and were predicted "
            "from the motions before them; frames.csv says which and why"
        )
    finish(run)
    return run


def choose(
    estimator: str, model: Path | None, method: str | None, gate: float | None
) -> tuple[FlowMethod, Estimator]:
    """Flow method and estimator of command-line options."""
    if estimator not in ESTIMATORS:
        raise DataError(f"unknown estimator {estimator!r}: known are {', '.join(ESTIMATORS)}")
    if gate is not None and not 0 <= gate < np.inf:
        raise DataError(f"--gate must be a texture of at least 0, not {gate}")
    if model is None:
        if estimator != "ransac":
            raise DataError(
                f"--estimator {estimator} needs --model: a shipped model's name (`flowlik models`) or a file "
                "that `flowlik calibrate` makes"
            )
        return flow_method(method or "lucas-kanade"), ransac(gate=gate)
    likelihood = load_likelihood(model)
    flow = confirmed_method(likelihood.method or {}, method)
    if estimator == "ransac":
        return flow, ransac(gate=gate)
    return flow, (lcmsac if estimator == "lcmsac" else mle)(likelihood, gate=gate)


def _residual_kind(sequence: ImageSequence, asked: str | None) -> ResidualKind:
    if asked not in (None, "depth", "epipolar"):
        raise DataError(f"unknown residual {asked!r}: known are depth, epipolar")
    if asked is not None:
        return cast(ResidualKind, asked)
    try:
        sequence.depth(0)
    except MissingFieldError:
        return "epipolar"
    return "depth"
