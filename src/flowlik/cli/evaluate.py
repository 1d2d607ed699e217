"""`flowlik evaluate`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from flowlik.cli.options import Format, Json, Method, Out, Seed, command_line, show_run


def run(
    model: Annotated[Path, typer.Argument(help="A shipped model's name or a model file.")],
    data: Annotated[list[Path], typer.Argument(help="Folders of sequences with true flow.")],
    out: Out,
    format: Format = None,
    method: Method = None,
    seed: Seed = 0,
    json: Json = False,
) -> None:
    """Check whether a model tells the truth on other data: log score, K-S over texture, coverage.

    Example: `flowlik evaluate calibration/models/lucas-kanade.json other --out evaluation`
    """
    from flowlik.commands.evaluate import evaluate
    from flowlik.progress import terminal_progress

    show_run(evaluate(model, data, out, format, method, seed, command_line(), terminal_progress), json)
