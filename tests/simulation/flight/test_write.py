import errno
import hashlib
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

from flowlik.datasets.tartanair import TartanAir
from flowlik.errors import DataError
from flowlik.geometry.camera import Pinhole
from flowlik.simulation import Flight, SimulatedSequence, simulate, write_sequence
from tests.simulation.flight.moving import MovingWorld


@pytest.fixture(scope="module")
def sequence() -> SimulatedSequence:
    camera = Pinhole.from_fov(96, 54, 100.0)
    return simulate("planes", "training", frames=3, camera=camera, frames_per_second=30.0)


@pytest.fixture
def written(sequence: SimulatedSequence, tmp_path: Path) -> Path:
    return write_sequence(sequence, tmp_path / "flight")


def test_what_is_written_is_read_back(sequence: SimulatedSequence, written: Path) -> None:
    read = TartanAir(written)
    assert read.camera == sequence.camera and len(read) == 3
    assert read.timestamp(1) == sequence.timestamp(1)
    for k in range(3):
        np.testing.assert_array_equal(read.image(k), sequence.image(k))
        np.testing.assert_array_equal(read.depth(k), sequence.depth(k).astype(np.float32))
        np.testing.assert_allclose(read.T_n_c(k).as_matrix(), sequence.T_n_c(k).as_matrix(), atol=1e-14)
    for k in range(2):
        np.testing.assert_allclose(read.flow(k), sequence.flow(k), atol=1e-4)
        assert (read.visible(k) == sequence.visible(k)).mean() > 0.999


def test_flow_images_hold_flow_and_mask(sequence: SimulatedSequence, written: Path) -> None:
    channels = cv2.imread(str(written / "flow_lcam_front/000000_000001_flow.png"), cv2.IMREAD_UNCHANGED)
    assert channels.dtype == np.uint16
    flow = (channels[..., :2].astype(np.float64) - 32768) / 64
    np.testing.assert_allclose(flow, sequence.flow(0), atol=0.5 / 64 + 1e-9)
    np.testing.assert_array_equal(channels[..., 2] == 0, sequence.visible(0))
    ends = sequence.camera.pixel_grid().reshape(flow.shape) + sequence.flow(0)
    np.testing.assert_array_equal(channels[..., 2] == 100, ~sequence.camera.contains(ends))


def test_layout_is_that_of_the_sample(written: Path, shared_data: Path) -> None:
    sample = shared_data / "tartanair_v2" / "abs_P000"
    for kind in ("image", "depth", "flow"):
        ours, theirs = (sorted((root / f"{kind}_lcam_front").iterdir()) for root in (written, sample))
        assert {p.name for p in ours} <= {p.name for p in theirs}
        images = [cv2.imread(str(paths[0]), cv2.IMREAD_UNCHANGED) for paths in (ours, theirs)]
        assert images[0].dtype == images[1].dtype and images[0].shape[2] == images[1].shape[2]
    rows = [np.loadtxt(root / "pose_lcam_front.txt") for root in (written, sample)]
    assert rows[0].shape[1] == rows[1].shape[1] == 7


def test_provenance_is_kept_and_nothing_half_written(written: Path) -> None:
    description = json.loads((written / "camera.json").read_text())
    assert description["provenance"]["world"] == "planes"
    assert description["provenance"]["trajectory"] == "training"
    assert description["provenance"]["speed_mps"] == 6.0 and description["provenance"]["seed"] == 0
    assert len(description["provenance"]["configuration_sha256"]) == 64
    assert not list(written.rglob("*.part"))


def test_interrupted_writing_is_continued(sequence: SimulatedSequence, written: Path) -> None:
    lost = written / "depth_lcam_front" / "000001_lcam_front_depth.png"
    before = lost.read_bytes()
    lost.unlink()
    seen: list[int] = []
    write_sequence(sequence, written, progress=lambda frames: (seen.append(k) or k for k in frames))
    assert lost.read_bytes() == before and seen == [0, 1, 2]


