from itertools import pairwise

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from flowlik.errors import DataError
from flowlik.evaluation.motion import (
    absolute_trajectory_error,
    drift_percent,
    kitti_errors,
    relative_pose_errors,
)
from flowlik.evaluation.motion._drift import direction_offset, remove_direction_offset
from flowlik.geometry.trajectory import Trajectory, chain, read_kitti


def wandering(seed: int, frames: int = 200, step_m: float = 1.0) -> Trajectory:
    """A path that mostly goes forward, with gentle turns."""
    rng = np.random.default_rng(seed)
    rotations = Rotation.from_rotvec(rng.normal(0, 0.02, (frames - 1, 3)))
    moves = rng.normal([0, 0, step_m], 0.1 * step_m, (frames - 1, 3))
    return Trajectory(np.arange(frames) / 10, chain(RigidTransform.from_components(moves, rotations).inv()))


def moved(trajectory: Trajectory, transform: RigidTransform) -> Trajectory:
    return Trajectory(trajectory.timestamps, transform * trajectory.poses)


def scaled(trajectory: Trajectory, scale: float) -> Trajectory:
    poses = RigidTransform.from_components(scale * trajectory.positions, trajectory.poses.rotation)
    return Trajectory(trajectory.timestamps, poses)


def devkit(estimated: Trajectory, truth: Trajectory) -> np.ndarray:
    """The KITTI devkit's loops, written out: rows (first frame, length, t_err, r_err)."""
    gt, est = truth.poses.as_matrix(), estimated.poses.as_matrix()
    dist = [0.0]
    for a, b in pairwise(gt):
        dist.append(dist[-1] + np.linalg.norm(a[:3, 3] - b[:3, 3]))
    rows = []
    for first in range(0, len(gt), 10):
        for length in range(100, 900, 100):
            last = next((i for i in range(first, len(gt)) if dist[i] > dist[first] + length), None)
            if last is None:
                continue
            error = np.linalg.inv(np.linalg.inv(est[first]) @ est[last]) @ (
                np.linalg.inv(gt[first]) @ gt[last]
            )
            angle = np.arccos(np.clip(0.5 * (np.trace(error[:3, :3]) - 1), -1, 1))
            rows.append([first, length, np.linalg.norm(error[:3, 3]) / length, angle / length])
    return np.array(rows)


def test_a_perfect_estimate_has_no_error_whatever_its_first_pose():
    truth = wandering(0)
    estimated = moved(truth, RigidTransform.from_components([5, -3, 2], Rotation.from_rotvec([0.3, 1, -2])))
    assert drift_percent(estimated, truth) == pytest.approx(0, abs=1e-10)
    assert absolute_trajectory_error(estimated, truth) == pytest.approx(0, abs=1e-10)
    errors = kitti_errors(estimated, truth)
    assert errors.t_err_percent == pytest.approx(0, abs=1e-10)
    assert errors.r_err_deg_per_100m == pytest.approx(0, abs=1e-5)
    assert np.abs(relative_pose_errors(estimated, truth).direction_rad).max() < 1e-6


def test_drift_of_a_closed_loop_by_hand():
    square = np.array([[0, 0, 0], [5, 0, 0], [5, 0, 5], [0, 0, 0]], dtype=float)
    truth = Trajectory(np.arange(4.0), RigidTransform.from_translation(square))
    square[-1] += [0, 0.3, 0.4]
    estimated = Trajectory(np.arange(4.0), RigidTransform.from_translation(square))
    assert drift_percent(estimated, truth) == pytest.approx(100 * 0.5 / (10 + 50**0.5))


def test_a_scale_error_is_drift_of_that_share_on_a_straight_line():
    truth = Trajectory(
        np.arange(151.0), RigidTransform.from_translation(np.outer(np.arange(151.0), [0, 0, 1]))
    )
    estimated = scaled(truth, 1.02)
    assert drift_percent(estimated, truth) == pytest.approx(2)
    # A segment ends at the first frame beyond its length, here 101 m, but is divided by 100 m.
    assert kitti_errors(estimated, truth).t_err_percent == pytest.approx(2 * 1.01)


