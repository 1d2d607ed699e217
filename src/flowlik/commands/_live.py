"""`flowlik odometry` of a camera while it films."""

from __future__ import annotations

import signal
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import fields
from pathlib import Path

import numpy as np

from flowlik.commands._odometry import estimator_of, flow_of, write_files
from flowlik.commands._odometry_results import Flown, report_odometry
from flowlik.commands.options import OdometryOptions
from flowlik.datasets import masked, resized, without_distortion
from flowlik.datasets.base import ImageSequence, mask_of
from flowlik.datasets.live import Live
from flowlik.egomotion import EgoMotion
from flowlik.errors import DataError
from flowlik.flow import describe
from flowlik.odometry.adaptation import adapting
from flowlik.odometry.odometry import Odometry
from flowlik.odometry.scale import scale_source
from flowlik.odometry.self_calibration import SelfCalibration
from flowlik.report import finish
from flowlik.results.runs import RunFolder

FLAGS = {"frames_per_second": "fps", "record": "save-rerun"}
RECORDED = (
    "format", "truth", "start", "stride", "parallax", "frames_per_second", "topic", "depth_topic",
    "skip_bad_frames", "boresight", "view", "record", "flow_png",
)  # fmt: skip
"""Options that a recording can have and a camera that films cannot."""
EVERY_S = 1.0


def live_odometry(
    address: str,
    out: Path,
    options: OdometryOptions,
    *,
    command: str = "flowlik odometry",
    tell: Callable[[str], object] = lambda line: None,
) -> RunFolder:
    """Estimate the trajectory of a camera while it films, until it ends, so many frames, or an interrupt.

    Parameters
    ----------
    address : str
        As `flowlik.datasets.live.live_address` gives it.
    out : Path
        Run folder, as of `flowlik.commands.odometry`; written at the end.
    options : OdometryOptions
        How. The camera must be given; there is no depth, and no truth.
    command : str
        Command line that says how the run was made.
    tell : callable
        Is given a line a second: how far, how fast, what the last frame's motion is.

    Raises
    ------
    DataError
        If an option does not fit a camera that films, it cannot be read, or no motion could be solved.
    ModelError
        If there is no such model or method.
    """
    _check(options)
    flow, estimator = flow_of(options), estimator_of(options)
    with Live(address, options.camera) as camera:
        sequence = resized(masked(without_distortion(camera), options.mask), options.resize)
        source = scale_source(options.scale, sequence, options.camera_height_m)
        settings = SelfCalibration() if options.self_calibrate else None
        robot = Odometry(sequence.camera, flow, estimator, options.seed, source, settings)
        recorded = {"data": address, **options.asdict(), "residual": "epipolar", "flow": describe(flow)}
        run = RunFolder(out, command, recorded, options.seed)
        run.begin()
        begin = time.perf_counter()
        with _interrupted() as stopped:
            steps = _steps(sequence, camera, robot, options.frames, stopped)
            if options.adapt:
                steps = adapting(steps, robot)
            motions = list(_told(steps, robot, camera, tell))
        seconds = time.perf_counter() - begin
    if all(motion.predicted for motion in motions):
        reason = motions[0].reason if motions else "there is only one image"
        raise DataError(f"{camera.name}: no frame could be solved ({reason})")
    run.warn(f"{camera.name}: {camera.dropped} images came while another was worked on, and were left out")
    flown = Flown(sequence, np.arange(len(camera)), robot, None, motions, [], seconds)
    write_files(run.begin(), flown, options)
    report_odometry(run, flown, options, [], doubted=False)
    finish(run)
    return run


def _check(options: OdometryOptions) -> None:
    usual = OdometryOptions()
    for field in fields(options):
        if field.name in RECORDED and getattr(options, field.name) != getattr(usual, field.name):
            name = FLAGS.get(field.name, field.name.replace("_", "-"))
            raise DataError(f"--{name} is for recordings: a camera that films has none")
    if options.camera is None:
        raise DataError("a live camera needs --camera: f,cx,cy or fx,fy,cx,cy in pixels, or a camera file")
    if options.residual == "depth":
        raise DataError("a live camera has no depth: leave --residual out")
    if options.scale not in ("none", "camera-height"):
        raise DataError(f"--scale {options.scale} is for recordings: a live camera takes camera-height")


def _steps(
    sequence: ImageSequence, camera: Live, robot: Odometry, frames: int | None, stopped: threading.Event
) -> Iterator[EgoMotion]:
    k = 0
    while True:
        motion = robot.step(sequence.image(k), sequence.timestamp(k), usable=mask_of(sequence, k))
        if k:
            yield motion
        k += 1
        if stopped.is_set() or k == frames or not camera.more():
            return


def _told(
    steps: Iterator[EgoMotion], robot: Odometry, camera: Live, tell: Callable[[str], object]
) -> Iterator[EgoMotion]:
    last, count = time.monotonic(), 0
    for motion in steps:
        yield motion
        count += 1
        if (now := time.monotonic()) - last >= EVERY_S:
            turn = np.rad2deg(np.linalg.norm(motion.T_k_prev.rotation.as_rotvec()))
            place = " ".join(f"{x:.2f}" for x in robot.poses[-1].translation)
            tell(
                f"frame {len(camera)}: {count / (now - last):.0f} frames/s, {motion.status.value}, "
                f"turned {turn:.2f} deg, at {place}"
            )
            last, count = now, 0


@contextmanager
def _interrupted() -> Iterator[threading.Event]:
    """An event that an interrupt from the keyboard sets, in place of ending the run without its files."""
    stopped = threading.Event()
    if threading.current_thread() is not threading.main_thread():
        yield stopped
        return
    before = signal.signal(signal.SIGINT, lambda *_: stopped.set())
    try:
        yield stopped
    finally:
        signal.signal(signal.SIGINT, before)
