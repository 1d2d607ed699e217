"""`flowlik fuse`: flow beside IMU and GPS."""

from __future__ import annotations

import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from flowlik.commands._fuse_clocks import report_clocks, told_clocks
from flowlik.commands._fuse_files import write_fusion
from flowlik.commands._fuse_flight import FusedFlight, in_one_frame
from flowlik.commands._fuse_inputs import Sensors, covered_frames, given_start, read_sensors
from flowlik.commands._fuse_monitor import Watched, watched
from flowlik.commands._fuse_motions import flow_factors, measured_options, read_motions
from flowlik.commands._fuse_results import report_fusion
from flowlik.commands._odometry import estimator_of, flow_of, opened_frames, residual_kind
from flowlik.commands.fuse_options import FuseOptions
from flowlik.datasets.selection import Selection, Skipped
from flowlik.egomotion import EgoMotion
from flowlik.errors import DataError
from flowlik.evaluation.motion import true_trajectory
from flowlik.flow import describe, method_label
from flowlik.flow.base import FlowMethod
from flowlik.fusion import DirectionFactor, Fused, FusedState, coarse_start, heading_sigma_rad
from flowlik.fusion import fuse as fuse_flight
from flowlik.odometry import FlowFactor, Odometry, run_odometry
from flowlik.report import finish
from flowlik.results.runs import RunFolder
from flowlik.support.arrays import Array
from flowlik.support.extras import extra
from flowlik.support.progress import Progress, no_progress

Factor = FlowFactor | DirectionFactor | None
MOST_HEADING_RAD = float(np.deg2rad(5.0))
"""Standard deviation of the heading beyond which an alignment has failed."""


def fuse(
    data: Path,
    out: Path,
    options: FuseOptions = FuseOptions(),
    *,
    command: str = "flowlik fuse",
    progress: Progress = no_progress,
) -> RunFolder:
    """Fuse the motions of a sequence with known depth with an IMU and, if given, GPS.

    Parameters
    ----------
    data : Path
        Folder of a sequence, or a ROS bag.
    out : Path
        Run folder: the camera's trajectory in TUM's format, its covariance as ``covariance.csv``, biases as
        ``biases.csv``, all states as ``states.npz``, and what GPS told as ``monitor.csv``.
    options : FuseOptions
        How.
    command : str
        Command line that repeats the run.
    progress : Progress
        Told how far it is.

    Raises
    ------
    DataError
        If options contradict one another or the data, something that no filter may guess is missing, or the
        start cannot be found.
    ModelError
        If there is no such model or method, or the model does not know how errors stay over time.
    MissingExtraError
        If GTSAM is not installed.
    """
    extra("gtsam", "flowlik fuse")
    options = measured_options(options)
    sensors = read_sensors(data, options)
    flow, estimator = flow_of(options.odometry), estimator_of(options.odometry)
    sequence, skipped, motions = _frames(data, options, flow, sensors, progress)
    kind = residual_kind(sequence, "depth" if options.motions is not None else options.residual)
    flow_factors([], estimator.likelihood, 1.0, options, kind)  # what cannot be is told before the work
    truth = true_trajectory(sequence, len(sequence))
    times_s = np.array([sequence.timestamp(k) for k in range(len(sequence))])
    start = given_start(options, sensors, float(times_s[0]), truth)
    run = RunFolder(
        out, command, {"data": str(data), **options.asdict(), "flow": describe(flow)}, options.seed
    )
    if motions is None:
        robot = Odometry(sequence.camera, flow, estimator, options.seed)
        steps = run_odometry(sequence, robot, kind)
        what = f"{options.estimator} on {sequence.name}, image pairs"
        motions = list(progress(steps, what, len(sequence) - 1))
    interval_s = float(np.median(np.diff(times_s)))
    factors = flow_factors(motions, estimator.likelihood, interval_s, options, kind)
    factors = _within_lag(factors, times_s, options.lag_s)
    begin = time.perf_counter()
    fused, seen = _smoothed(start, times_s, factors, sensors, options)
    seconds = time.perf_counter() - begin
    truth = in_one_frame(truth, sensors, found=options.initial is None)
    flight = FusedFlight(
        sequence,
        truth,
        sensors,
        motions,
        factors,
        fused,
        seen,
        seconds,
        method_label(describe(flow)),
        estimator,
    )
    write_fusion(run.begin(), flight)
    report_fusion(run, flight, options, skipped)
    report_clocks(run, told_clocks(times_s, motions, sensors), sensors)
    finish(run)
    return run


