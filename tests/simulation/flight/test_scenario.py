from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

from flowlik.errors import DataError
from flowlik.geometry.camera import Pinhole
from flowlik.geometry.trajectory import Trajectory, write_kitti, write_tum
from flowlik.simulation import PAPER_CAMERA, WORLDS, simulate
from flowlik.simulation.flight import camera_of
from flowlik.simulation.flight._trajectories import curve

CAMERA = Pinhole.from_fov(64, 36, 100.0)


@pytest.fixture
def flown() -> Trajectory:
    times_s = 1.5e9 + np.cumsum(np.random.default_rng(0).uniform(0.02, 0.05, 20))
    return Trajectory(times_s, curve(20, seed=3))


@pytest.fixture
def kitti(flown: Trajectory, tmp_path: Path) -> Path:
    write_kitti(tmp_path / "00.txt", flown)
    return tmp_path / "00.txt"


@pytest.fixture
def tum(flown: Trajectory, tmp_path: Path) -> Path:
    write_tum(tmp_path / "flight.tum", flown)
    return tmp_path / "flight.tum"


def test_names_give_the_papers_camera_and_rate() -> None:
    sequence = simulate()
    assert len(sequence) == 300 and sequence.camera == PAPER_CAMERA
    assert sequence.frames_per_second == 60.0 and sequence.name == "planes-straight-0"
    assert sequence.speed_mps == 6.0


def test_a_hundred_metres_straight_are_flown() -> None:
    for world in ("planes", "grid"):
        sequence = simulate(world, "straight", frames=1001, camera=CAMERA)
        assert sequence.T_n_c(1000).translation[2] == pytest.approx(100.0)


def test_start_leaves_the_first_frames_out() -> None:
    whole, later = (simulate("planes", "curve", frames=n, start=s, seed=5) for n, s in ((30, 0), (20, 10)))
    assert len(later) == 20 and later.timestamp(0) == whole.timestamp(10)
    np.testing.assert_array_equal(later.poses.as_matrix(), whole.poses[10:].as_matrix())


def test_kitti_poses_are_flown_at_ten_frames_a_second_or_any_given_rate(
    kitti: Path, flown: Trajectory
) -> None:
    sequence = simulate("planes", kitti, camera=CAMERA)
    np.testing.assert_allclose(sequence.poses.as_matrix(), flown.poses.as_matrix(), atol=1e-12)
    assert sequence.timestamp(7) == pytest.approx(0.7) and sequence.frames_per_second == pytest.approx(10)
    assert sequence.name == "planes-00-0" and sequence.speed_mps is None
    assert simulate("planes", kitti, camera=CAMERA, frames_per_second=25.0).timestamp(5) == 0.2


def test_tum_poses_keep_their_times(tum: Path, flown: Trajectory) -> None:
    sequence = simulate("planes", str(tum), camera=CAMERA, frames=8, start=5)
    assert len(sequence) == 8
    np.testing.assert_allclose(sequence.poses.as_matrix(), flown.poses[5:13].as_matrix(), atol=1e-12)
    np.testing.assert_array_equal(sequence.times_s, flown.timestamps[5:13])
    assert 20 < sequence.frames_per_second < 50


def test_a_file_gives_what_it_has(kitti: Path) -> None:
    assert len(simulate("planes", kitti, frames=300, start=5, camera=CAMERA)) == 15
    with pytest.raises(DataError, match="start 20 is beyond its 20 poses"):
        simulate("planes", kitti, start=20)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("", "empty"),
        ("1 2 3\n", "3 columns"),
        ("nan " * 12, "not a finite number"),
        ("1 0 0 0 0 1.1 0 0 0 0 1 0\n", "line 1: not a rotation"),
        ("1 0 0 0 0 1 0 0 0 0 -1 0\n", "line 1: not a rotation"),
        ("0 0 0 0 0 0 0 0.8\n", "not a unit quaternion"),
        ("1 0 0 0 0 0 0 1\n0 0 0 0 0 0 0 1\n", "times must increase"),
    ],
)
def test_malformed_pose_files_are_one_clear_error(tmp_path: Path, content: str, message: str) -> None:
    path = tmp_path / "poses.txt"
    path.write_text(content)
    with pytest.raises(DataError, match=f"poses.txt.*{message}"):
        simulate("planes", path)


def test_poses_of_a_file_must_keep_clear_too(tmp_path: Path) -> None:
    path = tmp_path / "deep.txt"
    write_kitti(path, Trajectory(np.arange(2.0), RigidTransform.from_translation([[0, 0, 0], [0, 2.4, 0]])))
    with pytest.raises(DataError, match=r"frame 1 .* is 0.10 m from a surface"):
        simulate("planes", path)


def test_unknown_names_tell_the_known_ones() -> None:
    with pytest.raises(DataError, match=r"unknown world 'moon': known are driving, forest, .*planes"):
        simulate("moon")
    with pytest.raises(DataError, match=r"unknown trajectory 'loop': known are curve, .*, or a pose file"):
        simulate("planes", "loop")


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"frames": 0}, "0 frames"),
        ({"seed": -1}, "seed -1"),
        ({"start": -1}, "start -1"),
        ({"frames_per_second": -5.0}, "impossible frame rate"),
        ({"frames_per_second": np.inf}, "impossible frame rate"),
        ({"traffic": 3}, "has no traffic"),
        ({"frames": 2000}, "fly fewer frames"),
    ],
)
def test_impossible_scenarios_are_refused(options: dict, message: str) -> None:
    with pytest.raises(DataError, match=message):
        simulate("planes", "straight", **options)


def test_worlds_are_loaded_when_they_are_built() -> None:
    assert set(WORLDS) == {"planes", "grid", "forest", "forest-small", "driving"}


def test_a_camera_may_be_changed_in_part() -> None:
    assert camera_of("planes", None, None, None) is PAPER_CAMERA
    assert camera_of("planes", 320, 180, None) == Pinhole.from_fov(320, 180, 120.0)
    assert camera_of("planes", None, None, 90.0) == Pinhole.from_fov(640, 360, 90.0)
    for bad in ((0, None, None), (None, -1, None), (None, None, 180.0), (None, None, np.nan)):
        with pytest.raises(DataError, match="impossible"):
            camera_of("planes", *bad)
