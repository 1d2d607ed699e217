"""`flowlik odometry`."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Annotated

import typer

from flowlik.cli import _complete as complete
from flowlik.cli._options import (
    ADVANCED,
    CAMERA,
    INPUT,
    MODEL,
    OUTPUT,
    SCALE,
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
    Recording,
    Resize,
    Seed,
    SkipBadFrames,
    Start,
    Stride,
    Topic,
    TruePoses,
    Verbose,
    View,
    command_line,
)
from flowlik.cli._printing import show_run
from flowlik.commands.options import OdometryOptions


def run(
    data: Annotated[Path, typer.Argument(help="Folder of a sequence, a video file or a ROS bag.")],
    out: Out,
    model: ModelUnlessRansac = None,
    method: Method = None,
    flow_png: FlowPng = None,
    estimator: EstimatorName = OdometryOptions.estimator,
    residual: Annotated[
        str | None,
        typer.Option(
            rich_help_panel=MODEL,
            help="depth or epipolar; depth if the data has it.",
            autocompletion=complete.one_of(complete.RESIDUALS),
        ),
    ] = None,
    scale: Annotated[
        str,
        typer.Option(
            rich_help_panel=SCALE,
            help="Without depth: none, truth-norm, gps-norm, camera-height or stereo.",
            autocompletion=complete.one_of(complete.SCALES),
        ),
    ] = OdometryOptions.scale,
    camera_height_m: Annotated[
        float | None,
        typer.Option(
            "--camera-height",
            rich_help_panel=SCALE,
            help="Height of the camera over the road [m]: --scale camera-height needs it.",
        ),
    ] = None,
    self_calibrate: Annotated[
        bool,
        typer.Option(
            "--self-calibrate", rich_help_panel=CAMERA, help="Refine the camera's intrinsics from the images."
        ),
    ] = False,
    adapt: Annotated[
        bool,
        typer.Option(
            "--adapt",
            rich_help_panel=MODEL,
            help="Let the model follow the drive's own errors, slowly, by past frames alone.",
        ),
    ] = False,
    boresight: Annotated[
        str,
        typer.Option(
            rich_help_panel=ADVANCED, help="none, or causal: turn motions into the frame of the true poses."
        ),
    ] = OdometryOptions.boresight,
    gate: Annotated[
        float | None,
        typer.Option(
            "--min-texture",
            rich_help_panel=ADVANCED,
            help="Leave out components of less texture [intensity²/px²].",
        ),
    ] = None,
    truth: TruePoses = None,
    frames: Frames = None,
    start: Start = 0,
    stride: Stride = OdometryOptions.stride,
    parallax: Annotated[
        float | None,
        typer.Option(
            rich_help_panel=INPUT,
            help="Leave frames out until the median flow since the last one exceeds this [px].",
        ),
    ] = None,
    skip_bad_frames: SkipBadFrames = False,
    format: Format = None,
    camera: Camera = None,
    mask: Mask = None,
    resize: Resize = None,
    frames_per_second: FrameRate = None,
    topic: Topic = None,
    depth_topic: DepthTopic = None,
    bag: Annotated[
        bool,
        typer.Option(
            "--save-bag",
            rich_help_panel=OUTPUT,
            help="Also write nav_msgs/Odometry as a ROS 2 bag (extra `ros`).",
        ),
    ] = False,
    bag_unscaled: Annotated[
        bool,
        typer.Option(
            "--save-bag-unscaled",
            rich_help_panel=OUTPUT,
            help="With --save-bag, write positions though they have no scale: steps of length 1.",
        ),
    ] = False,
    view: View = False,
    record: Recording = False,
    seed: Seed = 0,
    verbose: Verbose = False,
    json: Json = False,
) -> None:
    """Estimate the camera's trajectory, and its errors where the data set has poses.

    Examples
    --------
    `flowlik odometry 03 --model run/models/lucas-kanade.json --scale truth-norm --out k03`

    `flowlik odometry walk.mp4 --camera 900,640,360 --model lucas-kanade --out walk`

    `flowlik odometry /dev/video0 --camera 900,640,360 --model lucas-kanade --out walk`

    `flowlik odometry drive.mcap --topic /camera/image_raw --model lucas-kanade --save-bag --out drive`
    """
    from flowlik.commands import live_odometry, odometry
    from flowlik.datasets.live import live_address
    from flowlik.support.progress import terminal_progress

    options = OdometryOptions(
        model=model,
        method=method,
        flow_png=flow_png,
        estimator=estimator,
        residual=residual,
        scale=scale,
        camera_height_m=camera_height_m,
        self_calibrate=self_calibrate,
        adapt=adapt,
        boresight=boresight,
        gate=gate,
        truth=truth,
        frames=frames,
        start=start,
        stride=stride,
        parallax=parallax,
        skip_bad_frames=skip_bad_frames,
        format=format,
        camera=camera,
        mask=mask,
        resize=resize,
        frames_per_second=frames_per_second,
        topic=topic,
        depth_topic=depth_topic,
        bag=bag,
        bag_unscaled=bag_unscaled,
        view=view,
        record=record,
        seed=seed,
    )
    if (address := live_address(data)) is not None:
        tell = partial(typer.echo, err=True)
        result = live_odometry(address, out, options, command=command_line(), tell=tell)
    else:
        result = odometry(data, out, options, command=command_line(), progress=terminal_progress)
    show_run(result, json, verbose)
    if (result.config["residual"], scale) == ("epipolar", "none"):
        typer.echo("no scale: each motion counts 1, so lengths have no unit; see --scale", err=True)
