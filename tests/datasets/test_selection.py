import cv2
import numpy as np
import pytest

from flowlik.datasets import open_sequence
from flowlik.datasets.selection import Selection, select_frames, whole_pair
from flowlik.errors import DataError, MissingFieldError
from tests.datasets.fakes import HEIGHT, WIDTH, save
from tests.datasets.test_image_folder import make_folder
from tests.datasets.test_kitti import make_sequence, write_poses
from tests.datasets.test_numbering import make_tartanair


@pytest.fixture
def folder(tmp_path):
    folder = make_sequence(tmp_path / "03", count=8)
    write_poses(folder / "poses.txt", 8)
    return folder


def test_a_range_is_numbered_anew_and_keeps_what_the_frames_have(folder):
    whole = open_sequence(folder)
    chosen, skipped = select_frames(whole, 2, 3)
    assert (len(chosen), skipped, chosen.name, chosen.camera) == (3, [], whole.name, whole.camera)
    for k in range(3):
        np.testing.assert_array_equal(chosen.image(k), whole.image(k + 2))
        assert chosen.timestamp(k) == whole.timestamp(k + 2)
        assert chosen.T_n_c(k).translation == pytest.approx(whole.T_n_c(k + 2).translation)
    assert chosen.times_source == "frame/10s"
    assert len(select_frames(whole, 6, 30)[0]) == 2
    with pytest.raises(DataError, match="no frame 3, there are 3 frames"):
        chosen.image(3)
    with pytest.raises(DataError, match="no frame 8 to start at, there are 8"):
        select_frames(whole, 8)
    with pytest.raises(MissingFieldError, match="no depth"):
        chosen.depth(0)
    with pytest.raises(MissingFieldError, match="right image"):
        chosen.right_image(0)
    assert not hasattr(chosen, "gps_positions")


def test_flow_on_disk_is_numbered_by_the_whole_sequence(folder):
    whole = open_sequence(folder)
    assert whole_pair(whole, 3) == (whole, 3)
    chosen = Selection(whole, [2, 3, 6])
    assert whole_pair(chosen, 0) == (whole, 2)
    assert whole_pair(chosen, 1) == (chosen, 1)
    with pytest.raises(MissingFieldError, match="no true flow from frame 3 to 6"):
        chosen.flow(1)


def test_frames_that_cannot_be_used_are_left_out_and_told(folder):
    images = folder / "image_0"
    (images / "000002.png").unlink()
    (images / "000004.png").write_bytes((images / "000004.png").read_bytes()[:-20])
    cv2.imwrite(str(images / "000005.png"), np.zeros((9, 9), np.uint8))
    (folder / "times.txt").write_text("0\n1\n2\n3\n4\n5\n2.5\n7\n")
    with pytest.raises(DataError, match=r"missing between 000001\.png and 000003\.png"):
        open_sequence(folder)
    chosen, skipped = select_frames(open_sequence(folder, lenient=True), skip_bad=True)
    assert chosen.frames.tolist() == [0, 1, 3, 7]
    reasons = {bad.frame: bad.reason for bad in skipped}
    assert "000002.png: no such image file" in reasons[2]
    assert "000004.png: not a readable image" in reasons[4]
    assert "9 x 9 pixels, but the first image has" in reasons[5]
    assert reasons[6] == "time does not advance: 2.5 s after 3 s"
    assert chosen.T_n_c(2).translation[2] == pytest.approx(3.0)


def test_a_first_image_that_is_damaged_does_not_hide_the_size(folder):
    (folder / "image_0" / "000000.png").write_bytes(b"")
    chosen, skipped = select_frames(open_sequence(folder, lenient=True), skip_bad=True)
    assert ([bad.frame for bad in skipped], len(chosen)) == ([0], 7)


def test_a_folder_whose_first_image_is_damaged_goes_on_from_the_first_readable_one(tmp_path):
    folder = make_folder(tmp_path)
    (folder / "1.png").write_bytes(b"")
    with pytest.raises(DataError, match=r"1\.png: not a readable image"):
        open_sequence(folder)
    save(folder / "11.png", np.zeros((9, 9), np.uint8))
    chosen, skipped = select_frames(open_sequence(folder, lenient=True), skip_bad=True)
    assert chosen.frames.tolist() == [1, 2]
    reasons = {bad.frame: bad.reason for bad in skipped}
    assert "1.png: not a readable image" in reasons[0]
    assert "the first image (2.JPG)" in reasons[3]


def test_a_sequence_of_which_nothing_is_left(folder):
    for path in (folder / "image_0").iterdir():
        if path.stem != "000003":
            path.write_bytes(b"")
    with pytest.raises(DataError, match=r"1 of 8 frames can be used \(frame 0: .*0\.png: not a readable"):
        select_frames(open_sequence(folder, lenient=True), skip_bad=True)


def test_a_stride_leaves_frames_between(folder):
    whole = open_sequence(folder)
    chosen, skipped = select_frames(whole, 1, 6, stride=2)
    assert (chosen.frames.tolist(), skipped) == ([1, 3, 5], [])
    assert chosen.T_n_c(1).translation == pytest.approx(whole.T_n_c(3).translation)
    with pytest.raises(DataError, match="a stride must be at least 1 frame, not 0"):
        select_frames(whole, stride=0)


def test_flow_over_frames_left_out_is_that_of_depth_and_poses(tmp_path):
    """The camera approaches a wall: 3 m in three frames, which no single pair tells."""
    folder = make_tartanair(tmp_path)
    whole = open_sequence(folder)
    chosen = Selection(whole, [0, 3, 4])
    away = whole.T_n_c(3).translation[2] - whole.T_n_c(0).translation[2]
    from_centre = whole.camera.pixel_grid().reshape(HEIGHT, WIDTH, 2) - [19.5, 14.5]
    np.testing.assert_allclose(chosen.flow(0), from_centre * (100 / (100 - away) - 1), atol=1e-6)
    np.testing.assert_array_equal(chosen.flow(1), whole.flow(3))
    assert chosen.visible(1).shape == chosen.visible(0).shape == (HEIGHT, WIDTH)
    nested = Selection(chosen, [1, 2])
    np.testing.assert_array_equal(nested.flow(0), whole.flow(3))
    assert whole_pair(nested, 0) == (whole, 3)


def test_what_moves_by_itself_has_no_flow_over_frames_left_out(tmp_path):
    folder = make_tartanair(tmp_path)
    (folder / "movers.txt").write_text("".join(f"{k} 0 9 {0.5 * k} 0 0 0 0 1\n" for k in range(8)))
    for k in range(8):
        save(folder / f"seg_lcam_front/{k:06d}_lcam_front_seg.png", np.ones((HEIGHT, WIDTH), np.uint8))
    chosen = Selection(open_sequence(folder), [0, 3, 4])
    chosen.flow(1)
    with pytest.raises(MissingFieldError, match="no true flow from frame 0 to 3"):
        chosen.flow(0)
