"""An interrupted command leaves nothing half-written, and writing data goes on where it stopped."""

import pytest

from flowlik.support.progress import no_progress
from tests.cli.call import call, leftovers, succeed


@pytest.fixture
def interrupted(monkeypatch):
    """Interrupt the next commands after some items of a task; a function undoes it."""

    def begin(after: int, task: str = "") -> None:
        def progress(items, what, total):
            for k, item in enumerate(items):
                if k == after and task in what:
                    raise KeyboardInterrupt
                yield item

        monkeypatch.setattr("flowlik.support.progress.terminal_progress", progress)

    yield begin


@pytest.mark.parametrize("command", ["calibrate", "evaluate", "odometry"])
def test_a_run_that_is_interrupted_is_no_run(flight, models, tmp_path, interrupted, command):
    words = {
        "calibrate": (flight, "--method", "lucas-kanade"),
        "evaluate": (models["lucas-kanade"], flight),
        "odometry": (flight, "--model", models["lucas-kanade"]),
    }
    interrupted(after=0)
    outcome = call(command, *words[command], "--out", tmp_path / "run")
    assert outcome.code == 130
    assert outcome.err == ["flowlik: interrupted; nothing half-written was left"]
    assert not leftovers(tmp_path)


def test_an_interrupted_file_does_not_appear(flight, tmp_path, monkeypatch):
    def interrupt(*_args, **_keywords):
        raise KeyboardInterrupt

    command = ("calibrate", flight, "--method", "lucas-kanade", "--out", tmp_path / "run")
    with monkeypatch.context() as patch:
        patch.setattr("numpy.savez_compressed", interrupt)
        assert call(*command).code == 130
    assert {path.name for path in tmp_path.rglob("*") if path.is_file()} == {"unfinished.json", "plan.json"}
    assert call(*command).code == 0
    assert not (tmp_path / "run" / "unfinished.json").exists()


def test_simulation_goes_on_where_it_was_interrupted(flight, tmp_path, interrupted, monkeypatch):
    words = ("simulate", "planes", "--trajectory", "training", "--frames", 9, "--width", 96, "--height", 64,
             "--out", tmp_path / "again")  # fmt: skip
    interrupted(after=3)
    assert call(*words).code == 130
    begun = {path: path.stat().st_mtime_ns for path in (tmp_path / "again").rglob("*.png")}
    assert len(begun) == 9
    assert not leftovers(tmp_path)
    monkeypatch.setattr("flowlik.support.progress.terminal_progress", no_progress)
    succeed(*words)
    files = {path.relative_to(flight): path.read_bytes() for path in flight.rglob("*.*")}
    again = tmp_path / "again"
    assert {path.relative_to(again): path.read_bytes() for path in again.rglob("*.*")} == files
    assert {path: path.stat().st_mtime_ns for path in begun} == begun
