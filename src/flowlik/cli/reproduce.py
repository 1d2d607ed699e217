"""`flowlik reproduce`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from flowlik.cli.options import Json, Out, command_line, show_run


def run(
    quick: Annotated[
        bool, typer.Option("--quick", help="The size there is: a few minutes on two cores.")
    ] = False,
    out: Out = Path("run"),
    json: Json = False,
) -> None:
    """Simulate, calibrate, check and fly, as in the paper, and write a report.

    Example: `flowlik reproduce --quick --out run`
    """
    from flowlik.commands.reproduce import reproduce
    from flowlik.errors import DataError
    from flowlik.progress import terminal_progress

    if not quick:
        raise DataError("say which size: flowlik reproduce --quick")
    show_run(reproduce(out, command=command_line(), progress=terminal_progress), json)