def test_folders_that_hold_something_else_are_refused(
    sequence: SimulatedSequence, written: Path, tmp_path: Path
) -> None:
    other = simulate("planes", "straight", frames=2, camera=sequence.camera)
    with pytest.raises(DataError, match="already holds something else"):
        write_sequence(other, written)
    poses = other.poses[:1].as_matrix().repeat(3, axis=0)
    still = Flight.of(RigidTransform.from_matrix(poses), 30.0, "training", 6.0)
    elsewhere = SimulatedSequence(sequence.world, still, sequence.camera)
    with pytest.raises(DataError, match="already holds something else"):
        write_sequence(elsewhere, written)
    (tmp_path / "notes.txt").write_text("mine")
    with pytest.raises(DataError, match="already holds something else"):
        write_sequence(sequence, tmp_path)
    with pytest.raises(DataError, match="is a file"):
        write_sequence(sequence, tmp_path / "notes.txt")


def fingerprints(folder: Path) -> dict[str, str]:
    """SHA-256 of every file, hidden ones too."""
    files = [path for path in folder.rglob("*") if path.is_file()]
    return {str(p.relative_to(folder)): hashlib.sha256(p.read_bytes()).hexdigest() for p in files}


WRITE = """
import sys
from flowlik.geometry.camera import Pinhole
from flowlik.simulation import simulate, write_sequence
sequence = simulate("grid", "training", frames=24, camera=Pinhole.from_fov(96, 54, 100.0), baseline_m=0.2)
write_sequence(sequence, sys.argv[1])
"""


def test_a_killed_run_continues_and_gives_the_same_bytes(tmp_path: Path) -> None:
    whole, killed = tmp_path / "whole", tmp_path / "killed"
    subprocess.run([sys.executable, "-c", WRITE, whole], check=True, timeout=120)
    process = subprocess.Popen([sys.executable, "-c", WRITE, killed])
    limit = time.monotonic() + 120
    while len(list(killed.rglob("*.png"))) < 30 and process.poll() is None and time.monotonic() < limit:
        time.sleep(0.001)
    os.kill(process.pid, signal.SIGKILL)
    assert process.wait() == -signal.SIGKILL
    assert 30 <= len(list(killed.rglob("*.png"))) < len(list(whole.rglob("*.png"))) == 24 * 3 + 23
    # what stands under its name is whole
    before, complete = fingerprints(killed), fingerprints(whole)
    assert all(complete[name] == value for name, value in before.items() if not name.endswith(".part"))
    # as if it had been killed in the middle of a file
    (killed / "depth_lcam_front" / ".000020_lcam_front_depth.png.0123.part").write_bytes(b"half")
    subprocess.run([sys.executable, "-c", WRITE, killed], check=True, timeout=120)
    assert fingerprints(killed) == complete


def test_a_run_killed_in_its_first_file_continues(sequence: SimulatedSequence, tmp_path: Path) -> None:
    folder = tmp_path / "flight"
    folder.mkdir()
    (folder / ".camera.json.0123.part").write_bytes(b"{")
    write_sequence(sequence, folder)
    assert not list(folder.rglob(".*.part")) and len(TartanAir(folder)) == 3


