"""`flowlik fuse`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from flowlik.cli import _complete as complete
from flowlik.cli._options import (
    ADVANCED,
    INPUT,
    MODEL,
    Camera,
    DepthTopic,
    EstimatorName,
    FlowPng,
    Format,
    FrameRate,
    Frames,
    Json,
    Mask,
    Method,
    ModelUnlessRansac,
    Out,
    Resize,
    Seed,
    SkipBadFrames,
    Start,
    Stride,
    Topic,
    TruePoses,
    Verbose,
    command_line,
)
from flowlik.cli._printing import show_run
from flowlik.commands.fuse_options import FuseOptions
from flowlik.errors import DataError

SENSORS, START = "IMU and GPS", "Start"


def run(
    data: Annotated[Path, typer.Argument(help="Folder of a sequence, best with depth, or a ROS bag.")],
    out: Out,
    imu: Annotated[
        Path | None,
        typer.Option(
            rich_help_panel=SENSORS,
            help="IMU: a folder in EuRoC's, TartanAir's or KITTI's layout, a ROS bag, or a .csv.",
        ),
    ] = None,
    imu_sensor: Annotated[
        Path | None,
        typer.Option(
            rich_help_panel=SENSORS,
            help="YAML with its noise densities, turn-on deviations and T_BS; by default imu0/sensor.yaml.",
        ),
    ] = None,
    imu_offset: Annotated[
        float,
        typer.Option(
            rich_help_panel=SENSORS,
            help="How late its stamps are by the camera's clock [s]; the report says what rotations tell.",
        ),
    ] = FuseOptions.imu_offset_s,
    imu_topic: Annotated[
        str | None, typer.Option(rich_help_panel=SENSORS, help="Topic of the IMU in a ROS bag.")
    ] = None,
    gps: Annotated[
        Path | None,
        typer.Option(rich_help_panel=SENSORS, help="GPS: a folder with gps0, a .csv, OXTS, or a ROS bag."),
    ] = None,
    gps_topic: Annotated[
        str | None, typer.Option(rich_help_panel=SENSORS, help="Topic of GPS in a ROS bag.")
    ] = None,
    gps_coloured: Annotated[
        str | None,
        typer.Option(
            rich_help_panel=SENSORS,
            help="SHARE,MEMORY: share of a fix's variance that stays, and for how long [s], such as 0.5,60.",
        ),
    ] = None,
    camera_pose: Annotated[
        str | None,
        typer.Option(
            rich_help_panel=SENSORS,
            help="YAML with the camera's T_BS, or `body` where the IMU's T_BS is relative to the camera.",
        ),
    ] = None,
    antenna: Annotated[
        str | None,
        typer.Option(
            rich_help_panel=SENSORS, help="X,Y,Z of the antenna [m] in {B}; by default of gps0/sensor.yaml."
        ),
    ] = None,
    up: Annotated[
        str | None,
        typer.Option(
            rich_help_panel=SENSORS,
            help="Axis of the world that points up: -y by default, z where GPS tells latitude and longitude.",
        ),
    ] = None,
    initial: Annotated[
        str | None,
        typer.Option(
            rich_help_panel=START,
            help="YAML with T_n_b, velocity_n_mps and deviations; or `truth`. By default it is found.",
        ),
    ] = None,
    align: Annotated[
        float,
        typer.Option(rich_help_panel=START, help="First seconds from which the start is found; left out."),
    ] = FuseOptions.align_s,
    residual: Annotated[
        str | None,
        typer.Option(
            rich_help_panel=MODEL,
            help="depth or epipolar (directions alone); depth if the data has it.",
            autocompletion=complete.one_of(complete.RESIDUALS),
        ),
    ] = None,
    form: Annotated[
        str, typer.Option(rich_help_panel=ADVANCED, help="Flow factors: given-rotation, or full.")
    ] = FuseOptions.form,
    long_run_factor: Annotated[
        float | None,
        typer.Option(
            rich_help_panel=ADVANCED,
            help="By which a motion's covariance grows for a filter, for a model that does not know.",
        ),
    ] = None,
    lag: Annotated[
        float, typer.Option(rich_help_panel=ADVANCED, help="Lag of the smoother [s].")
    ] = FuseOptions.lag_s,
    false_alarms: Annotated[
        float,
        typer.Option(
            rich_help_panel=ADVANCED, help="False alarms an hour that the monitor of GPS may raise."
        ),
    ] = FuseOptions.false_alarms,
    motions: Annotated[
        Path | None,
        typer.Option(
            rich_help_panel=INPUT, help="Run of `flowlik odometry` on the same data: its motions are used."
        ),
    ] = None,
    model: ModelUnlessRansac = None,
    method: Method = None,
    flow_png: FlowPng = None,
    estimator: EstimatorName = FuseOptions.estimator,
    truth: TruePoses = None,
    frames: Frames = None,
    start: Start = 0,
    stride: Stride = FuseOptions.stride,
    skip_bad_frames: SkipBadFrames = False,
    format: Format = None,
    camera: Camera = None,
    mask: Mask = None,
    resize: Resize = None,
    frames_per_second: FrameRate = None,
    topic: Topic = None,
    depth_topic: DepthTopic = None,
    seed: Seed = 0,
    verbose: Verbose = False,
    json: Json = False,
) -> None:
    """Fuse a camera's motion with an IMU and GPS, and watch whether GPS agrees.

    Examples
    --------
    `flowlik simulate forest --imu adis16448 --gps white --frames 1800 --out flight`

    `flowlik fuse flight --model lucas-kanade --imu flight --gps flight --camera-pose body --out run`
    """
    from flowlik.commands import fuse
    from flowlik.support.progress import terminal_progress

    options = FuseOptions(
        imu=imu,
        imu_sensor=imu_sensor,
        imu_offset_s=imu_offset,
        imu_topic=imu_topic,
        gps=gps,
        gps_topic=gps_topic,
        gps_coloured=_numbers(gps_coloured, 2, "--gps-coloured"),
        camera_pose=camera_pose,
        antenna_m=_numbers(antenna, 3, "--antenna"),
        up=up,
        initial=initial,
        align_s=align,
        residual=residual,
        form=form,
        long_run_factor=long_run_factor,
        lag_s=lag,
        false_alarms=false_alarms,
        motions=motions,
        model=model,
        method=method,
        flow_png=flow_png,
        estimator=estimator,
        truth=truth,
        frames=frames,
        start=start,
        stride=stride,
        skip_bad_frames=skip_bad_frames,
        format=format,
        camera=camera,
        mask=mask,
        resize=resize,
        frames_per_second=frames_per_second,
        topic=topic,
        depth_topic=depth_topic,
        seed=seed,
    )
    result = fuse(data, out, options, command=command_line(), progress=terminal_progress)
    show_run(result, json, verbose)


def _numbers(text: str | None, count: int, option: str) -> tuple[float, ...] | None:
    if text is None:
        return None
    try:
        values = tuple(float(word) for word in text.split(","))
    except ValueError:
        values = ()
    if len(values) != count:
        raise DataError(f"{option} {text!r}: expected {count} numbers with commas between")
    return values
