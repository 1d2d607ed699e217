"""What stands on the terminal when a run ends."""

import json
from dataclasses import asdict
from types import SimpleNamespace

import pytest

from flowlik.cli._printing import MOST_WARNINGS, show_run
from tests.report.test_verdict import UNSEEN


@pytest.fixture
def run(tmp_path):
    warnings = [f"thing {k}" for k in range(9)]
    return SimpleNamespace(
        path=tmp_path / "run", command="flowlik reproduce --quick", records=UNSEEN * 60, warnings=warnings
    )


def test_a_run_ends_with_what_it_answers(run, capsys):
    show_run(run, as_json=False)
    printed = capsys.readouterr()
    lines = printed.out.splitlines()
    assert lines[0].startswith("Can these error bars be trusted?")
    assert len(lines) <= 16 and all(len(line) <= 100 for line in lines[:-1])
    assert any("90 % intervals hold, learned" in line and "poor" in line for line in lines)
    assert "--verbose" in lines[-1]
    assert len(printed.err.splitlines()) == MOST_WARNINGS + 2
    assert f"{9 - MOST_WARNINGS} more, in the report" in printed.err


def test_verbose_prints_every_figure(run, capsys):
    run.records = UNSEEN
    show_run(run, as_json=False, verbose=True)
    printed = capsys.readouterr()
    assert all(record.metric in printed.out for record in UNSEEN)
    assert printed.err.count("warning: ") == 9


def test_json_prints_the_records_and_nothing_else(run, capsys):
    run.records = UNSEEN
    show_run(run, as_json=True, verbose=True)
    assert json.loads(capsys.readouterr().out) == [asdict(record) for record in UNSEEN]
