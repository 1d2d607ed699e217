import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from flowlik.camera import Pinhole
from flowlik.datasets.tartanair import TartanAir
from flowlik.errors import DataError
from flowlik.simulation import SimulatedSequence, simulate, write_sequence


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
    (tmp_path / "notes.txt").write_text("mine")
    with pytest.raises(DataError, match="already holds something else"):
        write_sequence(sequence, tmp_path)
    with pytest.raises(DataError, match="is a file"):
        write_sequence(sequence, tmp_path / "notes.txt")
