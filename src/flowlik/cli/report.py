"""`flowlik report`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def run(
    folder: Annotated[Path, typer.Argument(metavar="RUN", help="Folder of a finished run.")],
) -> None:
    """Rebuild the figures and the page of a run from its data and metrics.

    Example: `flowlik report run`
    """
    from flowlik.report import build

    typer.echo(f"report: {build(folder)}", err=True)
