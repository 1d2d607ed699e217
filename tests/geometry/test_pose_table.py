"""Files of poses in all their layouts."""

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from flowlik.errors import DataError
from flowlik.geometry.pose_table import camera_poses, ned_poses, read_pose_table
from flowlik.geometry.trajectory import read_trajectory

COUNT = 5
TIMES = 1305031449 + 0.1 * np.arange(COUNT)
FRAMES = np.array([0, 2, 3, 7, 8])


def poses() -> RigidTransform:
    rng = np.random.default_rng(0)
    return RigidTransform.from_components(rng.normal(size=(COUNT, 3)), Rotation.random(COUNT, rng=rng))


def rows(columns: int) -> np.ndarray:
    T = poses()
    matrices, quaternions = T.as_matrix(), T.rotation.as_quat()
    key = FRAMES[:, None].astype(float)
    ned = ned_poses(T)
    return {
        7: np.column_stack([ned.translation, ned.rotation.as_quat()]),
        8: np.column_stack([TIMES, T.translation, quaternions]),
        12: matrices[:, :3].reshape(COUNT, 12),
        13: np.column_stack([key, matrices[:, :3].reshape(COUNT, 12)]),
        16: matrices.reshape(COUNT, 16),
        17: np.column_stack([key, matrices.reshape(COUNT, 16)]),
    }[columns]


def write(path, table):
    np.savetxt(path, table, fmt="%.17g")
    return path


def write_euroc(path):
    lines = ["#timestamp, p_RS_R_x [m], ..."]
    for t, p, q in zip(TIMES, poses().translation, poses().rotation.as_quat(scalar_first=True)):
        lines.append(",".join([str(round(t * 1e9)), *map(repr, map(float, [*p, *q])), "0.1", "0.2"]))
    path.write_text("\r\n".join(lines) + "\r\n")
    return path


@pytest.mark.parametrize("columns", [7, 8, 12, 13, 16, 17])
def test_every_layout_holds_the_same_poses(tmp_path, columns):
    table = read_pose_table(write(tmp_path / "p.txt", rows(columns)))
    np.testing.assert_allclose(table.poses.as_matrix(), poses().as_matrix(), atol=1e-12)
    assert (table.times_s is not None) == (columns == 8)
    assert (table.frames is not None) == (columns in (13, 17))
    if table.frames is not None:
        np.testing.assert_array_equal(table.frames, FRAMES)
    times = read_trajectory(tmp_path / "p.txt").timestamps
    expected = TIMES if columns == 8 else (FRAMES if columns in (13, 17) else np.arange(COUNT)) / 10
    np.testing.assert_allclose(times, expected, atol=1e-6)


def test_euroc(tmp_path):
    table = read_pose_table(write_euroc(tmp_path / "data.csv"))
    np.testing.assert_allclose(table.poses.as_matrix(), poses().as_matrix(), atol=1e-12)
    np.testing.assert_allclose(table.times_s, TIMES, atol=1e-6)
    assert table.of_body


def test_a_first_column_with_fractions_is_times(tmp_path):
    table = rows(13)
    table[:, 0] = TIMES + 0.05
    found = read_pose_table(write(tmp_path / "p.txt", table))
    np.testing.assert_allclose(found.times_s, TIMES + 0.05, atol=1e-6)
    assert found.frames is None


def test_axes_of_tartanair_by_hand():
    ahead = RigidTransform.from_components([[1.0, 0, 0]], Rotation.from_rotvec([[0, 0, 0.2]]))
    camera = camera_poses(ahead)  # forward along x, turned to the right about z, which points down
    np.testing.assert_allclose(camera.translation, [[0, 0, 1]])
    np.testing.assert_allclose(camera.rotation.as_rotvec(), [[0, 0.2, 0]], atol=1e-15)
    np.testing.assert_allclose(ned_poses(camera).as_matrix(), ahead.as_matrix(), atol=1e-15)


@pytest.mark.parametrize("columns", [8, 13, 17])
def test_rows_out_of_order_and_double_are_refused_or_sorted(tmp_path, columns):
    table = rows(columns)
    doubled = table[[0, 2, 1, 1, 3, 4]]
    doubled[3, 1:] = doubled[4, 1:]  # the second of a time is another pose
    path = write(tmp_path / "p.txt", doubled)
    message = "times must increase, but number 1 is"
    with pytest.raises(DataError, match=message):
        read_pose_table(path)
    found = read_pose_table(path, lenient=True)
    assert (len(found), found.left_out) == (COUNT, 1)
    np.testing.assert_allclose(found.poses.as_matrix(), poses().as_matrix(), atol=1e-12)


def test_epoch_times_are_told_with_all_their_digits(tmp_path):
    table = rows(8)
    table[2, 0] = table[1, 0]
    with pytest.raises(DataError, match=r"number 1 is 1305031449\.1 s and the next 1305031449\.1 s"):
        read_pose_table(write(tmp_path / "p.txt", table))


@pytest.mark.parametrize(
    ("columns", "change", "message"),
    [
        (7, lambda t: t[1, 3:].__imul__(0.9), "line 2: not a unit quaternion"),
        (13, lambda t: t[1, 1:4].__imul__(1.1), "line 2: not a rotation"),
        (16, lambda t: t[2, 15:].__imul__(2), "line 3: its last four numbers are not 0 0 0 1"),
        (16, lambda t: t.__setitem__(2, t[2].reshape(4, 4).T.ravel()), "line 3: .* not 0 0 0 1"),
    ],
)
def test_bad_rows_are_named_by_line(tmp_path, columns, change, message):
    table = rows(columns)
    change(table)
    with pytest.raises(DataError, match=f"p.txt, {message}"):
        read_pose_table(write(tmp_path / "p.txt", table))


def test_a_file_of_no_layout_is_told_which_there_are(tmp_path):
    with pytest.raises(DataError, match=r"its first row has 9 columns, but expected 7 .*17 numbers.*EuRoC"):
        read_pose_table(write(tmp_path / "p.txt", np.ones((2, 9))))
    (tmp_path / "e.csv").write_text("1.5,0,0,0,1,0,0,0\n")
    with pytest.raises(DataError, match=r"line 1: '1\.5' is not a time \[ns\]"):
        read_pose_table(tmp_path / "e.csv")
