"""Frames keep their own poses, depth and times, whatever is missing, doubled or in another order."""

import json
import shutil
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

from flowlik.datasets import open_sequence
from flowlik.datasets._numbering import numbered
from flowlik.datasets.selection import select_frames
from flowlik.datasets.tartanair import encode_depth, encode_poses
from flowlik.errors import DataError
from flowlik.geometry.trajectory import Trajectory, write_kitti

from . import test_kitti, test_kitti_raw
from .fakes import HEIGHT, WIDTH, make_sintel, picture, save

FRAMES = 8
CAMERA = {"width": WIDTH, "height": HEIGHT, "fx": 40, "fy": 40, "cx": 19.5, "cy": 14.5}
CAMERA_JSON = json.dumps({**CAMERA, "frames_per_second": 10})


def position(number: int) -> float:
    """How far frame ``number`` is along z [m]: no two steps are alike."""
    return number + 0.1 * number**2


def poses() -> RigidTransform:
    return RigidTransform.from_translation([[0, 0, position(n)] for n in range(FRAMES)])


def depth(number: int) -> np.ndarray:
    return np.full((HEIGHT, WIDTH), 100.0 + number, np.float32)


def frame(number: int) -> np.ndarray:
    image = picture(0)
    image[0] = number
    return image


def make_tartanair(root: Path) -> Path:
    folder = root / "P000"
    for n in reversed(range(FRAMES)):
        save(folder / f"image_lcam_front/{n:06d}_lcam_front.png", frame(n))
        save(folder / f"depth_lcam_front/{n:06d}_lcam_front_depth.png", encode_depth(depth(n)))
    np.savetxt(folder / "pose_lcam_front.txt", encode_poses(poses()))
    (folder / "camera.json").write_text(CAMERA_JSON)
    return folder


def make_tartanair_v1(root: Path) -> Path:
    folder = root / "P001"
    (folder / "depth_left").mkdir(parents=True)
    for n in reversed(range(FRAMES)):
        save(folder / f"image_left/{n:06d}_left.png", frame(n))
        np.save(folder / f"depth_left/{n:06d}_left_depth.npy", depth(n))
    np.savetxt(folder / "pose_left.txt", encode_poses(poses()))
    (folder / "camera.json").write_text(CAMERA_JSON)
    return folder


def make_kitti(root: Path) -> Path:
    folder = test_kitti.make_sequence(root / "03", 0)
    for n in reversed(range(FRAMES)):
        save(folder / f"image_0/{n:06d}.png", frame(n))
    write_kitti(folder / "poses.txt", Trajectory(np.arange(FRAMES), poses()))
    return folder


def make_kitti_raw(root: Path) -> Path:
    drive = test_kitti_raw.make_drive(root, FRAMES)
    for n in range(FRAMES):
        save(drive / f"image_00/data/{n:010d}.png", frame(n))
        row = test_kitti_raw.oxts_row(0, position(n), 0, np.pi / 2)  # north, looking there
        (drive / f"oxts/data/{n:010d}.txt").write_text(" ".join(f"{v:.12f}" for v in row))
    return drive


def make_seven_scenes(root: Path) -> Path:
    folder = root / "chess/seq-01"
    for n in reversed(range(FRAMES)):
        save(folder / f"frame-{n:06d}.color.png", frame(n))
        save(folder / f"frame-{n:06d}.depth.png", (1000 * depth(n) / 10).astype(np.uint16))
        np.savetxt(folder / f"frame-{n:06d}.pose.txt", poses()[n].as_matrix())
    return folder


def make_sintel_scene(root: Path) -> Path:
    folder = make_sintel(root, FRAMES)
    for n in range(1, FRAMES + 1):
        save(folder / f"frame_{n:04d}.png", frame(n))
    return folder


class Layout(NamedTuple):
    """A reader's fake layout: how it is made, an image's name, and what frames have."""

    make: object
    image: str
    rate: float | None
    depth: float | None
    first: int = 0


