"""What stands first in a report, from records alone."""

from dataclasses import replace

import pytest

from flowlik.report._judgements import graded_coverage, leaning
from flowlik.report.verdict import verdict_of
from flowlik.results.records import Record

FLIGHT = "forest-small-curve-6mps-seed1"


def model(metric, value, family="glc", schedule="index", data=FLIGHT, split="held-out"):
    note = f"split={split}; frames=3"
    return Record(metric, value, "", data, "dis", family, schedule, count=9, protocol=note)


def ratio(metric, value, low, high, flow="dis"):
    note = f"reference=x; interval_95={low} … {high}"
    return Record(
        metric, value, "", "held-out", flow, "glc", "index", "lcmsac-index", count=9, protocol=note
    )  # fmt: skip


UNSEEN = [
    model("coverage_90", 0.83),
    model("coverage_90", 0.79, data="b"),
    model("coverage_50", 0.45),
    model("coverage_50", 0.40, data="b"),
    model("coverage_90", 0.99, data="calibration", split="in sample"),
    model("coverage_90", 0.69, "lcm", "texture"),
    model("coverage_90", 0.93, "gaussian", "texture"),
    model("ks_median", 0.04),
    model("ks_median", 0.40, "gaussian", "texture"),
    ratio("rpe_trans_ratio_to_ransac", 0.93, 0.8, 1.1),
    ratio("rpe_trans_ratio_to_opencv", 0.64, 0.56, 0.78),
]


def test_unseen_data_decides_and_the_calibrations_own_does_not():
    verdict = verdict_of(UNSEEN)
    assert verdict.title == "Can these error bars be trusted? DIS, 2 unseen flights"
    first, second = verdict.sentences
    assert first == (
        "On 2 unseen flights, the 90 % intervals of the learned model held 79 to 83 % of errors: too bold "
        "(the paper's 69 %, the Gaussian's 93 %)."
    )
    assert second == (
        "With it, a frame's motion error was 0.93 (DIS, 0.80 … 1.10, not clear) of RANSAC's, and "
        "0.64 (DIS, 0.56 … 0.78) of OpenCV's."
    )
    assert verdict.coverage["learned"] == [[(0.5, 0.45), (0.9, 0.83)], [(0.5, 0.40), (0.9, 0.79)]]
    rows = {label: cells[0] for label, cells in verdict.rows}
    assert rows["90 % intervals hold, learned"].grade == "poor"
    assert rows["90 % intervals hold, Gaussian"].grade == "good"
    assert (rows["misfit (K-S), learned"].grade, rows["misfit (K-S), Gaussian"].grade) == ("good", "poor")
    assert rows["motion error over RANSAC's"].grade == "fair"
    assert rows["motion error over OpenCV's"].grade == "good"
    assert len(verdict.limits) == 3


def test_a_motion_that_is_clearly_worse_is_poor():
    worse = [*UNSEEN[:-1], ratio("rpe_trans_ratio_to_opencv", 1.3, 1.1, 1.5)]
    rows = {label: cells[0] for label, cells in verdict_of(worse).rows}
    assert rows["motion error over OpenCV's"].grade == "poor"


def test_what_is_in_sample_says_so():
    records = [model("coverage_90", 0.9, data="calibration", split="in sample")]
    verdict = verdict_of(records)
    assert verdict.in_sample
    assert "in sample" in verdict.sentences[0] and "about right" in verdict.sentences[0]
    assert "flowlik evaluate" in verdict.sentences[1]


@pytest.mark.parametrize(
    ("values", "text"),
    [
        ([0.9], "about right"),
        ([0.84, 0.86], "too bold"),
        ([0.84, 0.9], "about right to too bold"),
        ([0.97], "too cautious"),
        ([0.9, 0.97], "about right to too cautious"),
        ([0.7, 0.99], "too bold here, too cautious there"),
    ],
)
def test_intervals_are_called_bold_or_cautious(values, text):
    assert leaning(values) == text


@pytest.mark.parametrize(
    ("values", "grade"),
    [
        ([0.85, 0.95], "good"),
        ([0.84, 0.9], "fair"),
        ([0.9, 0.98], "fair"),
        ([0.79], "poor"),
        ([0.99], "poor"),
    ],
)
def test_the_worst_value_is_graded(values, grade):
    assert graded_coverage(values).grade == grade


def test_a_pair_says_how_far_its_flow_is_known():
    note = "confidence=0.9; vectors=5; lost=0"
    keys = {"dataset": "a.png to b.png", "flow": "farneback", "family": "glc", "schedule": "index"}
    base = Record("half_width_e1_median_px", 0.12, "px", **keys, protocol=note)
    records = [
        base,
        replace(base, metric="half_width_e2_median_px", value=0.61),
        replace(base, metric="within_half_px_fraction", value=0.43, unit=""),
        replace(base, metric="outside_fraction", value=0.2, unit=""),
    ]
    verdict = verdict_of(records)
    assert verdict.title == "How far can this flow be trusted? Farnebäck, a.png to b.png"
    assert "±0.12 px along their best direction and to ±0.61 px along their worst" in verdict.sentences[0]
    assert "43 %" in verdict.sentences[1]
    assert verdict.rows[0][1][0].grade == "poor"
    with_truth = verdict_of([*records, replace(base, metric="coverage_90", value=0.88, unit="")])
    assert "88 % hold the true flow: about right" in with_truth.sentences[1]


def test_an_odometry_says_what_was_solved_and_how_far_off_it_is():
    base = Record("unsolved_fraction", 0.02, "", "KITTI-03", "dis", "glc", "index", "lcmsac", 100)
    verdict = verdict_of([base])
    assert verdict.sentences[0] == "98 of 100 motions were solved from the images; the others are predicted."
    assert "no true trajectory" in verdict.sentences[1]
    assert verdict.rows[0][1][0].grade == "fair"
    found = verdict_of(
        [replace(base, value=0.0), replace(base, metric="t_err_percent", value=0.61, unit="%")]
    )
    assert found.sentences == (
        "All 100 motions were solved from the images.",
        "KITTI's translation error is 0.61 %.",
    )


def test_rivals_on_one_drive_stand_side_by_side():
    base = Record("t_err_percent", 0.6, "%", "KITTI-03", "dis", None, None, "nominal", 100)
    verdict = verdict_of([base, replace(base, estimator="poselib", value=0.7)])
    assert verdict.columns == ("KITTI-03",)
    assert [(label, cells[0].text) for label, cells in verdict.rows] == [
        ("nominal", "0.6 %"),
        ("PoseLib", "0.7 %"),
    ]


def test_a_gauntlet_counts_its_cells():
    base = Record("grossly_wrong_rate", 0.0, "", "pan", "dis", "glc", "index", "lcmsac", 10)
    verdict = verdict_of([base, replace(base, dataset="rail", value=0.5)])
    assert verdict.title == "How often is a motion surely wrong? 2 situations"
    assert [cell.text for cell in verdict.rows[0][1]] == ["25.0 %", "1 of 2"]


def test_nothing_to_judge_is_no_verdict():
    assert verdict_of([], "flowlik simulate planes").title == "Results of flowlik simulate"
