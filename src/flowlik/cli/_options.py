"""Options that several commands share, and what they print at the end."""

from __future__ import annotations

import json
import shlex
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from flowlik.cli import _complete as complete

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rich.console import Console

    from flowlik.results.records import Record
    from flowlik.results.runs import RunFolder

Out = Annotated[Path, typer.Option("--out", "-o", help="Folder of the run: report, figures, metrics.")]
Model = Annotated[
    Path | None,
    typer.Option(
        "--model",
        "-m",
        help="A shipped model's name, or a file made by `flowlik calibrate`.",
        autocompletion=complete.models,
    ),
]
ModelUnlessRansac = Annotated[
    Path | None,
    typer.Option(
        "--model",
        "-m",
        help="A shipped model's name, or a file made by `flowlik calibrate`; ransac needs none.",
        autocompletion=complete.models,
    ),
]
METHOD_HELP = (
    "Flow: farneback, farneback-wide, lucas-kanade, lucas-kanade-11 (with -opencv, as the paper's), dis, "
    "horn-schunck; your own as package.module:object; a network as onnx:FILE; or on disk as "
    "flow-files:LABEL=FOLDER."
)
Method = Annotated[
    str | None,
    typer.Option("--method", help=METHOD_HELP, autocompletion=complete.one_of(complete.METHODS)),
]
FlowPng = Annotated[
    str | None,
    typer.Option(
        "--flow-png",
        help="What flow PNGs hold, where they do not tell: kitti, dsec, tartanair or virtual-kitti.",
        autocompletion=complete.one_of(complete.FLOW_PNGS),
    ),
]
Format = Annotated[
    str | None,
    typer.Option(
        "--format",
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
        help="f,cx,cy or fx,fy,cx,cy [px], or a camera file (ROS, OpenCV, Kalibr, ORB-SLAM, COLMAP, KITTI, "
        "…; FILE:NAME of several), whose distortion is removed from the images; for data without a camera.",
    ),
]
Mask = Annotated[
    Path | None,
    typer.Option("--mask", help="Image of the size of the images as they are: white where pixels are used."),
]
Resize = Annotated[
    str | None,
    typer.Option("--resize", help="WIDTHxHEIGHT [px] or a factor: images are scaled, and the camera too."),
]
Topic = Annotated[
    str | None, typer.Option("--topic", help="Topic of the images of a ROS bag; needed where it has several.")
]
DepthTopic = Annotated[
    str | None,
    typer.Option("--depth-topic", help="Topic of depth images of a ROS bag, registered to the images."),
]
FrameRate = Annotated[
    float | None,
    typer.Option(
        "--fps", help="Frame rate [Hz] of images without times; of a video, instead of its own times."
    ),
]
View = Annotated[bool, typer.Option("--view", help="Show it live in the rerun viewer (extra `viz`).")]
Recording = Annotated[
    bool, typer.Option("--record", help="Record it for the rerun viewer, as view.rrd (extra `viz`).")
]
SkipBadFrames = Annotated[
    bool, typer.Option("--skip-bad-frames", help="Go on over frames missing or unreadable; report them.")
]
Seed = Annotated[int, typer.Option("--seed", min=0, help="Seed of everything random.")]
Json = Annotated[bool, typer.Option("--json", help="Print the metrics as JSON on standard output.")]

Executor = Annotated[
    str,
    typer.Option(
        "--executor",
        help="Where to measure: serial, processes, or dask (extra `cluster`).",
        autocompletion=complete.one_of(complete.EXECUTORS),
    ),
]
Workers = Annotated[
    int | None, typer.Option("--workers", min=1, help="Processes on this machine; one a core by default.")
]
Scheduler = Annotated[
    str | None, typer.Option("--scheduler", help="Address of a Dask scheduler; by default a local cluster.")
]
KeepSketches = Annotated[
    bool,
    typer.Option("--keep-sketches", help="Leave the sketches in the run's folder, for a repeated run."),
]


def command_line() -> str:
    """Return the command as it was typed."""
    return shlex.join(["flowlik", *sys.argv[1:]])


SUMMARY = (
    "drift_percent", "t_err_percent", "rpe_trans_median_m", "rpe_rot_median_deg", "unsolved_fraction", "nll",
    "ks_median", "coverage_90", "ause_relative", "outside_fraction", "frames_per_second", "pairs_per_second",
)  # fmt: skip
"""Figures of a summary, where there are too many to print them all."""

MOST_ROWS = 24


def show_run(run: RunFolder, as_json: bool) -> None:
    """Print a run's records, its warnings and where its report is."""
    for warning in run.warnings:
        typer.echo(f"warning: {warning}", err=True)
    show_records(run.records, as_json)
    for model in sorted((run.path / "models").glob("*.json")):
        typer.echo(f"model: {model}", err=True)
    typer.echo(f"report: {run.path / 'report.html'}", err=True)


def console(highlight: bool = True) -> Console:
    """Standard output for tables: as wide as the terminal, or 140 columns in a pipe."""
    from rich.console import Console

    return Console(width=None if sys.stdout.isatty() else 140, highlight=highlight)


def show_records(records: Sequence[Record], as_json: bool) -> None:
    """Print records as JSON, or as a table with units: the main ones, where there are many."""
    if as_json:
        from dataclasses import asdict

        typer.echo(json.dumps([asdict(record) for record in records], indent=1, ensure_ascii=False))
        return
    from rich.table import Table

    main = [r for r in records if r.metric in SUMMARY]
    if len(records) > MOST_ROWS and main:
        typer.echo(f"{len(main)} of {len(records)} figures; metrics.json and the report hold all", err=True)
        records = main
    columns = ("dataset", "flow", "family", "schedule", "estimator", "metric", "value", "unit")
    table = Table(*columns, box=None, pad_edge=False)
    for r in records:
        value = "–" if r.value is None else f"{r.value:.5g}"
        table.add_row(r.dataset, r.flow, r.family, r.schedule, r.estimator, r.metric, value, r.unit)
    console().print(table)
    for why in dict.fromkeys(f"{r.metric}: {r.reason}" for r in records if r.value is None):
        typer.echo(why)
