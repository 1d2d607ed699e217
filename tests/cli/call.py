"""The command line called in this process."""

import io
import re
import sys
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass
from pathlib import Path

import pytest

from flowlik.cli import main

PROGRESS = re.compile(r".+: (\d+ in [\d.]+ s|\d+/\d+, [\d.e+]+/(s|min|h), \d+ s left)")


@dataclass(frozen=True)
class Outcome:
    """Exit code, standard output, and the lines on standard error that are not progress."""

    code: int
    out: str
    err: list[str]


def call(*words: object) -> Outcome:
    """Run `flowlik` with these words."""
    out, err = io.StringIO(), io.StringIO()
    with pytest.MonkeyPatch.context() as patch, redirect_stdout(out), redirect_stderr(err):
        patch.setattr(sys, "argv", ["flowlik", *map(str, words)])
        with pytest.raises(SystemExit) as caught:
            main()
            sys.exit(0)
    lines = [line for line in err.getvalue().splitlines() if line and not PROGRESS.fullmatch(line)]
    return Outcome(caught.value.code or 0, out.getvalue(), lines)


def succeed(*words: object) -> Outcome:
    """Run `flowlik`, which must go well."""
    outcome = call(*words)
    assert outcome.code == 0, outcome
    return outcome


def leftovers(folder: Path) -> list[Path]:
    """What an interrupted or refused run must not leave."""
    return [p for p in folder.rglob("*") if p.name.endswith(".part") or p.name in ("run.json", "report.html")]


def refuse(*words, out, message):
    """Run, and check that it is refused as it should be."""
    outcome = call(*words, "--out", out)
    assert outcome.code == 2
    assert len(outcome.err) == 1, outcome.err
    assert outcome.err[0].startswith("flowlik: ")
    assert message in outcome.err[0]
    assert outcome.out == ""
    assert not leftovers(out) if out.is_dir() else True
    assert not list(out.parent.rglob("*.part"))
