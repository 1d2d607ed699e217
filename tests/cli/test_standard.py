"""`flowlik calibrate --standard`, with flights of a few small images."""

import json
from functools import partial

import pytest

from flowlik.commands import standard_flights
from flowlik.commands._calibrate import fit_families
from flowlik.commands.standard_plan import CALIBRATION, REPORT, VALIDATION, StandardFlight
from flowlik.geometry.camera import Pinhole
from flowlik.likelihood.model_file import load_likelihood
from flowlik.results.records import read_records, select
from flowlik.simulation import simulate
from tests.cli.call import call, refuse, succeed

CAMERA = Pinhole(96, 64, 60.0, 60.0, 47.5, 31.5)
FLIGHTS = {
    "CALIBRATION": (
        StandardFlight("planes", "training", 6.0, 0, 3, 3),
        StandardFlight("planes", "training", 3.0, 1, 2, 2),
        StandardFlight("driving", "05", 0.0, 2),
    ),
    "VALIDATION": (StandardFlight("planes", "training", 6.0, 3, 2, 2, "val"),),
    "REPORT": {"other": StandardFlight("planes", "curve", 6.0, 4, 2, 2, "rep")},
}


@pytest.fixture
def small(monkeypatch):
    for name, flights in FLIGHTS.items():
        monkeypatch.setattr(standard_flights, name, flights)
    monkeypatch.setattr(standard_flights, "simulate", partial(simulate, camera=CAMERA))
    # one family is enough here
    monkeypatch.setattr("flowlik.commands._calibrate.fit_families", partial(fit_families, names=("lcm",)))


def test_the_standard_calibration(small, tmp_path, undrawn, monkeypatch):
    words = ("calibrate", "--standard", "--method", "dis", "--family", "lcm", "--cache", tmp_path / "cache")
    first = succeed(*words, "--share", 0.5, "--out", tmp_path / "first")
    told = "4 standard flights are rendered into", "frames, 0.0 GB, about 0 minutes"
    assert all(part in first.err[0] for part in told)
    assert "warning: no --kitti-poses: the standard flights along roads are left out" in first.err
    files = sorted(path.name for path in (tmp_path / "cache").glob("*.npz"))
    assert files == [
        "cal-planes-3-1-1-of-2.npz", "cal-planes-6-0-2-of-3.npz", "rep-planes-6-curve-4-1-of-2.npz",
        "val-planes-6-3-1-of-2.npz",
    ]  # fmt: skip
    config = json.loads((tmp_path / "first" / "run.json").read_text())["config"]
    recorded = [config[name] for name in ("standard", "share", "cache", "kitti_poses")]
    assert recorded == [True, 0.5, str(tmp_path / "cache"), None]
    model = load_likelihood(tmp_path / "first" / "models" / "dis.json")
    assert model.provenance["data"] == "cal-planes-6-0, cal-planes-3-1"
    assert model.shared_errors is not None
    records = read_records(tmp_path / "first" / "metrics.json")
    for split in ("validation", "held out"):
        for schedule in ("index", "texture"):
            (nll,) = select(records, metric="nll", schedule=schedule, dataset=f"standard flights, {split}")
            assert nll.count > 1000
            assert f"split={split}" in nll.protocol
    assert model.goodness["nll"] == next(
        r.value for r in records if r.metric == "nll" and r.schedule == "index" and "in sample" in r.protocol
    )

    # what is there is not rendered again
    monkeypatch.setattr(standard_flights, "_render", None)
    again = succeed(*words, "--share", 0.5, "--out", tmp_path / "second")
    assert not any("rendered into" in line for line in again.err)
    assert load_likelihood(tmp_path / "second" / "models" / "dis.json").schedule.index == model.schedule.index


def test_a_share_of_a_flight_that_is_there_as_a_whole(small, tmp_path):
    flight = FLIGHTS["CALIBRATION"][0]
    whole = standard_flights.rendered(flight, tmp_path, None)
    assert [path.name for path in tmp_path.iterdir()] == ["cal-planes-6-0.npz"]
    assert len(whole) == 9
    part = standard_flights.rendered(flight, tmp_path, None, 0.3)
    (block,) = standard_flights._blocks(part, flight, 0.3)
    assert list(block.firsts) == [3, 4]
    assert (whole.image(3) == part.image(3)).all()


def test_shares_are_spread_over_a_flight():
    for flight in (*CALIBRATION, *VALIDATION, *REPORT.values()):
        assert flight.shared(1) == list(range(flight.places))
        for share in (0.01, 0.1, 0.5, 0.9):
            places = flight.shared(share)
            assert len(places) == max(1, round(share * flight.places)) == len(set(places))
            assert 0 <= places[0] <= places[-1] < flight.places
    assert StandardFlight("planes", "training", 6.0, 0, 12).shared(0.25) == [2, 6, 10]


def test_what_cannot_be_calibrated_is_one_line(small, tmp_path):
    out, cache = tmp_path / "out", ("--cache", tmp_path / "cache")
    words = ("calibrate", "--method", "dis")
    refuse(
        *words, out=out, message="on folders of data, or on the standard flights (--standard), one of them"
    )
    refuse(*words, tmp_path, "--share", 0.5, out=out, message="--share is an option of the standard flights")
    refuse(*words, "--standard", "--resize", 0.5, out=out, message="--resize is an option of folders of data")
    refuse(*words, "--standard", "--share", 0, *cache, out=out, message="above 0 and up to 1, not 0.0")
    poses = ("--kitti-poses", tmp_path)
    refuse(*words, "--standard", *poses, *cache, out=out, message="no 05.txt with the poses of a KITTI route")
    assert call(*words, "--standard", "--share", "x", "--out", out).code == 2
