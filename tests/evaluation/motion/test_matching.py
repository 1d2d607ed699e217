"""Rows of two files of poses that belong together, and the drift of what matches."""

import json

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from flowlik.commands import drift
from flowlik.commands.options import DriftOptions
from flowlik.errors import DataError
from flowlik.evaluation.motion import absolute_trajectory_error, drift_percent
from flowlik.evaluation.motion._drift import aligned
from flowlik.geometry.trajectory import Trajectory, write_kitti
from flowlik.results.records import select
from tests.cli.call import call, succeed
from tests.evaluation.motion.test_drift import moved, scaled, wandering

FRAMES = 600
START_S = 1305031449.0


def curve() -> RigidTransform:
    """Half a metre a frame along a winding way: its length and drift by rows are far from zero."""
    k = np.arange(FRAMES)
    R = Rotation.from_euler("y", np.cumsum(0.01 * np.sin(k / 50))[:, None])
    p = np.cumsum(R.apply(np.tile([0, 0, 0.5], (FRAMES, 1))), axis=0)
    return RigidTransform.from_components(p, R)


def tum(path, rows, late_s=0.0):
    T = curve()[rows]
    times = START_S + 0.1 * np.arange(FRAMES)[rows] + late_s
    np.savetxt(path, np.column_stack([times, T.translation, T.rotation.as_quat()]), fmt="%.9f")
    return path


def numbered(path, rows):
    T = curve()[rows]
    table = np.column_stack([np.arange(FRAMES)[rows], T.as_matrix()[:, :3].reshape(len(T), 12)])
    np.savetxt(path, table, fmt="%.17g")
    return path


def kitti(path, rows):
    write_kitti(path, Trajectory(np.arange(len(rows)), curve()[rows]))
    return path


def euroc(path, rows):
    T = curve()[rows]
    with path.open("w") as file:
        for n, p, q in zip(np.arange(FRAMES)[rows], T.translation, T.rotation.as_quat(scalar_first=True)):
            file.write(
                f"{round((START_S + 0.1 * n) * 1e9)}," + ",".join(map(repr, map(float, [*p, *q]))) + "\n"
            )
    return path


def figures(found):
    return {record.metric: record.value for record in found.records}


