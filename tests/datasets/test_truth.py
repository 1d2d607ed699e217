"""True poses of a file, given to a sequence."""

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from flowlik.datasets import open_sequence
from flowlik.datasets.base import notes_of
from flowlik.datasets.selection import select_frames, whole_pair
from flowlik.datasets.truth import with_truth
from flowlik.errors import DataError

from .fakes import HEIGHT, WIDTH, picture, save
from .ros_bags import Message, make_bag
from .test_euroc import P_B_C, R_B_C, body_pose, make_euroc

COUNT = 8
TIMES = 1305031449 + 0.1 * np.arange(COUNT)


def pose(k):
    return RigidTransform.from_components([0.1 * k, 0, k], Rotation.from_rotvec([0, 0.01 * k, 0]))


def make_images(root, times=True):
    for k in range(COUNT):
        save(root / "walk" / f"{k}.png", picture(k))
    if times:
        (root / "walk/times.txt").write_text("".join(f"{t:.6f}\n" for t in TIMES))
    return root / "walk"


def write_tum(path, frames, late_s=0.0):
    rows = [[TIMES[k] + late_s, *pose(k).translation, *pose(k).rotation.as_quat()] for k in frames]
    np.savetxt(path, rows, fmt="%.9f")
    return path


def write_kitti(path, frames, numbered):
    rows = [pose(k).as_matrix()[:3].ravel() for k in frames]
    np.savetxt(path, np.column_stack([frames, rows]) if numbered else rows)
    return path


def check(sequence, frames):
    assert len(sequence) == len(frames)
    for k, n in enumerate(frames):
        np.testing.assert_array_equal(sequence.image(k), picture(n))
        np.testing.assert_allclose(sequence.T_n_c(k).as_matrix(), pose(n).as_matrix(), atol=1e-8)


def test_poses_are_matched_by_time_and_images_without_left_out(tmp_path):
    images = open_sequence(make_images(tmp_path))
    sequence = with_truth(images, write_tum(tmp_path / "t.txt", [1, 2, 4, 5, 7], late_s=0.012))
    check(sequence, [1, 2, 4, 5, 7])
    assert "3 of 8 images have no pose there and are left out" in notes_of(sequence)[0]
    chosen, _ = select_frames(sequence, 1, 3)
    assert chosen.numbers.tolist() == [2, 4, 5]
    assert whole_pair(chosen, 1) == (images, 4)
    assert whole_pair(chosen, 0)[0] is not images  # frames 2 and 4 are no neighbours


def test_poses_without_times_are_those_of_numbers_or_of_all_frames(tmp_path):
    images = open_sequence(make_images(tmp_path, times=False))
    check(with_truth(images, write_kitti(tmp_path / "n.txt", [0, 3, 6], numbered=True)), [0, 3, 6])
    check(with_truth(images, write_kitti(tmp_path / "k.txt", range(COUNT), numbered=False)), range(COUNT))
    with pytest.raises(DataError, match="7 poses for the 8 images of image-folder/walk"):
        with_truth(images, write_kitti(tmp_path / "k.txt", range(COUNT - 1), numbered=False))


@pytest.mark.parametrize("first", [0, 100])
def test_images_after_a_gap_keep_their_poses_and_times(tmp_path, first):
    """Of eight images two were deleted: those after them are not those of the next rows."""
    images, there = make_images(tmp_path, times=False), [0, 1, 3, 4, 6, 7]
    for k in range(COUNT):
        if k in there:
            (images / f"{k}.png").rename(images / f"{first + k:04d}.png")
        else:
            (images / f"{k}.png").unlink()
    folder = open_sequence(images, frames_per_second=10)
    assert [folder.timestamp(k) for k in range(6)] == pytest.approx([k / 10 for k in there])
    missing = f"missing between {first + 1:04d}.png and {first + 3:04d}.png and at 1 other places"
    assert missing in notes_of(folder)[0]

    def poses(frames, name, numbered):
        return with_truth(folder, write_kitti(tmp_path / name, frames, numbered))

    for sequence in (poses(range(COUNT), "n.txt", True), poses(range(COUNT), "k.txt", False),
                     poses(there, "t.txt", False)):  # fmt: skip
        assert len(sequence) == 6
        for k, n in enumerate(there):
            np.testing.assert_array_equal(sequence.image(k), picture(n))
            np.testing.assert_allclose(sequence.T_n_c(k).as_matrix(), pose(n).as_matrix(), atol=1e-8)
    rows = np.loadtxt(tmp_path / "n.txt")
    rows[:, 0] += first
    np.savetxt(tmp_path / "n.txt", rows)
    assert with_truth(folder, tmp_path / "n.txt").T_n_c(5).translation[2] == pytest.approx(7)
    with pytest.raises(DataError, match="7 poses for the 6 images"):
        poses(range(7), "7.txt", False)


