"""`flowlik reproduce`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from flowlik.cli.options import Json, Out, command_line, show_run


def run(
    quick: Annotated[bool, typer.Option("--quick", help="A small forest: minutes on two cores.")] = False,
    full: Annotated[
        bool, typer.Option("--full", help="The whole forest at the paper's frame counts: hours.")
    ] = False,
    out: Out = Path("run"),
    json: Json = False,
) -> None:
    """Simulate, calibrate, check and fly, as in the paper, and write a report.

    Example: `flowlik reproduce --quick --out run`
    """
    from flowlik.commands.plans import BYTES_A_FRAME, FULL, QUICK
    from flowlik.commands.reproduce import reproduce
    from flowlik.errors import DataError
    from flowlik.progress import terminal_progress

    if quick == full:
        raise DataError("say which size: flowlik reproduce --quick, or --full")
    plan = QUICK if quick else FULL
    if plan.cached:
        size = plan.frames * BYTES_A_FRAME / 1e9
        typer.echo(
            f"{plan.frames} frames are rendered once, to about {size:.0f} GB in {out / 'flights'}", err=True
        )
    show_run(reproduce(out, plan, command=command_line(), progress=terminal_progress), json)
