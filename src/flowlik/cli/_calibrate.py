"""`flowlik calibrate`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from flowlik.cli import _complete as complete
from flowlik.cli._options import (
    METHOD_HELP,
    Camera,
    Executor,
    FlowPng,
    Format,
    Json,
    KeepSketches,
    Mask,
    Out,
    Resize,
    Scheduler,
    Seed,
    SkipBadFrames,
    Workers,
    command_line,
    show_run,
)
from flowlik.commands.options import CalibrateOptions


def run(
    data: Annotated[list[Path], typer.Argument(help="Folders of sequences with true flow.")],
    method: Annotated[str, typer.Option(help=METHOD_HELP, autocompletion=complete.one_of(complete.METHODS))],
    out: Out,
    family: Annotated[
        str,
        typer.Option(
            help="Family of the model: glc, lcm (the paper's), log-logistic, gaussian, ...",
            autocompletion=complete.one_of(complete.FAMILIES),
        ),
    ] = CalibrateOptions.family,
    schedule: Annotated[
        str,
        typer.Option(
            help="What its parameters depend on: index (learned), texture (the paper's), flow, constant.",
            autocompletion=complete.one_of(complete.SCHEDULES),
        ),
    ] = CalibrateOptions.schedule,
    flow_png: FlowPng = None,
    format: Format = None,
    camera: Camera = None,
    mask: Mask = None,
    resize: Resize = None,
    skip_bad_frames: SkipBadFrames = False,
    seed: Seed = 0,
    executor: Executor = CalibrateOptions.executor,
    workers: Workers = None,
    scheduler: Scheduler = None,
    keep_sketches: KeepSketches = False,
    json: Json = False,
) -> None:
    """Calibrate a flow method on data with truth: a model file and evidence of how well it fits.

    Example: `flowlik calibrate data --method lucas-kanade --out calibration`
    """
    from flowlik.commands import calibrate
    from flowlik.support.progress import terminal_progress

    options = CalibrateOptions(
        family=family,
        schedule=schedule,
        flow_png=flow_png,
        format=format,
        camera=camera,
        mask=mask,
        resize=resize,
        skip_bad_frames=skip_bad_frames,
        seed=seed,
        executor=executor,
        workers=workers,
        scheduler=scheduler,
        keep_sketches=keep_sketches,
    )
    run = calibrate(data, method, out, options, command=command_line(), progress=terminal_progress)
    show_run(run, json)
