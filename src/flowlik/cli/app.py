"""The typer application: every command registers itself here."""

from __future__ import annotations

import typer

from flowlik.cli import (
    _calibrate,
    _doctor,
    _drift,
    _evaluate,
    _flow,
    _fuse,
    _models,
    _odometry,
    _report,
    _reproduce,
    _simulate,
)
from flowlik.cli._help import Command, Group

app = typer.Typer(
    name="flowlik",
    cls=Group,
    help="Honest error distributions for optical flow: calibrate them, check them, use them.",
    epilog="Begin with `flowlik doctor`, then `flowlik flow a.png b.png --model farneback --out picture`. "
    "Complete options by the tab key: `flowlik --install-completion`.",
    no_args_is_help=True,
    add_completion=True,
    pretty_exceptions_enable=False,
    rich_markup_mode="markdown",
    context_settings={"help_option_names": ["-h", "--help"]},
)
for module in (
    _reproduce,
    _simulate,
    _calibrate,
    _evaluate,
    _flow,
    _odometry,
    _fuse,
    _drift,
    _models,
    _report,
    _doctor,
):
    app.command(name=module.__name__.rsplit("._", 1)[-1], cls=Command)(module.run)


@app.callback(invoke_without_command=True)
def _version(
    show: bool = typer.Option(
        False, "--version", help="Show versions of what matters, and exit.", is_eager=True
    ),
) -> None:
    """Honest error distributions for optical flow: calibrate them, check them, use them."""
    if show:
        from flowlik.support.versions import versions

        typer.echo("  ".join(f"{name} {number}" for name, number in versions().items()))
        raise typer.Exit


__all__ = ["app"]
