from dataclasses import replace

import numpy as np
import pytest

from flowlik.commands import reproduce
from flowlik.commands._reproduce_flights import BASELINE
from flowlik.commands.plans import FULL, METHODS, QUICK, Flight, Plan
from flowlik.evaluation.likelihood import Counting
from flowlik.likelihood.model_file import load_likelihood
from flowlik.results.records import read_records, select

TINY = Plan(
    world="planes",
    width=96,
    height=64,
    fov_deg=120.0,
    calibration=(Flight(0, "training", 6.0, 12), Flight(1, "training", 12.0, 12)),
    held_out=(Flight(100, "curve", 6.0, 10),),
    counting=Counting(500, 5),
)
HELD_OUT = f"planes-{TINY.held_out[0].label}"
ESTIMATORS = ("ransac", "lcmsac", "mle", "lcmsac-index", "mle-index", BASELINE)


@pytest.fixture(scope="module")
def run(quick, tmp_path_factory):
    tasks = []

    def progress(items, what, total):
        count = 0
        for item in items:
            yield item
            count += 1
        tasks.append((what, count, total))

    done = reproduce(tmp_path_factory.mktemp("reproduce") / "run", TINY, progress=progress)
    assert tasks and all(count == total for _, count, total in tasks)
    return done


def test_models_metrics_figures_and_page_are_left(run):
    for method in METHODS:
        for name, family, schedule in ((method, "glc", "index"), (f"{method}-lcm", "lcm", "texture")):
            model = load_likelihood(run.path / "models" / f"{name}.json")
            assert (model.method["name"], model.family.name, model.provenance["pairs"]) == (
                method,
                family,
                24,
            )
            assert model.schedule.name == schedule
    assert read_records(run.path / "metrics.json") == run.records
    stems = {path.stem for path in (run.path / "data").iterdir()}
    drawn = {path.stem for path in (run.path / "figures").iterdir()}
    assert {stem for stem in drawn if not stem.startswith("front-")} == stems
    assert len(drawn) == len(stems) + 2
    kinds = {stem.split("--")[0] for stem in stems}
    assert kinds == {
        "bias", "coverage", "distributions", "error-over-texture", "flow-sequence", "frame-errors",
        "goodness", "levels", "pit", "sparsification", "table", "trajectories", "uncertainty",
    }  # fmt: skip
    assert "1 unseen flight" in (run.path / "report.html").read_text()


@pytest.mark.parametrize("method", METHODS)
def test_every_family_is_judged_on_both_populations(run, method):
    for dataset, split in [("planes-calibration", "in sample"), (HELD_OUT, "held-out")]:
        for family in ("lcm", "log-logistic", "gaussian", "glc"):
            for metric in ("nll", "ks_median", "coverage_90", "outside_fraction"):
                (record,) = select(
                    run.records, dataset=dataset, flow=method, family=family, metric=metric, estimator=None,
                    schedule="texture",
                )  # fmt: skip
                assert record.value is not None
                assert f"split={split}" in record.protocol


@pytest.mark.parametrize("method", METHODS)
def test_every_estimator_flies_and_is_compared(run, method):
    flight = HELD_OUT
    for estimator in ESTIMATORS:
        records = select(run.records, dataset=flight, flow=method, estimator=estimator)
        found = {record.metric: record for record in records}
        assert {"drift_percent", "rpe_trans_median_m", "rpe_rot_median_deg", "unsolved_fraction"} <= set(
            found
        )
        assert found["unsolved_fraction"].value == 0
        assert "residual=depth" in found["rpe_trans_median_m"].protocol
    for reference, name in (("ransac", "ransac"), (BASELINE, "opencv")):
        ratios = select(run.records, metric=f"rpe_trans_ratio_to_{name}", flow=method)
        assert {ratio.estimator for ratio in ratios} == set(ESTIMATORS) - {reference}
        for ratio in ratios:
            errors = [median_error(run, method, who) for who in (ratio.estimator, reference)]
            assert ratio.value == pytest.approx(errors[0] / errors[1])
            assert ratio.count == 10
            assert "bootstrap=blocks of 10 frames; interval_95=" in ratio.protocol


@pytest.mark.parametrize("method", METHODS)
def test_all_models_of_a_population_stand_in_the_same_figures(run, method):
    for dataset in ("planes-calibration", HELD_OUT):
        for kind, names in (("goodness", "families"), ("coverage", "names"), ("pit", "names")):
            shown = np.load(run.path / "data" / f"{kind}--{method}-{dataset}.npz")[names]
            assert {"lcm · texture", "gaussian · texture", "glc · index"} <= set(shown)


def median_error(run, method, estimator):
    arrays = np.load(run.path / "data" / f"frame-errors--{method}-{HELD_OUT}.npz")
    return np.median(arrays["translation"][list(arrays["names"]).index(estimator)])


def test_a_method_sees_only_its_flights(tmp_path):
    calibration = (Flight(0, "training", 6.0, 12), Flight(1, "training", 6.0, 6, ("lucas-kanade",)))
    done = reproduce(tmp_path / "run", replace(TINY, calibration=calibration))
    pairs = {m: load_likelihood(done.path / "models" / f"{m}.json").provenance["pairs"] for m in METHODS}
    assert pairs == {"farneback": 12, "lucas-kanade": 18}


def test_the_full_plan_has_the_papers_frame_counts():
    for method, frames in (("farneback", 1651), ("lucas-kanade", 6478)):
        assert sum(f.pairs for f in FULL.calibration if method in f.methods) == frames
    assert (FULL.width, FULL.height, FULL.fov_deg, FULL.world) == (640, 360, 120.0, "forest")


def test_a_share_of_a_plan_has_that_share_of_every_flight():
    some = FULL.shared(0.1)
    assert [f.pairs for f in some.held_out] == [100, 198]
    assert some.frames == pytest.approx(0.1 * FULL.frames, rel=0.01)
    assert FULL.shared(1.0) == FULL
    assert {f.pairs for f in QUICK.shared(0.01).calibration} == {2}


@pytest.mark.parametrize("plan", [QUICK, FULL])
def test_plans_hold_out_worlds_and_paths(plan):
    assert not {f.seed for f in plan.calibration} & {f.seed for f in plan.held_out}
    assert not {f.trajectory for f in plan.calibration} & {f.trajectory for f in plan.held_out}


def test_the_quick_plan_holds_out_a_speed():
    calibration, held_out = QUICK.calibration, QUICK.held_out
    assert {f.speed_mps for f in held_out} - {f.speed_mps for f in calibration}
    assert len({f.speed_mps for f in calibration}) > 1
    assert sum(f.pairs for f in held_out) >= 100