EVERY = np.arange(FRAMES)
MISSING = {
    "half": (EVERY[::2], EVERY[: FRAMES // 2], FRAMES // 4),
    "gap": (np.delete(EVERY, 100), EVERY[:-1], FRAMES - 2),
    "same": (EVERY, EVERY, FRAMES),
    "sparse truth": (EVERY, EVERY[7::13], len(EVERY[7::13])),
}


@pytest.mark.parametrize("rows", MISSING.values(), ids=MISSING)
@pytest.mark.parametrize(
    ("first", "second", "by"),
    [(tum, tum, "time"), (tum, euroc, "time"), (numbered, numbered, "number")],
    ids=["tum", "euroc", "numbers"],
)
def test_a_perfect_estimate_has_no_error_whatever_rows_are_missing(tmp_path, rows, first, second, by):
    mine, theirs, common = rows
    found = drift(first(tmp_path / "a.txt", mine), second(tmp_path / "b.txt", theirs))
    values = figures(found)
    for metric in ("drift_percent", "ate_rmse_m", "rpe_trans_median_m", "rpe_rot_median_deg"):
        assert values[metric] == pytest.approx(0, abs=1e-5), metric
    if values["t_err_percent"] is not None:
        assert values["t_err_percent"] == pytest.approx(0, abs=1e-5)
    matched = f"{common} of {len(mine)} estimated and {len(theirs)} true rows"
    assert found.said[0].startswith(f"matched by {by}: {matched}")
    (record,) = select(found.records, metric="drift_percent")
    assert record.count == common
    assert f"matched={matched}" in record.protocol and "align=none" in record.protocol


def test_a_file_with_numbers_is_matched_to_rows_that_count(tmp_path):
    found = drift(numbered(tmp_path / "a.txt", EVERY[50::3]), kitti(tmp_path / "b.txt", EVERY))
    assert figures(found)["ate_rmse_m"] == pytest.approx(0, abs=1e-9)
    assert "matched by number" in found.said[0]


def test_rows_are_matched_by_place_only_where_there_is_one_for_each(tmp_path):
    a, b = kitti(tmp_path / "a.txt", EVERY), kitti(tmp_path / "b.txt", EVERY[:-1])
    assert figures(drift(a, a))["ate_rmse_m"] == 0
    with pytest.raises(DataError, match="600 rows, the true one 599, and neither has times or frame numbers"):
        drift(a, b)


def test_times_are_given_to_a_file_that_has_none(tmp_path):
    a, b = kitti(tmp_path / "a.txt", EVERY[::2]), tum(tmp_path / "b.txt", EVERY[100:])
    with pytest.raises(DataError, match="the estimated trajectory has no times, the other has: --times"):
        drift(a, b)
    times = tmp_path / "times.txt"
    np.savetxt(times, START_S + 0.1 * EVERY[::2], fmt="%.9f")
    found = drift(a, b, DriftOptions(times=times))
    assert figures(found)["ate_rmse_m"] == pytest.approx(0, abs=1e-6)
    assert "250 of 300 estimated and 500 true rows" in found.said[0]
    np.savetxt(times, START_S + 0.1 * EVERY, fmt="%.9f")
    with pytest.raises(DataError, match="600 times for the 300 poses"):
        drift(a, b, DriftOptions(times=times))
    found = drift(numbered(tmp_path / "n.txt", EVERY[::2]), b, DriftOptions(times=times))
    assert figures(found)["ate_rmse_m"] == pytest.approx(0, abs=1e-6)


def test_the_largest_difference_counts(tmp_path):
    a, b = tum(tmp_path / "a.txt", EVERY, late_s=0.015), tum(tmp_path / "b.txt", EVERY)
    with pytest.raises(
        DataError, match=r"0 rows match within 0\.01 s in time: the estimate is of 1305031449\.015"
    ):
        drift(a, b)
    found = drift(a, b, DriftOptions(max_difference_s=0.02))
    assert "at most 0.015 s apart" in found.said[0]
    assert "max_difference_s=0.02; largest_s=0.015" in found.records[0].protocol
    with pytest.raises(DataError, match="must be at least 0 s, not nan"):
        drift(a, b, DriftOptions(max_difference_s=float("nan")))


def test_rows_out_of_order_are_sorted_where_that_is_asked_for(tmp_path):
    a = tum(tmp_path / "a.txt", np.concatenate([EVERY[300:], EVERY[:301]]))
    b = tum(tmp_path / "b.txt", EVERY)
    with pytest.raises(DataError, match=r"a\.txt: times must increase"):
        drift(a, b)
    found = drift(a, b, DriftOptions(skip_bad_frames=True))
    assert figures(found)["ate_rmse_m"] == pytest.approx(0, abs=1e-6)
    assert f"{a}: 1 rows left out" in found.said[1]


@pytest.mark.parametrize(
    ("align", "errors"),
    [("none", (True, True)), ("se3", (False, True)), ("sim3", (False, False))],
)
def test_alignment_undoes_what_it_says(align, errors):
    truth = wandering(3)
    turned = moved(truth, RigidTransform.from_components([4, 5, -6], Rotation.from_rotvec([0.3, -0.2, 1.0])))
    about_start = aligned(turned, truth)  # the first pose shared: nothing is left of the turn
    assert absolute_trajectory_error(about_start, truth) == pytest.approx(0, abs=1e-9)
    bent = Trajectory(
        truth.timestamps,
        RigidTransform.from_components(
            turned.positions, Rotation.from_rotvec([0, 0.01, 0]) * turned.poses.rotation
        ),
    )
    for estimated, wrong in zip((bent, scaled(bent, 1.5)), errors):
        assert (absolute_trajectory_error(estimated, truth, align) > 0.1) == wrong
        assert (drift_percent(estimated, truth, align) > 0.1) == wrong
    with pytest.raises(DataError, match="unknown alignment 'x': known are none, se3, sim3"):
        aligned(truth, truth, "x")


def test_alignment_turns_rotations_with_the_positions():
    truth = wandering(4)
    T = RigidTransform.from_components([4, 5, -6], Rotation.from_rotvec([0.3, -0.2, 1.0]))
    back = aligned(scaled(moved(truth, T), 2.0), truth, "sim3")
    np.testing.assert_allclose(back.poses.as_matrix(), truth.poses.as_matrix(), atol=1e-9)


def test_the_command_says_what_matched_and_how_it_was_aligned(tmp_path):
    a, b = euroc(tmp_path / "a.csv", EVERY[::2]), tum(tmp_path / "b.txt", EVERY)
    outcome = succeed("drift", a, b, "--align", "sim3", "--json")
    assert outcome.err[0].startswith("matched by time: 300 of 300 estimated and 600 true rows, at most ")
    assert outcome.err[1] == f"{a}: poses of the robot's body, not of a camera"
    records = json.loads(outcome.out)
    assert all("align=sim3" in record["protocol"] for record in records)
    outcome = call("drift", a, b, "--align", "se2")
    assert (outcome.code, outcome.err[-1]) == (
        2,
        "flowlik: unknown alignment 'se2': known are none, se3, sim3",
    )


def test_published_numbers_and_axes(shared_data):
    """An estimate with frame numbers and gaps, and one in NED axes, against KITTI's rows."""
    estimates = shared_data / "kitti_trajectories"
    found = drift(estimates / "kitti_odom_eval/example_0/10.txt", shared_data / "kitti_poses/10.txt")
    assert "matched by number" in found.said[0]
    found = drift(
        estimates / "tartanvo/kitti_10_tartanvo_1914.txt",
        shared_data / "kitti_poses/10.txt",
        DriftOptions(align="sim3"),
    )
    assert figures(found)["ate_rmse_m"] == pytest.approx(11.84, abs=0.005)
