"""The data test: silent on right data of every layout, not on truth of other frames, scales or cameras."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from flowlik.datasets import Lens, open_sequence, truth_doubts
from flowlik.datasets._lens_models import BrownConrady
from flowlik.datasets._masked import Masked
from flowlik.datasets._tracks import track
from flowlik.datasets.agreement import flow_doubt, pair_doubt
from flowlik.datasets.selection import select_frames
from flowlik.datasets.undistorted import Undistorted

from . import room

WITH_DEPTH = {
    "tartanair": room.write_tartanair, "tum-rgbd": room.write_tum, "seven-scenes": room.write_seven_scenes,
}  # fmt: skip
WITH_POSES = {**WITH_DEPTH, "kitti": room.write_kitti_odometry, "euroc": room.write_euroc}
WITH_FLOW = {
    "sintel": room.write_sintel, "kitti-flow": room.write_kitti_flow_pairs,
    "flying-chairs": room.write_chairs, "middlebury-flow": room.write_middlebury,
}  # fmt: skip


@pytest.fixture(scope="module")
def flight():
    return room.flight()


def doubts_of(tmp_path, write, made):
    folder = tmp_path / "made"
    folder.mkdir()
    return truth_doubts(open_sequence(write(folder, made)))


def with_frames(made, images, poses):
    """Images, with their depth, of some frames, and poses of others."""
    kept, chosen = list(images), list(poses)
    return replace(
        made, images=[made.images[k] for k in kept], depths=[made.depths[k] for k in kept],
        poses=made.poses[chosen], times_s=made.times_s[: len(kept)],
    )  # fmt: skip


@pytest.mark.parametrize("name", [*WITH_POSES, *WITH_FLOW])
def test_right_data_of_every_layout_makes_no_doubt(tmp_path, flight, name):
    assert doubts_of(tmp_path, {**WITH_POSES, **WITH_FLOW}[name], flight) == ()


@pytest.mark.parametrize("name", WITH_POSES)
@pytest.mark.parametrize(("offset", "told"), [(1, "1 frame before"), (-1, "1 frame later")])
def test_poses_of_the_next_or_last_frame(tmp_path, flight, name, offset, told):
    n = len(flight) - 1
    late, early = range(1, n + 1), range(n)
    made = with_frames(flight, *((early, late) if offset > 0 else (late, early)))
    (doubt,) = doubts_of(tmp_path, WITH_POSES[name], made)
    assert "the images do not move as" in doubt
    assert f"with the poses of {told} it is 0.0" in doubt


@pytest.mark.parametrize("name", WITH_POSES)
def test_every_second_image_and_poses_matched_by_place(tmp_path, flight, name):
    kept = range(0, len(flight), 2)
    (doubt,) = doubts_of(tmp_path, WITH_POSES[name], with_frames(flight, kept, range(len(kept))))
    assert "the images do not move as" in doubt


@pytest.mark.parametrize("name", ["tartanair", "kitti", "euroc"])
def test_a_clip_and_poses_matched_by_place(tmp_path, flight, name):
    kept = range(6, len(flight))
    (doubt,) = doubts_of(tmp_path, WITH_POSES[name], with_frames(flight, kept, range(len(kept))))
    assert "the images do not move as" in doubt


@pytest.mark.parametrize("name", WITH_POSES)
@pytest.mark.parametrize(("factor", "told"), [(0.5, "2 times the focal"), (2.4, "times the focal")])
def test_another_camera(tmp_path, flight, name, factor, told):
    camera = replace(flight.camera, fx=factor * flight.camera.fx, fy=factor * flight.camera.fy)
    (doubt,) = doubts_of(tmp_path, WITH_POSES[name], replace(flight, camera=camera))
    assert told in doubt


def test_the_camera_of_another_benchmark(tmp_path, flight):
    """TUM's layout, and a camera of TUM's own: focal length and principal point of other images."""
    folder = room.write_tum(tmp_path / "made", flight)
    other = Lens(438.0, 440.0, room.CAMERA.cx + 1, room.CAMERA.cy + 50, size=(320, 240))
    (doubt,) = truth_doubts(open_sequence(folder, camera=other))
    assert "0.5 times the focal length and the principal point in the middle it is 0." in doubt
    assert truth_doubts(open_sequence(folder)) == ()


@pytest.mark.parametrize("name", ["tartanair", "tum-rgbd"])
def test_depth_in_other_units(tmp_path, flight, name):
    (doubt,) = doubts_of(
        tmp_path, WITH_DEPTH[name], replace(flight, depths=[depth / 5 for depth in flight.depths])
    )
    assert "with 5 times the depth it is 0.0" in doubt


@pytest.mark.parametrize("name", WITH_FLOW)
@pytest.mark.parametrize(
    ("factor", "told"), [(2.0, "flow halved"), (0.5, "flow doubled"), (-1, "flow reversed")]
)
def test_flow_of_another_scale(tmp_path, flight, name, factor, told):
    (doubt,) = doubts_of(tmp_path, WITH_FLOW[name], replace(flight, flow_factor=factor))
    assert "do not move as its true flow says" in doubt
    assert told in doubt or name == "middlebury-flow"  # one pair alone


@pytest.mark.parametrize("name", ["kitti-flow", "flying-chairs", "middlebury-flow"])
def test_the_two_images_of_pairs_swapped(tmp_path, flight, name):
    swapped = [flight.images[k ^ 1] for k in range(len(flight))]
    (doubt,) = doubts_of(tmp_path, WITH_FLOW[name], replace(flight, images=swapped))
    assert "the flow reversed" in doubt or name == "middlebury-flow"  # one pair alone


def test_depth_of_another_scene(tmp_path, flight):
    far = [depth[:, ::-1] * 2 for depth in flight.depths]
    assert len(doubts_of(tmp_path, room.write_tartanair, replace(flight, depths=far))) == 1


@pytest.mark.parametrize("name", ["sintel", "flying-chairs"])
@pytest.mark.parametrize("factor", [0.9, 1.1])
def test_exact_flow_may_not_be_a_tenth_off(tmp_path, flight, name, factor):
    assert doubts_of(tmp_path, WITH_FLOW[name], replace(flight, flow_factor=factor))


def test_times_of_other_frames(tmp_path, flight):
    """Poses by number, times of a camera that ran unevenly: the speed jumps where the steps do not."""
    rng = np.random.default_rng(0)
    times = 100 + np.cumsum(rng.uniform(0.02, 0.3, len(flight)))
    steady = replace(flight, poses=room.straight(len(flight)), times_s=times)
    doubts = doubts_of(tmp_path, room.write_kitti_odometry, steady)
    assert sum("do not advance as the times say" in doubt for doubt in doubts) == 1


def test_times_that_are_uneven_and_right(tmp_path):
    """A camera that flies evenly and runs unevenly: its steps jump, its speed does not."""
    seconds = np.random.default_rng(1).uniform(0.02, 0.3, room.FRAMES)
    made = room.flight(room.straight(room.FRAMES, np.cumsum(seconds)))
    made = replace(made, times_s=100 + np.cumsum(seconds))
    assert doubts_of(tmp_path, room.write_kitti_odometry, made) == ()


def test_one_bad_pair_makes_no_doubt(tmp_path, flight):
    images = list(flight.images)
    images[5] = images[12]
    assert doubts_of(tmp_path, room.write_tartanair, replace(flight, images=images)) == ()


def test_images_that_cannot_be_read_are_left_to_their_use(tmp_path, flight):
    folder = room.write_tartanair(tmp_path / "made", flight)
    (folder / "image_lcam_front/000000_lcam_front.png").write_bytes(b"")
    assert truth_doubts(open_sequence(folder)) == ()


def test_without_truth_there_is_no_doubt(tmp_path, flight):
    folder = room.write_kitti_odometry(tmp_path / "made", flight)
    (folder / "poses.txt").unlink()
    assert truth_doubts(open_sequence(folder)) == ()


def test_frames_that_were_left_out_are_no_doubt(tmp_path, flight):
    sequence = open_sequence(room.write_tartanair(tmp_path / "made", flight))
    assert truth_doubts(select_frames(sequence, stride=2)[0]) == ()


def test_corners_keep_away_from_what_is_masked(flight):
    usable = np.ones(flight.images[0].shape, bool)
    usable[:100] = False
    tracks = track(flight.images[0], flight.images[1], usable)
    assert len(tracks.pixels) > 50
    assert tracks.pixels[:, 1].min() >= 100 + 17 // 2
    assert track(flight.images[0], flight.images[1]).pixels[:, 1].min() < 20


def test_a_hood_that_moves_with_the_camera_is_masked(tmp_path, flight):
    """The lower two thirds do not move: the data test doubts them, and not what is left by a mask."""
    hood = flight.images[0][80:]
    images = [np.vstack([image[:80], hood]) for image in flight.images]
    sequence = open_sequence(room.write_tartanair(tmp_path / "made", replace(flight, images=images)))
    assert truth_doubts(sequence)
    usable = np.zeros(flight.images[0].shape, bool)
    usable[:80] = True
    assert truth_doubts(Masked(sequence, usable)) == ()


def lens_of(k1):
    camera = room.CAMERA
    return Lens(camera.fx, camera.fy, camera.cx, camera.cy, BrownConrady((k1, 0.0, 0.0, 0.0)))


def test_a_lens_that_is_not_there_is_doubted(tmp_path, flight):
    sequence = open_sequence(room.write_tartanair(tmp_path / "made", flight))
    (doubt,) = truth_doubts(Undistorted(sequence, lens_of(-0.25)))
    assert "the images do not move as its true flow says" in doubt


def test_flow_of_distorted_images_beside_undistorted_ones(flight):
    """Flow of the images as they are, images undistorted: what nobody must compare."""
    lens = lens_of(-0.25)
    images = tuple(lens.undistort(image) for image in flight.images[:2])
    flow = flight.flow(0)
    assert pair_doubt("a", images, flow) is not None
    assert pair_doubt("a", images, lens.straighten_flow(flow)) is None
    assert pair_doubt("a", (flight.images[0], flight.images[1]), flow) is None


def test_flow_on_disk_may_be_imprecise_but_not_of_other_images(tmp_path, flight):
    sequence = open_sequence(room.write_tartanair(tmp_path / "made", flight))
    assert flow_doubt(sequence, lambda k: 1.2 * flight.flow(k).astype(np.float32)) is None
    doubt = flow_doubt(sequence, lambda k: flight.flow(k)[..., ::-1].astype(np.float32))
    assert doubt is not None
    assert "the flow on disk says" in doubt and "with u and v exchanged it is 0.0" in doubt


def test_images_of_two_sizes_have_no_tracks(flight):
    small = cv2.resize(flight.images[1], (160, 120))
    assert len(track(flight.images[0], small).pixels) == 0


REAL = [
    "kitti_odometry/00", "kitti_odometry/01", "kitti_odometry/02", "kitti_odometry/03",
    "tartanair_v2/abs_P000", "sevenscenes", "flow/kitti2012/training", "flow/sintel/training/clean/alley_1",
    "flow/sintel/training/final/alley_1", "flow/sintel/training/clean/alley_2",
    "flow/sintel/training/final/cave_2", "flow/middlebury/RubberWhale", "flow/flyingchairs",
    "stereo/motorcycle",
]  # fmt: skip


@pytest.mark.parametrize("name", REAL)
def test_real_data_make_no_doubt(shared_data, name):
    assert truth_doubts(open_sequence(shared_data / name)) == ()


@pytest.mark.parametrize("name", ["kitti_odometry/01", "kitti_odometry/03", "tartanair_v2/abs_P000"])
@pytest.mark.parametrize("offset", [-1, 1])
def test_poses_of_real_data_one_frame_off(shared_data, name, offset):
    sequence = open_sequence(shared_data / name)
    right = sequence.T_n_c
    sequence.T_n_c = lambda k: right(int(np.clip(k + offset, 0, len(sequence) - 1)))
    assert truth_doubts(sequence)
