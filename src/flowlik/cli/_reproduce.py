"""`flowlik reproduce`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from flowlik.cli._options import (
    INPUT,
    Json,
    Model,
    Out,
    Verbose,
    command_line,
)
from flowlik.cli._printing import show_run


def run(
    quick: Annotated[bool, typer.Option("--quick", help="A small forest: minutes on two cores.")] = False,
    full: Annotated[
        bool, typer.Option("--full", help="The whole forest at the paper's frame counts: hours.")
    ] = False,
    share: Annotated[
        float, typer.Option("--share", min=0.001, max=1.0, help="Share of the frames of --full.")
    ] = 1.0,
    kitti: Annotated[
        Path | None,
        typer.Option(
            "--kitti",
            rich_help_panel=INPUT,
            help="Root of KITTI odometry: the paper's Table III, with --model.",
        ),
    ] = None,
    model: Model = None,
    out: Out = Path("run"),
    verbose: Verbose = False,
    json: Json = False,
) -> None:
    """Simulate, calibrate, check and fly, as in the paper, and write a report.

    Example: `flowlik reproduce --quick --out run`
    """
    from flowlik.calibration import executor
    from flowlik.commands import reproduce
    from flowlik.commands.plans import BYTES_A_FRAME, FULL, QUICK
    from flowlik.errors import DataError
    from flowlik.support.progress import terminal_progress
    from flowlik.support.threads import THREADS

    if kitti is not None:
        from flowlik.commands import kitti_table
        from flowlik.commands.options import KittiOptions

        if model is None:
            raise DataError(
                "--kitti needs --model, a shipped model's name or a file that `flowlik calibrate` makes"
            )
        options = KittiOptions(frames=60 if quick else None)
        command = command_line()
        show_run(
            kitti_table(kitti, model, out, options, command=command, progress=terminal_progress),
            json,
            verbose,
        )
        return
    if quick == full:
        raise DataError("say which size: flowlik reproduce --quick, or --full")
    if quick and share != 1:
        raise DataError("--share is of --full: --quick is small already")
    plan = QUICK if quick else FULL.shared(share)
    if plan.cached:
        size = plan.frames * BYTES_A_FRAME / 1e9
        typer.echo(
            f"{plan.frames} frames are rendered once, to about {size:.0f} GB in {out / 'flights'}", err=True
        )
    with executor("processes" if THREADS > 1 else "serial") as map:
        done = reproduce(out, plan, command_line(), terminal_progress, map)
    show_run(done, json, verbose)
