"""Two runs with one seed leave the same numbers."""

from dataclasses import replace

import pytest

from flowlik.results.records import read_records
from tests.cli.call import succeed

TIMED = ("frames_per_second", "pairs_per_second", "components_per_second", "peak_memory_mb")


def numbers(run):
    """Records of a run, those of time and memory without their values."""
    return [replace(r, value=None) if r.metric in TIMED else r for r in read_records(run / "metrics.json")]


@pytest.mark.usefixtures("undrawn")
def test_two_runs_with_one_seed_give_equal_metrics(flight, calibrations, models, tmp_path):
    succeed("calibrate", flight, "--method", "lucas-kanade", "--out", tmp_path / "calibration")
    pairs = [(calibrations["lucas-kanade"], tmp_path / "calibration")]
    model = models["lucas-kanade"]
    for words in (("odometry", flight, "--frames", 6, "--model", model), ("evaluate", model, flight)):
        runs = [tmp_path / f"{words[0]}-{k}" for k in range(2)]
        for run in runs:
            succeed(*words, "--seed", 7, "--out", run)
        pairs.append(tuple(runs))
    for first, second in pairs:
        assert len(numbers(first)) > 2
        assert numbers(first) == numbers(second)
