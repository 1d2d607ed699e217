"""A calibration of five image pairs, and an evaluation of one, say how little that is."""

import json

import pytest

from flowlik.results.records import read_records, select
from tests.cli.call import succeed

pytestmark = pytest.mark.usefixtures("undrawn")


def keep_first(folder, images):
    for path in sorted((folder / "image_lcam_front").iterdir())[images:]:
        path.unlink()


def told(out):
    (warning,) = (w for w in json.loads((out / "run.json").read_text())["warnings"] if "little data" in w)
    return warning


def test_five_pairs_calibrated(copy, out):
    keep_first(copy, 6)
    succeed("calibrate", copy, "--method", "lucas-kanade", "--schedule", "constant", "--out", out)
    nll = select(read_records(out / "metrics.json"), metric="nll", schedule="texture")[0]
    assert f"{nll.count} error components from 5 image pairs" in told(out)
    assert "≥100000 components from ≥30 frames" in told(out)
    assert "split=in sample" in nll.protocol


def test_one_pair_evaluated(copy, models, out):
    keep_first(copy, 2)
    succeed("evaluate", models["lucas-kanade"], copy, "--out", out)
    assert "error components from 1 image pairs" in told(out)
    (nll,) = select(read_records(out / "metrics.json"), metric="nll")
    (ks,) = select(read_records(out / "metrics.json"), metric="ks_median")
    for record in (nll, ks):
        assert "interval_95=none" in record.protocol
