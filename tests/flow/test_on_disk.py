from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import pytest

from flowlik.datasets import Lens, open_sequence
from flowlik.datasets._lens_models import BrownConrady
from flowlik.datasets.flow_files import write_flo, write_kitti_flow
from flowlik.datasets.selection import Selection
from flowlik.egomotion import ransac
from flowlik.errors import DataError, ModelError
from flowlik.flow import (
    Farneback,
    FlowFiles,
    backward_method,
    check_record,
    confirmed_method,
    describe,
    flow_method,
    method_for_pair,
    method_label,
)
from flowlik.geometry.camera import Pinhole
from flowlik.measurement.measurements import measure
from flowlik.odometry.loop import run_odometry
from flowlik.odometry.odometry import Odometry
from tests.helpers import textured_image

SHAPE = (12, 16)
IMAGE = textured_image(SHAPE)


@dataclass
class Frames:
    """As much of a sequence as flow on disk asks for."""

    count: int
    name: str = "kitti/07"
    camera: Pinhole | None = None

    def __len__(self):
        return self.count


def flow_of(value: float) -> np.ndarray:
    flow = np.full((*SHAPE, 2), value)
    flow[0, 0] = np.nan
    return flow


def write(folder: Path, names, first: float = 1.0) -> Path:
    """Files whose flow is 1, 2, 3, ... px in the order of the names given."""
    folder.mkdir(parents=True, exist_ok=True)
    for i, name in enumerate(names):
        path = folder / name
        if path.suffix == ".npy":
            np.save(path, flow_of(first + i).astype(np.float32))
        else:
            (write_flo if path.suffix == ".flo" else write_kitti_flow)(path, flow_of(first + i))
    return folder


def values(method, count):
    """Flow [px] a method finds in each pair of a sequence."""
    found = []
    for k in range(count - 1):
        m = measure(IMAGE, IMAGE, method_for_pair(method, Frames(count), k))
        assert (m.lost, len(np.unique(m.flow))) == (1, 1)
        found.append(m.flow[0, 0])
    return found


@pytest.mark.parametrize("suffix", [".flo", ".png", ".npy"])
def test_the_file_of_a_pair_is_its_flow(tmp_path, suffix):
    write(tmp_path, [f"{k:06d}{suffix}" for k in range(3)])
    (tmp_path / "README.txt").touch()
    assert values(flow_method(f"flow-files:raft={tmp_path}"), 4) == [1, 2, 3]


def test_numbers_in_names_are_in_their_own_order(tmp_path):
    write(tmp_path, ["v2_8.flo", "v2_9.npy", "v2_10.flo", "v2_11.png"])
    assert values(FlowFiles("raft", tmp_path), 5) == [1, 2, 3, 4]


def test_a_folder_for_each_sequence(tmp_path):
    write(tmp_path / "06", ["0.flo"])
    write(tmp_path / "07", ["0.flo", "1.flo"], first=5.0)
    assert values(FlowFiles("raft", tmp_path), 3) == [5, 6]


def test_backward_flow_stands_beside_the_forward_one(tmp_path):
    write(tmp_path / "forward", ["0.flo", "1.flo"])
    write(tmp_path / "backward", ["0.flo", "1.flo"], first=-2.0)
    method = FlowFiles("raft", tmp_path)
    assert values(method, 3) == [1, 2]
    bound = method_for_pair(method, Frames(3), 1)
    back = backward_method(bound)
    ends = np.array([[3.5, 4.25], [20, 1]])
    np.testing.assert_array_equal(back.measure_at(IMAGE, IMAGE, ends), [[-1, -1], [np.nan, np.nan]])
    assert backward_method(back) == bound
    assert describe(method) == describe(bound) == describe(back)


def test_without_backward_flow_there_is_none(tmp_path):
    bound = method_for_pair(FlowFiles("raft", write(tmp_path, ["0.flo"])), Frames(2), 0)
    with pytest.raises(DataError, match="without backward flow") as caught:
        backward_method(bound)
    assert "\n" not in str(caught.value)


def test_other_methods_need_no_frame_number():
    method = Farneback()
    assert method_for_pair(method, Frames(3), 1) is method
    assert backward_method(method) is method


def test_two_images_alone_take_the_one_file(tmp_path):
    write(tmp_path, ["ab.flo"])
    for path in (tmp_path, tmp_path / "ab.flo"):
        assert (measure(IMAGE, IMAGE, flow_method(f"flow-files:raft={path}")).flow == 1).all()
        assert values(FlowFiles("raft", path), 2) == [1]
    write(tmp_path, ["bc.flo"])
    with pytest.raises(DataError, match="2 flow files, but two images alone need 1, one for each pair"):
        measure(IMAGE, IMAGE, FlowFiles("raft", tmp_path))


