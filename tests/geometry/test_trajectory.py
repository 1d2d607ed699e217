import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import RigidTransform, Rotation

from flowlik.errors import DataError
from flowlik.geometry.trajectory import (
    Trajectory,
    chain,
    read_kitti,
    read_trajectory,
    read_tum,
    write_kitti,
    write_tum,
)

IDENTITY_ROW = "1 0 0 0 0 1 0 0 0 0 1 0"


def random_trajectory(seed: int, count: int) -> Trajectory:
    rng = np.random.default_rng(seed)
    poses = RigidTransform.from_components(100 * rng.normal(size=(count, 3)), Rotation.random(count, rng=rng))
    return Trajectory(np.cumsum(rng.uniform(0.01, 1, count)), poses)


def test_positions_and_length_of_a_square():
    corners = [[0, 0, 0], [3, 0, 0], [3, 0, 4], [0, 0, 4]]
    trajectory = Trajectory(np.arange(4.0), RigidTransform.from_translation(corners))
    assert len(trajectory) == 4
    np.testing.assert_array_equal(trajectory.positions, corners)
    np.testing.assert_allclose(trajectory.distances, [0, 3, 7, 10])
    assert trajectory.length == 10


def test_a_single_pose_has_no_length():
    trajectory = random_trajectory(0, 1)
    assert len(trajectory) == 1
    assert trajectory.length == 0


@pytest.mark.parametrize(
    ("times", "message"),
    [([0, 1], "3 poses has 2 timestamps"), ([0, 1, 1], "must increase"), ([0, np.nan, 1], "not a finite")],
)
def test_times_that_do_not_fit_are_refused(times, message):
    with pytest.raises(DataError, match=message):
        Trajectory(times, RigidTransform.identity(3))


@pytest.mark.parametrize("poses", [RigidTransform.identity(), RigidTransform.identity(0)])
def test_no_poses_are_refused(poses):
    with pytest.raises(DataError, match="at least one pose"):
        Trajectory([], poses)


def test_chain_of_a_trajectorys_own_steps_gives_it_back():
    poses = random_trajectory(1, 300).poses
    steps = poses[1:].inv() * poses[:-1]  # T_k_prev
    chained = chain(list(steps))
    expected = poses[0].inv() * poses
    np.testing.assert_allclose(chained.as_matrix(), expected.as_matrix(), atol=1e-9)
    np.testing.assert_array_equal(chained[0].as_matrix(), np.eye(4))


def test_chain_of_one_turn_by_hand():
    # The camera moves 1 m forward and turns 90 deg to the right (about y), then 1 m forward again.
    T_prev_k = RigidTransform.from_components([0, 0, 1], Rotation.from_euler("y", 90, degrees=True))
    np.testing.assert_allclose(
        chain([T_prev_k.inv()] * 2).translation, [[0, 0, 0], [0, 0, 1], [1, 0, 1]], atol=1e-12
    )


def test_chain_of_nothing_is_the_identity():
    assert len(chain([])) == 1


@given(seed=st.integers(0, 2**32 - 1), count=st.integers(1, 20), format=st.sampled_from(["kitti", "tum"]))
@settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_files_keep_every_pose(tmp_path, seed, count, format):
    trajectory = random_trajectory(seed, count)
    path = tmp_path / "poses.txt"
    (write_kitti if format == "kitti" else write_tum)(path, trajectory)
    back = read_trajectory(path)
    np.testing.assert_allclose(back.poses.as_matrix(), trajectory.poses.as_matrix(), rtol=0, atol=1e-12)
    expected_times = np.arange(count) / 10 if format == "kitti" else trajectory.timestamps
    np.testing.assert_array_equal(back.timestamps, expected_times)


def test_tum_row_means_what_it_says(tmp_path):
    half = np.sqrt(0.5)
    (tmp_path / "t.txt").write_text(f"# t x y z qx qy qz qw\n1.5 1 2 3 0 0 {half} {half}\n")
    trajectory = read_tum(tmp_path / "t.txt")
    assert trajectory.timestamps.tolist() == [1.5]
    np.testing.assert_allclose(trajectory.poses.apply([1, 0, 0]), [[1, 3, 3]], atol=1e-12)


