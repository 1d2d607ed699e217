"""What commands print at the end: what a run answers, in about ten lines, or every figure."""

from __future__ import annotations

import json
import sys
from typing import TYPE_CHECKING

import typer

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rich.console import Console

    from flowlik.results.records import Record
    from flowlik.results.runs import RunFolder

MOST_WARNINGS = 4
WIDTH = 100


def show_run(run: RunFolder, as_json: bool, verbose: bool = False) -> None:
    """Print what a run answers, its warnings, and where its report is; or its records."""
    shown = run.warnings if verbose else run.warnings[:MOST_WARNINGS]
    for warning in shown:
        typer.echo(f"warning: {warning}", err=True)
    if len(shown) < len(run.warnings):
        typer.echo(f"warning: {len(run.warnings) - len(shown)} more, in the report", err=True)
    if as_json or verbose:
        show_records(run.records, as_json)
    if not as_json:
        show_verdict(run)
    for model in sorted((run.path / "models").glob("*.json")):
        typer.echo(f"model: {model}", err=True)
    typer.echo(f"report: {run.path / 'report.html'}", err=True)


def show_verdict(run: RunFolder) -> None:
    """Print a run's question, its answer, and what was judged."""
    import textwrap

    from flowlik.report.verdict import verdict_of

    verdict = verdict_of(run.records, run.command)
    typer.echo(verdict.title)
    for sentence in verdict.sentences:
        typer.echo(textwrap.fill(sentence, WIDTH))
    if verdict.rows:
        width = max(len(label) for label, _ in verdict.rows)
        for label, cells in verdict.rows:
            said = (f"{cell.text} {cell.grade}".strip() for cell in cells)
            named = (f"{column} {text}" for column, text in zip(verdict.columns, said))
            typer.echo(f"  {label:<{width}}  {'; '.join(named) if verdict.columns else ''}".rstrip())
    typer.echo(f"all {len(run.records)} figures: {run.path / 'metrics.json'}, or --verbose")


def console(highlight: bool = True) -> Console:
    """Standard output for tables: as wide as the terminal, or 140 columns in a pipe."""
    from rich.console import Console

    return Console(width=None if sys.stdout.isatty() else 140, highlight=highlight)


def show_records(records: Sequence[Record], as_json: bool) -> None:
    """Print records as JSON, or as a table with units."""
    if as_json:
        from dataclasses import asdict

        typer.echo(json.dumps([asdict(record) for record in records], indent=1, ensure_ascii=False))
        return
    from rich.table import Table

    columns = ("dataset", "flow", "family", "schedule", "estimator", "metric", "value", "unit")
    table = Table(*columns, box=None, pad_edge=False)
    for r in records:
        value = "–" if r.value is None else f"{r.value:.5g}"
        table.add_row(r.dataset, r.flow, r.family, r.schedule, r.estimator, r.metric, value, r.unit)
    console().print(table)
    for why in dict.fromkeys(f"{r.metric}: {r.reason}" for r in records if r.value is None):
        typer.echo(why)
