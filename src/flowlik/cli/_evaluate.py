"""`flowlik evaluate`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from flowlik.cli._options import (
    Camera,
    Executor,
    FlowPng,
    Format,
    Json,
    KeepSketches,
    Mask,
    Method,
    Out,
    Resize,
    Scheduler,
    Seed,
    SkipBadFrames,
    Verbose,
    Workers,
    command_line,
)
from flowlik.cli._printing import show_run
from flowlik.commands.options import EvaluateOptions


def run(
    model: Annotated[Path, typer.Argument(help="A shipped model's name or a model file.")],
    data: Annotated[list[Path], typer.Argument(help="Folders of sequences with true flow.")],
    out: Out,
    format: Format = None,
    camera: Camera = None,
    mask: Mask = None,
    resize: Resize = None,
    skip_bad_frames: SkipBadFrames = False,
    method: Method = None,
    flow_png: FlowPng = None,
    seed: Seed = 0,
    executor: Executor = EvaluateOptions.executor,
    workers: Workers = None,
    scheduler: Scheduler = None,
    keep_sketches: KeepSketches = False,
    verbose: Verbose = False,
    json: Json = False,
) -> None:
    """Check whether a model tells the truth on other data: log score, K-S over texture, coverage.

    Example: `flowlik evaluate calibration/models/lucas-kanade.json other --out evaluation`
    """
    from flowlik.commands import evaluate
    from flowlik.support.progress import terminal_progress

    options = EvaluateOptions(
        method=method,
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
    show_run(
        evaluate(model, data, out, options, command=command_line(), progress=terminal_progress), json, verbose
    )