def test_kitti_row_means_what_it_says(tmp_path):
    (tmp_path / "k.txt").write_text("0 0 1 7 0 1 0 8 -1 0 0 9\n")
    np.testing.assert_allclose(read_kitti(tmp_path / "k.txt").poses.apply([0, 0, 1]), [[8, 8, 9]])


def test_times_file_gives_the_times(tmp_path):
    (tmp_path / "k.txt").write_text(f"{IDENTITY_ROW}\n" * 2)
    (tmp_path / "times.txt").write_text("0.5\n0.75\n")
    assert read_kitti(tmp_path / "k.txt", tmp_path / "times.txt").timestamps.tolist() == [0.5, 0.75]


@pytest.mark.parametrize(
    ("times", "message"),
    [
        ("0\n1\n2\n", "3 times for the 2 poses"),
        ("1\n0.5\n", "times.txt: times must increase"),
        ("0\nx\n", "line 2: 'x'"),
    ],
)
def test_bad_times_files(tmp_path, times, message):
    (tmp_path / "k.txt").write_text(f"{IDENTITY_ROW}\n" * 2)
    (tmp_path / "times.txt").write_text(times)
    with pytest.raises(DataError, match=message):
        read_kitti(tmp_path / "k.txt", tmp_path / "times.txt")


def test_rotations_of_few_decimals_are_mended(tmp_path):
    trajectory = random_trajectory(2, 50)
    rows = trajectory.poses.as_matrix()[:, :3].reshape(-1, 12)
    np.savetxt(tmp_path / "k.txt", rows, fmt="%.4f")
    R = read_kitti(tmp_path / "k.txt").poses.rotation.as_matrix()
    np.testing.assert_allclose(R @ R.transpose(0, 2, 1), np.tile(np.eye(3), (50, 1, 1)), atol=1e-12)
    np.testing.assert_allclose(R, trajectory.poses.rotation.as_matrix(), atol=2e-4)


@pytest.mark.parametrize(
    ("row", "message"),
    [
        ("0 " + IDENTITY_ROW, "13 columns, but expected 12 numbers"),
        (IDENTITY_ROW.replace("1", "nan", 1), "'nan'"),
        (IDENTITY_ROW.replace("1", "1.01", 1), "not a rotation"),
        (IDENTITY_ROW.replace("1", "-1", 1), "not a rotation"),
        ("0 " * 12, "not a rotation"),
    ],
)
def test_bad_kitti_rows_are_named_by_line(tmp_path, row, message):
    (tmp_path / "k.txt").write_text(f"{IDENTITY_ROW}\n{row}\n")
    with pytest.raises(DataError, match=f"k.txt, line 2: .*{message}") as caught:
        read_kitti(tmp_path / "k.txt")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("row", "message"),
    [
        ("1 0 0 0 0 0 1", "line 2: 7 columns, but expected 8 numbers"),
        ("1 0 0 0 0 0 0 0", "line 2: not a unit quaternion"),
        ("0 0 0 0 0 0 0 1", "times must increase"),
        ("1 0 inf 0 0 0 0 1", "line 2: 'inf'"),
    ],
)
def test_bad_tum_rows_are_named_by_line(tmp_path, row, message):
    (tmp_path / "t.txt").write_text(f"0 0 0 0 0 0 0 1\n{row}\n")
    with pytest.raises(DataError, match=f"t.txt.*{message}"):
        read_tum(tmp_path / "t.txt")


@pytest.mark.parametrize(
    ("text", "message"), [("", "empty"), ("1 2 3\n", "3 columns"), (None, "no such file")]
)
def test_files_of_no_known_format(tmp_path, text, message):
    if text is not None:
        (tmp_path / "p.txt").write_text(text)
    with pytest.raises(DataError, match=message):
        read_trajectory(tmp_path / "p.txt")


def test_times_for_a_tum_file_are_refused(tmp_path):
    write_tum(tmp_path / "t.txt", random_trajectory(0, 2))
    with pytest.raises(DataError, match="its own times"):
        read_trajectory(tmp_path / "t.txt", times=tmp_path / "times.txt")


def test_official_kitti_poses_are_read(shared_data):
    trajectory = read_kitti(shared_data / "kitti_poses/00.txt", shared_data / "kitti_poses/00_times.txt")
    assert len(trajectory) == 4541
    assert trajectory.length == pytest.approx(3724.187, abs=1e-3)