def test_odometry_reads_the_file_of_each_pair(tmp_path):
    camera = Pinhole(80, 60, 60.0, 60.0, 39.5, 29.5)
    images = [textured_image((60, 80), shift=(0.8 * k, -0.5 * k * k)) for k in range(4)]
    for k in range(3):
        np.save(tmp_path / f"{k}.npy", Farneback().dense(images[k], images[k + 1]))

    @dataclass
    class Film(Frames):
        def image(self, k):
            return images[k]

        def timestamp(self, k):
            return float(k)

    poses = []
    for method in (Farneback(), FlowFiles("farneback", tmp_path)):
        robot = Odometry(camera, method, ransac())
        assert len(list(run_odometry(Film(4, camera=camera), robot, "epipolar"))) == 3
        poses.append([T.as_matrix() for T in robot.poses])
    np.testing.assert_array_equal(*poses)
    assert not np.allclose(poses[0][-1], np.eye(4))


@pytest.mark.parametrize("count", [3, 5])
def test_one_file_for_each_pair_or_none(tmp_path, count):
    write(tmp_path, ["0.flo", "1.flo", "2.flo"])
    message = f"3 flow files, but {count} images of kitti/07 need {count - 1}, one for each pair"
    with pytest.raises(DataError, match=message):
        method_for_pair(FlowFiles("raft", tmp_path), Frames(count), 0)
    write(tmp_path / "backward", ["0.flo", "1.flo"])
    with pytest.raises(DataError, match="backward: 2 flow files, but 4 images"):
        method_for_pair(FlowFiles("raft", tmp_path), Frames(4), 0)


def test_one_file_for_a_longer_sequence_is_refused(tmp_path):
    write(tmp_path, ["0.flo"])
    with pytest.raises(DataError, match="1 flow files, but 3 images"):
        method_for_pair(FlowFiles("raft", tmp_path / "0.flo"), Frames(3), 0)


def test_flow_of_another_size_is_refused(tmp_path):
    write_flo(tmp_path / "0.flo", np.zeros((16, 12, 2)))
    with pytest.raises(DataError, match=r"0.flo: flow of 12x16 for images of 16x12"):
        FlowFiles("raft", tmp_path).dense(IMAGE, IMAGE)


def test_the_coding_of_pngs_can_be_said(tmp_path):
    image = np.zeros((*SHAPE, 3), np.uint16) + np.array([255, 2**15 - 64, 2**15 + 128], np.uint16)
    cv2.imwrite(str(tmp_path / "0.png"), image)
    with pytest.raises(DataError, match="--flow-png kitti"):
        FlowFiles("raft", tmp_path).dense(IMAGE, IMAGE)
    method = FlowFiles("raft", tmp_path, png="kitti")
    assert (method_for_pair(method, Frames(2), 0).dense(IMAGE, IMAGE) == [2, -1]).all()
    assert describe(method) == describe(FlowFiles("raft"))


@pytest.mark.parametrize(("name", "content"), [("0.flo", b"PIEH"), ("0.png", b""), ("0.npy", b"\x93NUMPY")])
def test_a_file_that_cannot_be_read_is_named(tmp_path, name, content):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(DataError, match=name) as caught:
        FlowFiles("raft", tmp_path).dense(IMAGE, IMAGE)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("description", "message"),
    [
        ("flow-files:", "does not say which flow it is and where: flow-files:LABEL=FOLDER"),
        ("flow-files:data", "does not say which flow it is"),
        ("flow-files:raft=", "does not say which flow it is"),
        ("flow-files:=data", "a label of flow files has letters"),
        ("flow-files:a/b=data", "a label of flow files has letters"),
    ],
)
def test_a_description_says_label_and_path(description, message):
    with pytest.raises(ModelError, match=message):
        flow_method(description)


def test_a_path_that_does_not_exist(tmp_path):
    for use in (lambda m: m.dense(IMAGE, IMAGE), lambda m: method_for_pair(m, Frames(2), 0)):
        with pytest.raises(DataError, match="nowhere: no such file or folder of flow"):
            use(FlowFiles("raft", tmp_path / "nowhere"))