def test_kitti_errors_are_the_devkits():
    truth = wandering(1, 400, step_m=2.5)
    estimated = wandering(2, 400, step_m=2.5)
    expected, errors = devkit(estimated, truth), kitti_errors(estimated, truth)
    s = errors.segments
    assert len(s) > 100
    np.testing.assert_array_equal(np.column_stack([s.first, s.length_m]), expected[:, :2])
    np.testing.assert_allclose(s.t_err_percent, 100 * expected[:, 2], rtol=1e-9)
    np.testing.assert_allclose(s.r_err_deg_per_100m, 100 * np.rad2deg(expected[:, 3]), rtol=1e-6)
    assert errors.t_err_percent == pytest.approx(s.t_err_percent.mean())
    assert errors.reason == ""


def test_a_path_too_short_for_the_kitti_metric_gives_none_and_a_reason():
    errors = kitti_errors(wandering(3, 50), wandering(4, 50))
    assert errors.t_err_percent is None
    assert errors.r_err_deg_per_100m is None
    assert len(errors.segments) == 0
    assert "100 m" in errors.reason


@pytest.mark.parametrize(
    ("name", "t_err", "r_err", "tolerance"),
    [
        ("evo/KITTI_00_ORB.txt", 0.6997, 0.2533, 5e-5),
        ("evo/KITTI_00_SPTAM.txt", 1.487, 0.558, 5e-4),
        # Four decimals a rotation: what mending them changes is about 0.004 deg / 100 m.
        ("mono_scale_recovery/00_scale.txt", 1.713, 0.289, 5e-3),
        ("kitti_odom_eval/example_1/09.txt", 2.607, 0.288, 5e-4),
        ("kitti_odom_eval/example_1/10.txt", 2.293, 0.369, 5e-4),
    ],
)
def test_published_trajectories_have_their_known_errors(shared_data, name, t_err, r_err, tolerance):
    sequence = "00" if "00" in name else name[-6:-4]
    estimated = read_kitti(shared_data / "kitti_trajectories" / name)
    truth = read_kitti(shared_data / f"kitti_poses/{sequence}.txt")
    errors = kitti_errors(estimated, truth)
    assert errors.t_err_percent == pytest.approx(t_err, abs=tolerance)
    assert errors.r_err_deg_per_100m == pytest.approx(r_err, abs=tolerance)


def test_published_trajectory_has_its_known_ate(shared_data):
    truth = read_kitti(shared_data / "kitti_poses/10.txt")
    positions = np.loadtxt(shared_data / "kitti_trajectories/tartanvo/kitti_10_tartanvo_1914.txt")[:, :3]
    estimated = Trajectory(truth.timestamps, RigidTransform.from_translation(positions))
    assert absolute_trajectory_error(estimated, truth, align="sim3") == pytest.approx(11.84, abs=0.005)


def test_ate_alignments_undo_what_they_say():
    truth = wandering(5)
    motion = RigidTransform.from_components([5, -3, 2], Rotation.from_rotvec([0.3, 1, -2]))
    assert absolute_trajectory_error(moved(truth, motion), truth, align="se3") == pytest.approx(0, abs=1e-9)
    bigger = moved(scaled(truth, 3), motion)
    assert absolute_trajectory_error(bigger, truth, align="sim3") == pytest.approx(0, abs=1e-9)
    assert absolute_trajectory_error(bigger, truth, align="se3") > 1


def test_sim3_alignment_is_a_least_squares_optimum():
    truth, estimated = wandering(6), wandering(7)
    best = absolute_trajectory_error(estimated, truth, align="sim3")
    assert best <= absolute_trajectory_error(estimated, truth, align="se3")
    for scale in (0.99, 1.01):
        assert absolute_trajectory_error(scaled(estimated, scale), truth, "sim3") == pytest.approx(best)


