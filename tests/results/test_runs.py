import json

import numpy as np
import pytest

from flowlik.errors import DataError
from flowlik.results.records import Record, read_records
from flowlik.results.runs import RunFolder
from flowlik.support.versions import versions


def finished(path, command="flowlik evaluate x", labels=("a",)) -> RunFolder:
    run = RunFolder(path, command, {"data": "x"}, seed=3)
    run.records.append(Record("nll", 1.5, "nat"))
    for label in labels:
        run.save("table", label, {"numbers": [1, 2, 3]})
    run.finish()
    return run


def test_a_finished_run(tmp_path):
    run = RunFolder(tmp_path / "deep" / "run", "flowlik evaluate x --seed 3", {"data": "x"}, seed=3)
    assert not run.path.exists()
    run.records.append(Record("nll", 1.5, "nat"))
    run.warn("look out")
    run.warn("look out")
    run.save("table", "a", {"numbers": [1, 2, 3]})
    assert run.finish() == run.path
    assert json.loads((run.path / "run.json").read_text()) == {
        "name": "flowlik evaluate",
        "command": "flowlik evaluate x --seed 3",
        "config": {"data": "x"},
        "seed": 3,
        "versions": versions(),
        "warnings": ["look out"],
    }
    assert read_records(run.path / "metrics.json") == run.records
    np.testing.assert_array_equal(np.load(run.path / "data" / "table--a.npz")["numbers"], [1, 2, 3])


def test_a_run_may_be_repeated_and_leaves_no_figures_of_the_earlier_one(tmp_path):
    finished(tmp_path, labels=("a", "b"))
    finished(tmp_path, "flowlik evaluate y", labels=("b", "c"))
    assert {path.stem for path in (tmp_path / "data").iterdir()} == {"table--b", "table--c"}
    assert json.loads((tmp_path / "run.json").read_text())["command"] == "flowlik evaluate y"


def test_until_it_is_finished_a_repeated_run_is_none(tmp_path):
    finished(tmp_path)
    run = RunFolder(tmp_path, "flowlik evaluate x", {})
    assert (tmp_path / "run.json").exists()
    run.begin()
    assert not (tmp_path / "run.json").exists()
    RunFolder(tmp_path, "flowlik evaluate y", {}).begin()


def other_files(folder):
    (folder / "thesis.tex").touch()


def another_command(folder):
    finished(folder, "flowlik calibrate x")


def another_program(folder):
    (folder / "run.json").write_text('["run"]')


@pytest.mark.parametrize("fill", [other_files, another_command, another_program])
def test_a_folder_of_something_else_is_refused(tmp_path, fill):
    fill(tmp_path)
    before = sorted(path.name for path in tmp_path.rglob("*"))
    with pytest.raises(DataError, match="holds something else"):
        RunFolder(tmp_path, "flowlik evaluate x", {})
    assert sorted(path.name for path in tmp_path.rglob("*")) == before


def test_a_file_is_no_folder(tmp_path):
    (tmp_path / "file").touch()
    with pytest.raises(DataError, match="is a file"):
        RunFolder(tmp_path / "file", "flowlik evaluate x", {})


def test_unknown_versions_are_said_to_be(monkeypatch):
    monkeypatch.setattr("flowlik.support.versions.PACKAGES", ("numpy", "no-such-package"))
    assert versions() == {
        "python": versions()["python"],
        "numpy": np.__version__,
        "no-such-package": "unknown",
    }
