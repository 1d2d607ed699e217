"""`flowlik models`."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

from flowlik.cli._options import Json
from flowlik.cli._printing import console

if TYPE_CHECKING:
    from flowlik.commands import ModelSummary


def row_of(model: ModelSummary) -> tuple[str, ...]:
    """One row of the list, as the page *Which model?* has it too."""
    from flowlik.report.names import model_name

    low, high = model.held_out.get("coverage_90", (None, None))
    speed = model.held_out.get("frames_per_second")
    return (
        model.name,
        model_name(model.family, model.schedule),
        "–" if low is None else f"{100 * low:.0f} to {100 * high:.0f} %",
        "–" if speed is None else f"{speed:.0f}",
        "yes" if "discrepancy" in model.signals else "no",
        model.residual,
    )


def run(
    name: Annotated[
        str | None, typer.Argument(help="A shipped model or a model file, to show it whole.")
    ] = None,
    json: Json = False,
) -> None:
    """List the calibrated models that ship with flowlik, or show one.

    Examples: `flowlik models`, `flowlik models lucas-kanade`. Use one by `--model lucas-kanade`.
    """
    import json as json_module
    from dataclasses import asdict

    from rich.table import Table

    from flowlik.commands import models, summary

    found = models() if name is None else [summary(name)]
    if json:
        typer.echo(json_module.dumps([asdict(m) for m in found], indent=1, ensure_ascii=False, default=str))
        return
    wide = console()
    if name is None:
        heads = ("name", "error model", "90 % hold, unseen", "frames/s", "flow back", "residual")
        table = Table(*heads, box=None)
        for m in found:
            table.add_row(*row_of(m))
        wide.print(table)
        wide.print(
            "90 % hold, unseen: what the 90 % intervals hold on nine pairs and clips of others. frames/s: "
            "640x360, two cores, images to motions. flow back: measured too. Which to take: "
            "docs/which-model.md. `flowlik models NAME` shows one whole."
        )
        return
    for key, value in asdict(found[0]).items():
        text = (
            value
            if isinstance(value, str | int)
            else json_module.dumps(value, ensure_ascii=False, default=str)
        )
        wide.print(f"[bold]{key}[/bold]  {text}", highlight=False, markup=True)