def test_a_model_records_the_label_and_no_path(tmp_path):
    record = describe(flow_method(f"flow-files:raft={tmp_path}"))
    assert record == {"name": "flow-files", "label": "raft"} == check_record(record)
    assert method_label(record) == "raft"
    assert confirmed_method(record, "flow-files:raft=elsewhere") == FlowFiles("raft", Path("elsewhere"))
    with pytest.raises(ModelError, match="give --method flow-files:raft=FOLDER"):
        confirmed_method(record)
    with pytest.raises(ModelError, match="the model is for the flow"):
        confirmed_method(record, f"flow-files:pwc={tmp_path}")
    for nonsense in ({"label": 3}, {"label": "a b"}, {}, {"label": "a", "path": "x"}):
        with pytest.raises(ModelError):
            check_record({"name": "flow-files", **nonsense})


@pytest.mark.parametrize("around", [lambda s: s, lambda s: Selection(s, [0, 1, 2])], ids=["alone", "chosen"])
def test_flow_of_the_images_as_they_are_is_undistorted_with_them(tmp_path, around):
    """A plane before the lens moves evenly: the files' vectors differ, those of the pinhole are all alike."""
    shape, move = (48, 64), np.array([1.5, -0.8])
    lens = Lens(50, 50, 31.5, 23.5, BrownConrady((-0.2, 0.0, 0.0, 0.0)))
    grid = np.stack(np.meshgrid(*map(np.arange, shape[::-1])), axis=-1).reshape(-1, 2).astype(float)
    points = (lens.straighten(grid, shape) + move - (31.5, 23.5)) / 50
    ends = cv2.projectPoints(
        np.column_stack([points, np.ones(len(points))]), np.zeros(3), np.zeros(3), lens.pinhole(shape).K,
        np.array([-0.2, 0, 0, 0]),
    )[0].reshape(-1, 2)  # fmt: skip
    flow = (ends - grid).reshape(*shape, 2).astype(np.float32)
    (tmp_path / "flow").mkdir()
    for k in range(3):
        cv2.imwrite(str(tmp_path / f"{k}.png"), textured_image(shape))
        np.save(tmp_path / f"flow/{k}.npy", flow)
    (tmp_path / "flow/2.npy").unlink()
    sequence = around(open_sequence(tmp_path, camera=lens))
    method = FlowFiles("mine", tmp_path / "flow").for_pair(sequence, 1)
    found = method.dense(sequence.image(1), sequence.image(2))[lens.valid(shape)]
    assert np.isfinite(found).mean() > 0.9
    np.testing.assert_allclose(found[np.isfinite(found).all(axis=1)] - move, 0, atol=0.02)
    assert np.abs(flow - move).max() > 0.2  # what was compared with the pinhole's motion before


def test_a_folder_of_hdf5_says_what_converts_it(tmp_path):
    (tmp_path / "0.flo5").write_bytes(b"\x89HDF")
    with pytest.raises(DataError, match="flow in HDF5 is not read; convert it"):
        FlowFiles("spring", tmp_path).for_pair(Frames(2), 0).dense(IMAGE, IMAGE)


@pytest.mark.parametrize(
    "names",
    [["0.npy", "1.npy", "3.npy"], ["f_0010_11.flo", "f_0020_21.flo", "f_0040_41.flo"]],
)
def test_files_with_a_gap_are_not_taken_by_their_place(tmp_path, names):
    method = FlowFiles("mine", write(tmp_path / "flow", names))
    with pytest.raises(DataError, match=f"flow files are missing between {names[1]} and {names[2]}"):
        method.for_pair(Frames(4), 0)


@pytest.mark.parametrize(
    "names",
    [["7.npy", "8.npy", "9.npy"], ["10.npy", "20.npy", "30.npy"], ["100.03.npy", "100.07.npy", "100.1.npy"],
     ["a.npy", "b2.npy", "c.npy"], ["1403636579763.npy", "1403636579812.npy", "1403636579866.npy"]],
)  # fmt: skip
def test_files_of_any_even_numbers_or_of_times_are(tmp_path, names):
    method = FlowFiles("mine", write(tmp_path / "flow", names)).for_pair(Frames(4), 2)
    assert method.dense(IMAGE, IMAGE)[3, 3, 0] == 3


def test_a_file_that_stands_twice_is_one_too_many(tmp_path):
    folder = write(tmp_path / "flow", ["0.npy", "1.npy", "1.flo"])
    with pytest.raises(DataError, match=r"1\.npy: in the order of names this is also 1\.flo; keep one"):
        FlowFiles("mine", folder).for_pair(Frames(3), 0)
