"""`flowlik doctor`."""

from __future__ import annotations

import typer

from flowlik.cli._options import Json
from flowlik.cli._printing import console


def run(json: Json = False) -> None:
    """Say what is installed and which extras are missing, and try it all for a few seconds.

    Examples
    --------
    `flowlik doctor`

    `flowlik doctor --json`, to put into a report of an error. Exit code 2 if the self-test fails.
    """
    import json as json_module
    from dataclasses import asdict

    from rich.table import Table

    from flowlik.commands import doctor

    if not json:
        # the first time kernels are compiled; nobody should wonder whether it hangs
        typer.echo("trying flow and ego-motion: seconds, the first time half a minute", err=True)
    found = doctor()
    if json:
        content = {**asdict(found), "healthy": found.healthy}
        typer.echo(json_module.dumps(content, indent=1, ensure_ascii=False))
    else:
        table = Table(show_header=False, box=None, pad_edge=False)
        for name, value in {**found.versions, **found.system}.items():
            table.add_row(name, value)
        for name, packages in found.extras.items():
            lacking = f"missing {', '.join(packages)}: pip install 'flowlik\\[{name}]'"
            table.add_row(f"extra {name}", lacking if packages else "installed")
        for check in found.checks:
            outcome = "ok" if check.passed else "FAILED"
            table.add_row(check.name, f"{outcome}: {check.found} ({check.seconds:.1f} s)")
        console(highlight=False).print(table)
    if not found.healthy:
        raise typer.Exit(2)
