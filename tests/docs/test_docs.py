"""What documentation and README show is run, or at least understood, as it stands."""

import json
import pkgutil
import re
import shlex
import sys
from pathlib import Path

import numpy as np
import pytest
import typer

import flowlik
from flowlik.cli._models import row_of
from flowlik.cli.app import app
from flowlik.commands import models, summary
from flowlik.datasets import open_sequence
from flowlik.report._figures import FIGURES
from tests.cli.call import succeed
from tests.test_layout import ROOMS

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT / "benchmarks"))
held_out = pytest.importorskip("held_out", reason="the benchmarks are not beside the tests")
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
BLOCK = re.compile(r"^```(\w+)\n(.*?)^```", re.MULTILINE | re.DOTALL)


def blocks(page: Path, language: str) -> list[str]:
    """Code blocks of a page."""
    return [text for name, text in BLOCK.findall(page.read_text()) if name == language]


def commands(page: Path) -> list[list[str]]:
    """Words of each `flowlik` command in a page's shell blocks."""
    lines = "\n".join(blocks(page, "sh")).replace("\\\n", " ").splitlines()
    return [shlex.split(line, comments=True)[1:] for line in lines if line.startswith("flowlik ")]


ALL = [
    pytest.param(words, id=f"{page.stem}-{' '.join(words)[:40]}")
    for page in PAGES
    for words in commands(page)
]


@pytest.mark.parametrize("words", ALL)
def test_every_command_that_is_shown_is_understood(words):
    command = typer.main.get_command(app).commands[words[0]]
    command.make_context(words[0], words[1:], resilient_parsing=False)


def test_the_tutorial_works(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    page = ROOT / "docs/tutorial.md"
    for words in commands(page):
        if words != ["doctor"]:  # it has a test of its own
            succeed(*words)
    for program in blocks(page, "python"):
        exec(compile(program, str(page), "exec"), {})
    covariance = ROOT / "docs/file-formats.md"
    for program in blocks(covariance, "python"):
        exec(compile(program, str(covariance), "exec"), {})


def test_the_readmes_program_works(flight):
    sequence = open_sequence(flight)
    previous, current = sequence.image(0), sequence.image(1)
    given = {
        "camera": sequence.camera, "image": previous, "timestamp": 0.0, "depth": sequence.depth(0),
        "previous": previous, "current": current,
    }  # fmt: skip
    (program,) = blocks(ROOT / "README.md", "python")
    before, mark, after = program.partition("x, z = ")
    exec(compile(before, "README.md", "exec"), given)
    given["predicted_flow"] = np.zeros_like(given["m"].flow)
    exec(compile(mark + after, "README.md", "exec"), given)
    assert given["motion"].T_k_prev is not None and given["covariance"].shape[1:] == (2, 2)


def test_the_readme_is_short():
    assert len((ROOT / "README.md").read_text().split()) <= 700


def test_the_page_on_models_says_what_the_command_says():
    rows = re.findall(
        r"^\| `([\w-]+)` \| (.+?) \|$", (ROOT / "docs/which-model.md").read_text(), re.MULTILINE
    )
    page = {name: tuple(cells.split(" | ")[:5]) for name, cells in rows}
    assert page == {row[0]: row[1:] for row in map(row_of, models())}
    printed = succeed("models").out
    for cells in page.values():
        assert cells[1] in printed


def test_what_models_hold_unseen_is_what_the_page_on_calibration_has():
    """After that page has new tables: `python benchmarks/held_out.py`."""
    found = held_out.held_out((ROOT / "docs/calibration.md").read_text())
    assert len(found) == 8
    content = json.loads(held_out.FILE.read_text())["models"]
    assert found == {name: content[name]["coverage_90"] for name in found}


def test_figures_of_an_earlier_model_are_not_shown_as_this_ones(tmp_path, monkeypatch):
    path = tmp_path / "lucas-kanade.json"
    content = json.loads((ROOT / "src/flowlik/likelihood/shipped/lucas-kanade.json").read_text())
    for more, shown in ((0.0, True), (0.1, False)):
        content["index"]["offset"] += more
        path.write_text(json.dumps(content))
        monkeypatch.setattr("flowlik.commands._models.shipped", lambda: {"lucas-kanade": path})
        assert bool(summary(path).held_out) is shown


def test_every_figure_is_explained():
    page = " ".join((ROOT / "docs/reading-figures.md").read_text().split())
    for kind in FIGURES.values():
        assert f"## {kind.title} " in page
        assert " ".join(kind.caption.replace("{confidence:.0%}", "90%").split()) in page


def test_the_api_page_lists_names_that_are_there_and_all_of_the_top():
    listed = re.findall(r"^::: (\S+)$", (ROOT / "docs/api.md").read_text(), re.MULTILINE)
    assert all(pkgutil.resolve_name(name) is not None for name in listed)
    assert {f"flowlik.{name}" for name in flowlik.__all__} <= set(listed)


def test_every_room_is_described_in_its_place():
    described = re.findall(r"^  \| `(\w+)` \|", (ROOT / "CONTRIBUTING.md").read_text(), re.MULTILINE)
    assert described == [room for room in ROOMS.split() if room != "errors"]


def test_every_page_is_in_the_contents():
    contents = (ROOT / "mkdocs.yml").read_text()
    for page in PAGES[1:]:
        assert f" {page.relative_to(ROOT / 'docs').as_posix()}\n" in contents


def test_where_not_to_trust_it_is_shown(capsys):
    """Each demonstration fails as the page says."""
    from examples import when_not_to_trust as shown

    (slow, fast) = (row[3] for row in shown.low_texture((0.0,), (1.0, 16.0)) if row[2] == "farneback")
    assert slow > 0.9 > 0.75 > fast
    turns = [turn for _, _, turn in shown.ambiguous_eigenbasis()]
    assert turns == sorted(turns)
    assert turns[0] < 5 < 40 < turns[-1]
    (_, right, held), (_, wrong, lost) = shown.repeated_pattern(moves_px=(2.0, 10.0))
    assert right < 0.1 < 15 < wrong
    assert held > 0.9 > 0.3 > lost
    ((_, _, _, share),) = shown.grid_world((40.0,), ("grid",))
    assert share < 0.75


def test_the_version_is_one():
    assert flowlik.__version__ in succeed("--version").out
