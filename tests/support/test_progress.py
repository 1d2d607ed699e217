import itertools

import pytest

from flowlik.support import progress
from flowlik.support.progress import no_progress, terminal_progress


@pytest.mark.parametrize("terminal", [False, True])
@pytest.mark.parametrize("wrap", [no_progress, terminal_progress])
def test_items_pass_in_order_and_nothing_goes_to_standard_output(monkeypatch, capsys, wrap, terminal):
    monkeypatch.setattr("sys.stderr.isatty", lambda: terminal)
    assert list(wrap(iter("abc"), "letters", 3)) == ["a", "b", "c"]
    captured = capsys.readouterr()
    assert captured.out == ""
    assert ("letters" in captured.err) is (wrap is terminal_progress)


def test_items_are_taken_one_at_a_time(monkeypatch):
    numbers = terminal_progress(itertools.count(), "numbers", 10)
    assert [next(numbers), next(numbers)] == [0, 1]


def test_plain_lines_tell_the_time_left(monkeypatch, capsys):
    clock = itertools.count(step=15.0)
    monkeypatch.setattr(progress.time, "monotonic", lambda: next(clock))
    list(terminal_progress(range(4), "frames", 4))
    assert capsys.readouterr().err.splitlines() == ["frames: 2/4, 4/min, 30 s left", "frames: 4 in 75.0 s"]


def test_an_error_passes_through(capsys):
    def broken():
        yield 1
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        list(terminal_progress(broken(), "work", 2))
    assert "work: " not in capsys.readouterr().err


def test_logs_hold_whole_lines_only(capsys):
    list(terminal_progress(range(3), "frames", 3))
    assert "\r" not in capsys.readouterr().err


@pytest.mark.parametrize(
    ("a_second", "said"), [(1234.4, "1234/s"), (2.5, "2.5/s"), (0.5, "30/min"), (1e-3, "3.6/h")]
)
def test_rates_are_in_the_unit_that_reads_best(a_second, said):
    assert progress._rate(a_second) == said