LAYOUTS = {
    "tartanair": Layout(make_tartanair, "image_lcam_front/{:06d}_lcam_front.png", 10, 100),
    "tartanair v1": Layout(make_tartanair_v1, "image_left/{:06d}_left.png", 10, 100),
    "kitti": Layout(make_kitti, "image_0/{:06d}.png", 10, None),
    "kitti-raw": Layout(make_kitti_raw, "image_00/data/{:010d}.png", 10, None),
    "seven-scenes": Layout(make_seven_scenes, "frame-{:06d}.color.png", 30, 10),
    "sintel": Layout(make_sintel_scene, "frame_{:04d}.png", None, None, 1),
}


@pytest.fixture(params=LAYOUTS.values(), ids=LAYOUTS)
def layout(request):
    return request.param


def open_lenient(folder: Path):
    return select_frames(open_sequence(folder, lenient=True), skip_bad=True)


def number_of(sequence, k: int) -> int:
    return int(sequence.image(k)[0, 0])


def check_frames(sequence, layout: Layout, expected: list[int]) -> None:
    """Every frame has the image, time, depth and motion of its own number."""
    assert [number_of(sequence, k) for k in range(len(sequence))] == expected
    for k, n in enumerate(expected):
        if layout.rate is not None:
            since = sequence.timestamp(k) - sequence.timestamp(0)
            assert since == pytest.approx((n - expected[0]) / layout.rate)
        if layout.depth is not None:
            assert sequence.depth(k)[2, 2] == pytest.approx(depth(n)[0, 0] / (100 / layout.depth))
        if layout.rate is not None and k > 0:
            step = sequence.T_n_c(k - 1).inv() * sequence.T_n_c(k)
            moved = position(n) - position(expected[k - 1])
            np.testing.assert_allclose(step.translation, [0, 0, moved], atol=2e-3 * moved)


def test_files_are_taken_by_number_in_whatever_order_they_were_written(tmp_path, layout):
    sequence = open_sequence(layout.make(tmp_path))
    check_frames(sequence, layout, list(range(layout.first, layout.first + FRAMES)))


def test_a_gap_is_an_error_or_skipped_frames(tmp_path, layout):
    folder = layout.make(tmp_path)
    gone = [layout.first + k for k in (1, 4, 5)]
    for n in gone:
        (folder / layout.image.format(n)).unlink()
    before, after = (Path(layout.image.format(layout.first + k)).name for k in (0, 2))
    with pytest.raises(DataError, match=f"missing between {before} and {after} .--skip-bad-frames goes on"):
        open_sequence(folder)
    chosen, skipped = open_lenient(folder)
    there = [n for n in range(layout.first, layout.first + FRAMES) if n not in gone]
    check_frames(chosen, layout, there)
    assert [bad.frame for bad in skipped] == [n - layout.first for n in gone]


@pytest.mark.parametrize("clip", [range(3), range(3, FRAMES), range(2, 6)], ids=["first", "last", "middle"])
def test_a_clip_keeps_its_poses_times_and_depth(tmp_path, layout, clip):
    folder = layout.make(tmp_path)
    for k in set(range(FRAMES)) - set(clip):
        (folder / layout.image.format(layout.first + k)).unlink()
    check_frames(open_sequence(folder), layout, [layout.first + k for k in clip])


def test_a_second_image_of_a_number_is_refused(tmp_path, layout):
    folder = layout.make(tmp_path)
    path = folder / layout.image.format(2)
    copy = path.with_name("0" + path.name if path.name[0].isdigit() else path.name.replace("0", "00", 1))
    shutil.copy(path, copy)
    with pytest.raises(DataError, match=f"frame 2 is also ({path.name}|{copy.name}); keep one of them"):
        open_sequence(folder)


