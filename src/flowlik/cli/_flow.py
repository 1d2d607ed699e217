"""`flowlik flow`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from flowlik.cli import _complete as complete
from flowlik.cli._options import (
    ADVANCED,
    INPUT,
    MODEL,
    Camera,
    FlowPng,
    Json,
    Mask,
    Method,
    Out,
    Recording,
    Verbose,
    View,
    command_line,
)
from flowlik.cli._printing import show_run
from flowlik.commands.options import FlowOptions


def run(
    previous: Annotated[Path, typer.Argument(help="First image.")],
    current: Annotated[Path, typer.Argument(help="Second image.")],
    model: Annotated[
        Path,
        typer.Option(
            "--model",
            "-m",
            rich_help_panel=MODEL,
            help="A shipped model or a file; it names the flow.",
            autocompletion=complete.models,
        ),
    ],
    out: Out,
    truth: Annotated[
        Path | None,
        typer.Option(rich_help_panel=INPUT, help="True flow: .flo, .png (16 bit), .npy, .npz or .pfm."),
    ] = None,
    method: Method = None,
    flow_png: FlowPng = None,
    confidence: Annotated[
        float, typer.Option(rich_help_panel=ADVANCED, help="Confidence of the intervals.")
    ] = FlowOptions.confidence,
    camera: Camera = None,
    mask: Mask = None,
    view: View = False,
    record: Recording = False,
    verbose: Verbose = False,
    json: Json = False,
) -> None:
    """Draw where, and in which direction, the flow between two images can be trusted.

    Examples
    --------
    `flowlik flow a.png b.png --model farneback --out picture`

    `flowlik flow a.png b.png --model run/models/dis.json --camera camera.yaml --save-rerun --out picture`
    """
    from flowlik.commands import flow

    options = FlowOptions(
        truth=truth,
        method=method,
        flow_png=flow_png,
        confidence=confidence,
        camera=camera,
        mask=mask,
        view=view,
        record=record,
    )
    show_run(flow(previous, current, model, out, options, command=command_line()), json, verbose)