def test_times_that_are_none_or_others_are_refused(tmp_path):
    truth = write_tum(tmp_path / "t.txt", range(COUNT))
    images = make_images(tmp_path, times=False)
    with pytest.raises(DataError, match="but the images of image-folder/walk have none: --fps"):
        with_truth(open_sequence(images), truth)
    with pytest.raises(DataError, match=r"within 0\.02 s .* of 0 to 0\.7 s, poses of 1305031449 to"):
        with_truth(open_sequence(images, frames_per_second=10), truth)
    with pytest.raises(DataError, match=r"t\.txt: poses of 1 of the 8 images"):
        with_truth(open_sequence(make_images(tmp_path)), write_tum(tmp_path / "t.txt", [3]))


def test_rows_out_of_order_are_sorted_where_that_is_asked_for(tmp_path):
    images = open_sequence(make_images(tmp_path))
    truth = write_tum(tmp_path / "t.txt", [4, 5, 6, 7, 0, 1, 2, 3, 3])
    with pytest.raises(DataError, match=r"t\.txt: times must increase"):
        with_truth(images, truth)
    check(with_truth(images, truth, lenient=True), range(COUNT))


def test_eurocs_csv_gives_the_cameras_poses(tmp_path):
    """The reader of the whole data set, and its images and csv apart, agree."""
    folder = make_euroc(tmp_path)
    whole = open_sequence(folder)
    images = folder / "mav0/cam0/data"
    (images / "times.txt").write_text(
        "".join(f"{int(p.stem) / 1e9!r}\n" for p in sorted(images.glob("*.png")))
    )
    csv = folder / "mav0/state_groundtruth_estimate0/data.csv"
    sequence = with_truth(open_sequence(images), csv)
    assert len(sequence) == len(whole)
    for k in range(len(whole)):
        np.testing.assert_allclose(sequence.T_n_c(k).as_matrix(), whole.T_n_c(k).as_matrix(), atol=1e-9)
    R, p = body_pose(1)
    np.testing.assert_allclose(sequence.T_n_c(0).translation, p + R.apply(P_B_C), atol=1e-6)
    np.testing.assert_allclose((R * R_B_C).as_matrix(), sequence.T_n_c(0).rotation.as_matrix(), atol=1e-6)
    (folder / "mav0/cam0/sensor.yaml").unlink()
    with pytest.raises(DataError, match=r"poses of the robot's body, and no .*sensor\.yaml"):
        with_truth(open_sequence(images), csv)


def test_depth_of_a_bag_and_these_poses_make_flow(tmp_path):
    """A wall 10 m away that the camera approaches by 1 m a frame."""
    messages = [Message(t, t, "mono8", picture(k)) for k, t in enumerate(TIMES)]
    wall = np.full((HEIGHT, WIDTH), 10.0, np.float32)
    messages += [Message(t, t, "32FC1", wall - k, topic="/depth") for k, t in enumerate(TIMES)]
    bag = open_sequence(make_bag(tmp_path / "bag", messages), camera="40,19.5,14.5", depth_topic="/depth")
    rows = [[t, 0, 0, k, 0, 0, 0, 1] for k, t in enumerate(TIMES)]
    np.savetxt(tmp_path / "t.txt", rows, fmt="%.9f")
    sequence = with_truth(bag, tmp_path / "t.txt")
    from_centre = sequence.camera.pixel_grid().reshape(HEIGHT, WIDTH, 2) - [19.5, 14.5]
    for k in range(COUNT - 1):
        np.testing.assert_allclose(sequence.flow(k), from_centre / (9 - k), atol=1e-5)
