"""Options that several commands share, in groups."""

from __future__ import annotations

import shlex
import sys
from pathlib import Path
from typing import Annotated

import typer

from flowlik.cli import _complete as complete

INPUT, CAMERA, MODEL, SCALE, OUTPUT, ADVANCED = "Input", "Camera", "Model", "Scale", "Output", "Advanced"
TRUTHLESS = "Without true flow"
STANDARD = "On the standard flights"
"""Groups of options in the help."""

Out = Annotated[
    Path,
    typer.Option("--out", "-o", rich_help_panel=OUTPUT, help="Folder of the run: report, figures, metrics."),
]
Model = Annotated[
    Path | None,
    typer.Option(
        "--model",
        "-m",
        rich_help_panel=MODEL,
        help="A shipped model's name, or a file made by `flowlik calibrate`.",
        autocompletion=complete.models,
    ),
]
ModelUnlessRansac = Annotated[
    Path | None,
    typer.Option(
        "--model",
        "-m",
        rich_help_panel=MODEL,
        help="A shipped model's name, or a file made by `flowlik calibrate`; ransac needs none.",
        autocompletion=complete.models,
    ),
]
METHOD_HELP = (
    "Flow: farneback, farneback-wide, lucas-kanade, lucas-kanade-11 (with -opencv, as the paper's), dis, "
    "horn-schunck; your own as package.module:object; a network as onnx:FILE; or on disk as "
    "flow-files:LABEL=FOLDER."
)
EstimatorName = Annotated[
    str,
    typer.Option(
        "--estimator",
        rich_help_panel=MODEL,
        help="lcmsac, mle or ransac.",
        autocompletion=complete.one_of(complete.ESTIMATORS),
    ),
]
TruePoses = Annotated[
    Path | None,
    typer.Option(
        "--truth",
        rich_help_panel=INPUT,
        help="File of true poses (TUM, KITTI, EuRoC's csv), instead of the data's own.",
    ),
]
Frames = Annotated[
    int | None,
    typer.Option("--frames", min=2, rich_help_panel=INPUT, help="Only so many frames from the first."),
]
Start = Annotated[int, typer.Option("--start", min=0, rich_help_panel=INPUT, help="First frame.")]
Stride = Annotated[
    int, typer.Option("--stride", min=1, rich_help_panel=INPUT, help="Only every so many-th frame.")
]
Method = Annotated[
    str | None,
    typer.Option(
        "--method",
        rich_help_panel=MODEL,
        help=METHOD_HELP,
        autocompletion=complete.one_of(complete.METHODS),
    ),
]
FlowPng = Annotated[
    str | None,
    typer.Option(
        "--flow-png",
        rich_help_panel=INPUT,
        help="What flow PNGs hold, where they do not tell: kitti, dsec, tartanair or virtual-kitti.",
        autocompletion=complete.one_of(complete.FLOW_PNGS),
    ),
]
Format = Annotated[
    str | None,
    typer.Option(
        "--format",
        rich_help_panel=INPUT,
        help="Data format, guessed by default: kitti, kitti-raw, kitti-flow, tartanair, sintel, "
        "middlebury-flow, middlebury-stereo, flying-chairs, seven-scenes, tum-rgbd, euroc, "
        "ros, image-folder or video.",
        autocompletion=complete.one_of(complete.FORMATS),
    ),
]
Camera = Annotated[
    str | None,
    typer.Option(
        "--camera",
        rich_help_panel=CAMERA,
        help="f,cx,cy or fx,fy,cx,cy [px], or a camera file (ROS, OpenCV, Kalibr, ORB-SLAM, COLMAP, KITTI, "
        "…; FILE:NAME of several), whose distortion is removed from the images; for data without a camera.",
    ),
]
Mask = Annotated[
    Path | None,
    typer.Option(
        "--mask",
        rich_help_panel=CAMERA,
        help="Image of the size of the images as they are: white where pixels are used.",
    ),
]
Resize = Annotated[
    str | None,
    typer.Option(
        "--resize",
        rich_help_panel=CAMERA,
        help="WIDTHxHEIGHT [px] or a factor: images are scaled, and the camera too.",
    ),
]
Topic = Annotated[
    str | None,
    typer.Option(
        "--topic",
        rich_help_panel=INPUT,
        help="Topic of the images of a ROS bag; needed where it has several.",
    ),
]
DepthTopic = Annotated[
    str | None,
    typer.Option(
        "--depth-topic",
        rich_help_panel=INPUT,
        help="Topic of depth images of a ROS bag, registered to the images.",
    ),
]
FrameRate = Annotated[
    float | None,
    typer.Option(
        "--fps",
        rich_help_panel=INPUT,
        help="Frame rate [Hz] of images without times; of a video, instead of its own times.",
    ),
]
View = Annotated[
    bool,
    typer.Option("--view", rich_help_panel=OUTPUT, help="Show it live in the rerun viewer (extra `viz`)."),
]
Recording = Annotated[
    bool,
    typer.Option(
        "--save-rerun",
        rich_help_panel=OUTPUT,
        help="Save it for the rerun viewer, as view.rrd (extra `viz`).",
    ),
]
SkipBadFrames = Annotated[
    bool,
    typer.Option(
        "--skip-bad-frames",
        rich_help_panel=INPUT,
        help="Go on over frames missing or unreadable; report them.",
    ),
]
Seed = Annotated[
    int, typer.Option("--seed", min=0, rich_help_panel=ADVANCED, help="Seed of everything random.")
]
Json = Annotated[
    bool,
    typer.Option("--json", rich_help_panel=OUTPUT, help="Print the records, and nothing else, as JSON."),
]
Verbose = Annotated[
    bool, typer.Option("--verbose", "-v", rich_help_panel=OUTPUT, help="Print every figure, as a table.")
]

Executor = Annotated[
    str,
    typer.Option(
        "--executor",
        rich_help_panel=ADVANCED,
        help="Where to measure: serial, processes, or dask (extra `cluster`).",
        autocompletion=complete.one_of(complete.EXECUTORS),
    ),
]
Workers = Annotated[
    int | None,
    typer.Option(
        "--workers",
        min=1,
        rich_help_panel=ADVANCED,
        help="Processes on this machine; one a core by default.",
    ),
]
Scheduler = Annotated[
    str | None,
    typer.Option(
        "--scheduler",
        rich_help_panel=ADVANCED,
        help="Address of a Dask scheduler; by default a local cluster.",
    ),
]
KeepSketches = Annotated[
    bool,
    typer.Option(
        "--keep-sketches",
        rich_help_panel=ADVANCED,
        help="Leave the sketches in the run's folder, for a repeated run.",
    ),
]


def command_line() -> str:
    """Return the command as it was typed."""
    return shlex.join(["flowlik", *sys.argv[1:]])
