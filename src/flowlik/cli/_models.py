"""`flowlik models`."""

from __future__ import annotations

from typing import Annotated

import typer

from flowlik.cli._options import Json


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

    from rich.console import Console
    from rich.table import Table

    from flowlik.commands import models, summary

    found = models() if name is None else [summary(name)]
    if json:
        typer.echo(json_module.dumps([asdict(m) for m in found], indent=1, ensure_ascii=False, default=str))
        return
    console = Console(soft_wrap=True)
    if name is None:
        table = Table("name", "family", "schedule", "coverage 90 %", "K-S median", "components", box=None)
        for m in found:
            told = [m.goodness.get(key) for key in ("coverage_90", "ks_median")]
            cells = ["–" if value is None else f"{value:.3f}" for value in told]
            table.add_row(m.name, m.family, m.schedule, *cells, f"{m.provenance.get('components', 0):,}")
        console.print(table)
        console.print("Goodness is on the calibration data itself; `flowlik models NAME` shows one whole.")
        return
    for key, value in asdict(found[0]).items():
        text = (
            value
            if isinstance(value, str | int)
            else json_module.dumps(value, ensure_ascii=False, default=str)
        )
        console.print(f"[bold]{key}[/bold]  {text}", highlight=False, markup=True)