def test_files_that_were_swapped_are_swapped_with_all_that_is_theirs(tmp_path, layout):
    """The name is what counts: an image renamed is another frame, and keeps that frame's depth and pose."""
    folder = layout.make(tmp_path)
    a, b = (folder / layout.image.format(layout.first + k) for k in (2, 3))
    a.rename(tmp_path / "aside.png")
    b.rename(a)
    (tmp_path / "aside.png").rename(b)
    sequence = open_sequence(folder)
    order = [layout.first + k for k in (0, 1, 3, 2, 4, 5, 6, 7)]
    assert [number_of(sequence, k) for k in range(FRAMES)] == order
    if layout.depth is not None:
        assert sequence.depth(2)[2, 2] < sequence.depth(3)[2, 2]


@pytest.mark.parametrize("name", ["kitti", "tartanair", "tartanair v1"])
def test_poses_of_a_clip_may_begin_with_it(tmp_path, name):
    layout = LAYOUTS[name]
    folder = layout.make(tmp_path)
    for n in (0, 1, 2, 7):
        (folder / layout.image.format(n)).unlink()
    path = folder / {"kitti": "poses.txt", "tartanair": "pose_lcam_front.txt"}.get(name, "pose_left.txt")
    rows = path.read_text().splitlines(keepends=True)
    path.write_text("".join(rows[3:7]))
    check_frames(open_sequence(folder), layout, [3, 4, 5, 6])
    path.write_text("".join(rows[3:8]))
    with pytest.raises(DataError, match="5 poses for the 4 images numbered 3 to 6, expected 4 or 7"):
        open_sequence(folder).T_n_c(0)


@pytest.mark.parametrize("name", ["kitti", "tartanair"])
def test_times_are_those_of_the_number(tmp_path, name):
    layout = LAYOUTS[name]
    folder = layout.make(tmp_path)
    (folder / "times.txt").write_text("".join(f"{100 + n * n}\n" for n in range(FRAMES)))
    for n in (0, 1, 5):
        (folder / layout.image.format(n)).unlink()
    chosen, _ = open_lenient(folder)
    assert [chosen.timestamp(k) for k in range(5)] == [104, 109, 116, 136, 149]


def test_frames_without_a_row_of_oxts_are_an_error_or_skipped(tmp_path):
    folder = make_kitti_raw(tmp_path)
    (folder / "oxts/data/0000000003.txt").unlink()
    with pytest.raises(DataError, match=r"no file of frame 3 \(0000000003\.txt\)"):
        open_sequence(folder).T_n_c(0)
    chosen, skipped = open_lenient(folder)
    check_frames(chosen, LAYOUTS["kitti-raw"], [0, 1, 2, 4, 5, 6, 7])
    assert [bad.frame for bad in skipped] == [3]
    assert np.isfinite(chosen.gps_positions).all()


@pytest.mark.parametrize("suffix", ["jpg", "JPEG"])
def test_kitti_as_jpeg(tmp_path, suffix):
    folder = make_kitti(tmp_path)
    for n in range(FRAMES):
        path = folder / f"image_0/{n:06d}.png"
        (folder / f"image_0/{n:06d}.{suffix}").write_bytes(cv2.imencode(".jpg", cv2.imread(str(path)))[1])
        if n != 3:
            path.unlink()
    with pytest.raises(DataError, match="frame 3 is also"):
        open_sequence(folder)
    (folder / "image_0/000003.png").unlink()
    sequence = open_sequence(folder)
    assert len(sequence) == FRAMES
    assert sequence.T_n_c(5).translation[2] == pytest.approx(position(5))


def test_numbers_that_are_times_make_no_list_of_their_gaps(tmp_path):
    files = [Path(f"{n}.png") for n in (1403636579763, 1403636579813, 1503636579863)]
    with pytest.raises(DataError, match="images are missing between 1403636579813"):
        numbered(files, r"([0-9]+)\.png", "N.png", gaps=True)
    with pytest.raises(DataError, match="must be named by frame number"):
        numbered([Path("1403636579763555584.png")], r"([0-9]+)\.png", "N.png")
