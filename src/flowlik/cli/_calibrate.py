"""`flowlik calibrate`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from flowlik.cli import _complete as complete
from flowlik.cli._options import (
    METHOD_HELP,
    MODEL,
    STANDARD,
    TRUTHLESS,
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
    Verbose,
    Workers,
    command_line,
)
from flowlik.cli._printing import show_run
from flowlik.commands.options import CalibrateOptions, TruthlessOptions


def run(
    method: Annotated[
        str,
        typer.Option(
            rich_help_panel=MODEL, help=METHOD_HELP, autocompletion=complete.one_of(complete.METHODS)
        ),
    ],
    out: Out,
    data: Annotated[
        list[Path] | None,
        typer.Argument(help="Folders of sequences, with or without true flow; none with --standard."),
    ] = None,
    family: Annotated[
        str,
        typer.Option(
            rich_help_panel=MODEL,
            help="Family of the model: glc, lcm (the paper's), log-logistic, gaussian, ...",
            autocompletion=complete.one_of(complete.FAMILIES),
        ),
    ] = CalibrateOptions.family,
    schedule: Annotated[
        str,
        typer.Option(
            rich_help_panel=MODEL,
            help="What its parameters depend on: index (learned), texture (the paper's), flow, constant.",
            autocompletion=complete.one_of(complete.SCHEDULES),
        ),
    ] = CalibrateOptions.schedule,
    standard: Annotated[
        bool,
        typer.Option(
            "--standard",
            rich_help_panel=STANDARD,
            help="Calibrate on the standard flights, as shipped models were.",
        ),
    ] = CalibrateOptions.standard,
    share: Annotated[
        float,
        typer.Option(
            "--share", rich_help_panel=STANDARD, help="Share of each standard flight, above 0 and up to 1."
        ),
    ] = CalibrateOptions.share,
    cache: Annotated[
        Path | None,
        typer.Option(
            "--cache",
            rich_help_panel=STANDARD,
            help="Folder of the standard flights, rendered once (default: your cache).",
        ),
    ] = None,
    kitti_poses: Annotated[
        Path | None,
        typer.Option(
            "--kitti-poses",
            rich_help_panel=STANDARD,
            help="Folder of KITTI's poses: routes of standard flights on roads.",
        ),
    ] = None,
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
    without_truth: Annotated[
        bool,
        typer.Option(
            "--without-truth",
            rich_help_panel=TRUTHLESS,
            help="Take errors against the sequences' own motions.",
        ),
    ] = False,
    residual: Annotated[
        str | None,
        typer.Option(
            rich_help_panel=TRUTHLESS,
            help="Without truth: depth (both components) or epipolar; depth if the data has it.",
            autocompletion=complete.one_of(complete.RESIDUALS),
        ),
    ] = TruthlessOptions.residual,
    model: Annotated[
        Path | None,
        typer.Option(
            "--model",
            "-m",
            rich_help_panel=TRUTHLESS,
            help="Without truth: model to begin with, instead of the one that ships for the method.",
            autocompletion=complete.models,
        ),
    ] = TruthlessOptions.model,
    self_calibrate: Annotated[
        bool,
        typer.Option(
            "--self-calibrate",
            rich_help_panel=TRUTHLESS,
            help="Without truth: refine the camera from its images first.",
        ),
    ] = TruthlessOptions.self_calibrate,
    pairs: Annotated[
        int,
        typer.Option(
            min=1,
            rich_help_panel=TRUTHLESS,
            help="Without truth: image pairs, evenly spread over the data.",
        ),
    ] = TruthlessOptions.pairs,
    verbose: Verbose = False,
    json: Json = False,
) -> None:
    """Calibrate a flow method: a model file and evidence of how well it fits.

    Without true flow a sequence's own motions tell, once they are estimated: `--without-truth`. Without data,
    the standard flights: `--standard`.

    Examples: `flowlik calibrate data --method lucas-kanade --out calibration`,
    `flowlik calibrate --standard --method onnx:net.onnx --share 0.2 --out calibration`,
    `flowlik calibrate drive --without-truth --method lucas-kanade-11 --out own`
    """
    from flowlik.commands import calibrate, calibrate_without_truth
    from flowlik.commands.standard_flights import rendering_cost
    from flowlik.support.progress import terminal_progress

    truthless = TruthlessOptions(
        residual=residual,
        model=model,
        self_calibrate=self_calibrate,
        pairs=pairs,
        family=family,
        seed=seed,
        flow_png=flow_png,
        format=format,
        camera=camera,
        mask=mask,
        resize=resize,
        skip_bad_frames=skip_bad_frames,
    )
    with_truth = {
        "standard": standard,
        "share": share,
        "cache": cache,
        "kitti_poses": kitti_poses,
        "schedule": schedule,
        "executor": executor,
        "workers": workers,
        "scheduler": scheduler,
        "keep_sketches": keep_sketches,
    }
    _check_together(data, without_truth, truthless, with_truth)
    if without_truth:
        run = calibrate_without_truth(
            data or [], method, out, truthless, command=command_line(), progress=terminal_progress
        )
        show_run(run, json, verbose)
        return
    options = CalibrateOptions(
        family=family,
        schedule=schedule,
        standard=standard,
        share=share,
        cache=cache,
        kitti_poses=kitti_poses,
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
    if cost := rendering_cost(data or [], options):
        typer.echo(cost, err=True)
    run = calibrate(data or [], method, out, options, command=command_line(), progress=terminal_progress)
    show_run(run, json, verbose)


def _check_together(
    data: list[Path] | None, without_truth: bool, truthless: TruthlessOptions, with_truth: dict[str, Any]
) -> None:
    """Refuse options that the way asked for would ignore, and no data where there must be some."""
    from flowlik.errors import DataError

    if without_truth and not data:
        raise DataError("--without-truth needs folders of data")
    if without_truth:
        ignored = [name for name, value in with_truth.items() if value != getattr(CalibrateOptions, name)]
        why = "needs true flow: leave it out, or leave out --without-truth"
    else:
        names = ("residual", "model", "self_calibrate", "pairs")
        ignored = [name for name in names if getattr(truthless, name) != getattr(TruthlessOptions, name)]
        why = "says how to calibrate without truth: give --without-truth too"
    if ignored:
        raise DataError(f"--{ignored[0].replace('_', '-')} {why}")