def _frames(
    data: Path, options: FuseOptions, flow: FlowMethod, sensors: Sensors, progress: Progress
) -> tuple[Selection, list[Skipped], list[EgoMotion] | None]:
    """Frames that the IMU covers, those that cannot be used, and their motions where a run has them."""
    if options.motions is None:
        sequence, skipped = opened_frames(data, options.odometry, flow, progress)
        motions = None
    else:
        whole = replace(options.odometry, frames=None, start=0, stride=1)
        opened, skipped = opened_frames(data, whole, flow, progress)
        sequence, motions = read_motions(options.motions, opened)
    times_s = np.array([sequence.timestamp(k) for k in range(len(sequence))])
    kept = np.flatnonzero(covered_frames(times_s, sensors.imu))
    if motions is not None:
        motions = motions[kept[0] : kept[-1]]
    if len(kept) < len(sequence):
        numbers = sequence.numbers
        dropped = (k for k in range(len(sequence)) if not kept[0] <= k <= kept[-1])
        skipped = [*skipped, *(Skipped(int(numbers[k]), "outside the IMU's time") for k in dropped)]
        sequence = Selection(sequence, kept.tolist())
    return sequence, skipped, motions


def _within_lag(factors: list[Factor], times_s: Array, lag_s: float) -> list[Factor]:
    """Factors without those over a pause that is longer than the smoother's lag."""
    return [factor if step <= lag_s else None for factor, step in zip(factors, np.diff(times_s))]


def _smoothed(
    start: FusedState | None,
    times_s: Array,
    factors: list[Factor],
    sensors: Sensors,
    options: FuseOptions,
) -> tuple[Fused, Watched]:
    """The flight from the start on, or from where it was found; with the answer to an alarm."""
    settings = sensors.settings
    if start is None:
        metric = [factor if isinstance(factor, FlowFactor) else None for factor in factors]
        start = coarse_start(times_s, metric, sensors.imu, sensors.fixes, settings, sensors.turn_on)
    whole = fuse_flight(start, times_s, factors, sensors.imu, sensors.fixes, settings)
    fused = whole.after(float(times_s[0]) + settings.alignment_s)
    if len(fused.states) < 2:
        raise DataError(
            f"the flight of {times_s[-1] - times_s[0]:.3g} s is over before its start is found: a shorter "
            f"--align than {settings.alignment_s:g} s, or the initial state by --initial"
        )
    if settings.alignment_s > 0:
        _check_alignment(fused.states[0], sensors)
    seen = watched(fused.innovations, options.false_alarms, options.seed)
    if seen.alarm is None or sensors.fixes is None:
        return fused, seen
    kept = seen.trusted(sensors.fixes)
    coasted = fuse_flight(start, times_s, factors, sensors.imu, kept, settings)
    return fused.then(coasted, seen.alarm.time_s), seen


def _check_alignment(state: FusedState, sensors: Sensors) -> None:
    sigma, seconds = heading_sigma_rad(state, sensors.settings), sensors.settings.alignment_s
    if sensors.fixes is not None and sigma > MOST_HEADING_RAD:
        raise DataError(
            f"the first {seconds:g} s tell the heading to {np.rad2deg(sigma):.0f} deg only: "
            "the camera must move far beside the fixes' errors; a longer --align, or the initial state by "
            "--initial"
        )
