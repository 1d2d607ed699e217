"""The command line: one thin file a command; heavy imports happen inside the commands."""

from __future__ import annotations

import sys


def main() -> None:
    """Run the command line; known errors become one line on standard error and exit code 2."""
    from flowlik.cli.app import app
    from flowlik.errors import FlowlikError

    try:
        app()
    except FlowlikError as error:
        print(f"flowlik: {error}", file=sys.stderr)
        sys.exit(2)
    except SystemExit as end:
        # what typer makes of a KeyboardInterrupt
        if end.code == 130:
            print("flowlik: interrupted; nothing half-written was left", file=sys.stderr)
        raise