def test_relative_errors_by_hand():
    truth = Trajectory([0, 1, 2], RigidTransform.from_translation([[0, 0, 0], [0, 0, 1], [0, 0, 1]]))
    turn = Rotation.from_rotvec(np.outer([0, 2, 2], [0, 1, 0]), degrees=True)
    estimated = Trajectory([0, 1, 2], RigidTransform.from_components([[0, 0, 0], [0, 1, 1], [0, 1, 1]], turn))
    errors = relative_pose_errors(estimated, truth)
    np.testing.assert_allclose(errors.translation_m, [1, 0], atol=1e-12)
    np.testing.assert_allclose(errors.rotation_deg, [2, 0], atol=1e-9)
    np.testing.assert_allclose(errors.direction_rad, [np.pi / 4, np.nan])


def tilted(truth: Trajectory, offset: np.ndarray) -> Trajectory:
    """Truth with the same offset added to the direction of every step, in the previous camera's frame."""
    steps = truth.poses[:-1].inv() * truth.poses[1:]
    lengths = np.linalg.norm(steps.translation, axis=1, keepdims=True)
    directions = steps.translation / lengths + offset
    moves = lengths * directions / np.linalg.norm(directions, axis=1, keepdims=True)
    return Trajectory(truth.timestamps, chain(RigidTransform.from_components(moves, steps.rotation).inv()))


def test_a_constant_offset_is_found_and_removed():
    truth = wandering(8)
    offset = np.array([0.006, 0.001, 0.0])
    estimated = tilted(truth, offset)
    found = direction_offset(estimated, truth)
    np.testing.assert_allclose(found, offset, atol=1e-4)
    assert drift_percent(estimated, truth) > 0.3
    assert drift_percent(remove_direction_offset(estimated, found), truth) < 0.02


def test_removal_keeps_step_lengths_rotations_and_the_first_pose():
    truth = moved(wandering(9), RigidTransform.from_components([1, 2, 3], Rotation.from_rotvec([1, 0, 0])))
    mended = remove_direction_offset(truth, np.array([0.1, -0.2, 0.05]))
    np.testing.assert_allclose(mended.distances, truth.distances)
    np.testing.assert_allclose(
        mended.poses.rotation.as_matrix(), truth.poses.rotation.as_matrix(), atol=1e-12
    )
    np.testing.assert_allclose(mended.positions[0], truth.positions[0])
    same = remove_direction_offset(truth, np.zeros(3))
    np.testing.assert_allclose(same.positions, truth.positions, atol=1e-9)


def test_standing_still_is_no_direction():
    still = Trajectory(np.arange(5.0), RigidTransform.identity(5))
    with pytest.raises(DataError, match="no step"):
        direction_offset(still, still)
    np.testing.assert_array_equal(remove_direction_offset(still, np.array([0.1, 0, 0])).positions, 0)
    with pytest.raises(DataError, match="no length"):
        drift_percent(still, still)


def test_short_steps_do_not_count():
    truth = wandering(10, step_m=0.2)
    with pytest.raises(DataError, match=r"0\.5 m"):
        direction_offset(truth, truth, min_step_m=0.5)


@pytest.mark.parametrize(
    "metric",
    [drift_percent, kitti_errors, relative_pose_errors, direction_offset, absolute_trajectory_error],
)
def test_different_numbers_of_poses_are_refused(metric):
    with pytest.raises(DataError, match="20 poses, the true one 30"):
        metric(wandering(0, 20), wandering(0, 30))


def test_one_pose_has_no_steps_but_no_crash_either():
    single = wandering(0, 1)
    assert len(relative_pose_errors(single, single).rotation_deg) == 0
    assert kitti_errors(single, single).t_err_percent is None
    assert len(remove_direction_offset(single, np.zeros(3))) == 1
