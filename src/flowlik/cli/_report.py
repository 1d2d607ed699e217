"""`flowlik report`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from flowlik.cli._options import (
    Json,
)
from flowlik.cli._printing import show_records


def run(
    folder: Annotated[Path, typer.Argument(metavar="RUN", help="Folder of a finished run.")],
    svg: Annotated[bool, typer.Option("--svg", help="Draw the figures as SVG too.")] = False,
    json: Json = False,
) -> None:
    """Rebuild the figures and the page of a run from its data and metrics.

    Example: `flowlik report run --svg`
    """
    from flowlik.report import build

    page = build(folder, svg)
    if json:
        from flowlik.results.records import read_records

        show_records(read_records(folder / "metrics.json"), as_json=True)
    typer.echo(f"report: {page}", err=True)