def test_a_full_disk_is_one_error_and_leaves_nothing_half_written(
    sequence: SimulatedSequence, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    room, open_file = [60_000], Path.open

    class Limited:
        """A file on a disk that has room for a few bytes more, of which it takes what it can."""

        def __init__(self, file) -> None:
            self.file = file

        def __enter__(self):
            return self

        def __exit__(self, *_error) -> None:
            self.file.close()

        def write(self, content: bytes) -> None:
            self.file.write(content[: room[0]])
            room[0] -= len(content)
            if room[0] < 0:
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    folder = tmp_path / "flight"
    with monkeypatch.context() as patch:
        patch.setattr(Path, "open", lambda self, *a, **k: Limited(open_file(self, *a, **k)))
        with pytest.raises(DataError, match=r"lcam_front.png: cannot be written \(No space left on device\)"):
            write_sequence(sequence, folder)
    begun = fingerprints(folder)
    assert 3 < len(begun) < 3 * 3 + 2
    assert not [name for name in begun if name.endswith(".part")]
    write_sequence(sequence, folder)
    complete = fingerprints(write_sequence(sequence, tmp_path / "again"))
    assert fingerprints(folder) == complete
    assert all(complete[name] == value for name, value in begun.items())


def test_right_images_are_written_and_read_back(tmp_path: Path) -> None:
    camera = Pinhole.from_fov(96, 54, 100.0)
    sequence = simulate("planes", "straight", frames=2, camera=camera, baseline_m=0.25)
    read = TartanAir(write_sequence(sequence, tmp_path / "flight"))
    for k in range(2):
        np.testing.assert_array_equal(read.right_image(k), sequence.right_image(k))
    rows = [np.loadtxt(tmp_path / f"flight/pose_{side}cam_front.txt") for side in "lr"]
    # NED: right is y
    np.testing.assert_allclose(rows[1] - rows[0], [[0, 0.25, 0, 0, 0, 0, 0]] * 2, atol=1e-12)
    assert json.loads((tmp_path / "flight/camera.json").read_text())["baseline_m"] == 0.25


def test_times_are_written_and_read_back(sequence: SimulatedSequence, tmp_path: Path) -> None:
    times_s = 1.4e9 + np.array([0.0, 0.0311, 0.09])
    timed = SimulatedSequence(sequence.world, Flight(sequence.poses, times_s, 60.0), sequence.camera)
    read = TartanAir(write_sequence(timed, tmp_path / "flight"))
    assert [read.timestamp(k) for k in range(3)] == times_s.tolist()


def test_moving_things_are_written_and_read_back(tmp_path: Path) -> None:
    poses = RigidTransform.from_translation(np.linspace([0, 0, 0], [-0.1, 0, 0.3], 3))
    camera = Pinhole.from_fov(160, 90, 80.0)
    sequence = SimulatedSequence(MovingWorld(), Flight.of(poses, 20.0), camera)
    folder = write_sequence(sequence, tmp_path / "flight")
    read = TartanAir(folder)
    for k in range(3):
        labels = cv2.imread(str(folder / f"seg_lcam_front/{k:06d}_lcam_front_seg.png"), cv2.IMREAD_UNCHANGED)
        assert labels.dtype == np.uint8
        np.testing.assert_array_equal(labels.astype(int) - 1, sequence.frame(k).movers)
    for k in range(2):
        np.testing.assert_allclose(read.flow(k), sequence.flow(k), atol=1e-4)
        assert (read.visibility(k) == sequence.visibility(k)).mean() > 0.999
    # the static world's flow would be another
    (folder / "movers.txt").rename(folder / "nothing.txt")
    moving = sequence.frame(0).movers >= 0
    assert np.abs(TartanAir(folder).flow(0) - sequence.flow(0))[moving].max() > 0.5


def test_more_moving_things_than_the_format_holds_are_refused(tmp_path: Path) -> None:
    class Crowd(MovingWorld):
        def mover_poses(self, time_s):
            return RigidTransform.from_translation(np.zeros((256, 3)))

    poses = RigidTransform.from_translation(np.zeros((2, 3)))
    sequence = SimulatedSequence(Crowd(), Flight.of(poses), Pinhole.from_fov(16, 9, 80.0))
    with pytest.raises(DataError, match="256 moving objects, the format holds 255"):
        write_sequence(sequence, tmp_path / "flight")
    assert not (tmp_path / "flight").exists()


def test_frames_are_written_while_the_next_ones_are_rendered(
    sequence: SimulatedSequence, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Slow writing does not add up with rendering, and no more than a frame waits to be written."""
    from flowlik.simulation.flight import _write

    write_png, on_their_way = _write._write_png, []

    def slow(path: Path, pixels: np.ndarray) -> None:
        time.sleep(0.02)
        write_png(path, pixels)

    def progress(frames):
        for k in frames:
            on_their_way.append(k * 3 - len(list(tmp_path.rglob("*.png"))))
            yield k

    monkeypatch.setattr(_write, "_write_png", slow)
    write_sequence(sequence, tmp_path / "flight", progress)
    assert 0 < max(on_their_way) <= 6
    assert len(list(tmp_path.rglob("*.png"))) == 8
