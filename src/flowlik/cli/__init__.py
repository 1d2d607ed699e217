"""The command line: one thin file a command; heavy imports happen inside the commands."""

from __future__ import annotations

import errno
import io
import sys
import warnings


def main() -> None:
    """Run the command line; known errors become one line on standard error and exit code 2."""
    from flowlik.cli.app import app
    from flowlik.errors import FlowlikError

    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):  # a file's name need not be text
            stream.reconfigure(errors="backslashreplace")
    warnings.formatwarning = lambda message, *_: f"warning: {message}\n"
    try:
        app()
    except FlowlikError as error:
        print(f"flowlik: {error}", file=sys.stderr)
        sys.exit(2)
    except OSError as error:
        if error.errno not in (
            errno.ENOSPC,
            errno.EFBIG,
            errno.EDQUOT,
            errno.EROFS,
            errno.EACCES,
            errno.EPERM,
        ):
            raise
        print(f"flowlik: {error.filename or 'a file'}: cannot be written ({error.strerror})", file=sys.stderr)
        sys.exit(2)
    except MemoryError:
        print("flowlik: out of memory; smaller images or fewer workers may help", file=sys.stderr)
        sys.exit(2)
    except SystemExit as end:
        # what typer makes of a KeyboardInterrupt
        if end.code == 130:
            print("flowlik: interrupted; nothing half-written was left", file=sys.stderr)
        raise
