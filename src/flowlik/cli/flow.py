"""`flowlik flow`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from flowlik.cli.options import Camera, Json, Method, Out, Recording, View, command_line, show_run


def run(
    previous: Annotated[Path, typer.Argument(help="First image.")],
    current: Annotated[Path, typer.Argument(help="Second image.")],
    model: Annotated[
        Path, typer.Option("--model", "-m", help="A shipped model or a file; it names the flow.")
    ],
    out: Out,
    truth: Annotated[Path | None, typer.Option(help="True flow: .flo, KITTI .png or .npy.")] = None,
    method: Method = None,
    confidence: Annotated[float, typer.Option(help="Confidence of the intervals.")] = 0.9,
    camera: Camera = None,
    view: View = False,
    record: Recording = False,
    json: Json = False,
) -> None:
    """Draw where, and in which direction, the flow between two images can be trusted.

    Example: `flowlik flow a.png b.png --model run/models/farneback.json --out picture`
    """
    from flowlik.commands.flow import flow

    show_run(
        flow(previous, current, model, out, truth, method, confidence, command_line(), camera, view, record),
        json,
    )
