import cv2
import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from flowlik.datasets import open_sequence
from flowlik.datasets._seven_scenes import SevenScenes
from flowlik.datasets._tum_rgbd import TumRgbd
from flowlik.datasets.base import frame_pairs, notes_of
from flowlik.errors import DataError, MissingFieldError
from flowlik.geometry.camera import Pinhole
from flowlik.geometry.times import mutual, nearest
from flowlik.geometry.trajectory import Trajectory, write_tum

from .fakes import HEIGHT, WIDTH, photometric_errors, picture, save

CAMERA = "50,20,15"


def some_poses(count: int) -> RigidTransform:
    turns = Rotation.from_rotvec(np.outer(np.arange(count), [0.01, 0.02, -0.03]))
    return RigidTransform.from_components(np.outer(np.arange(count), [0.02, -0.01, 0.05]), turns)


def some_depth_mm(k: int) -> np.ndarray:
    depth = np.random.default_rng(k).integers(1500, 4000, (HEIGHT, WIDTH)).astype(np.uint16)
    depth[0, 0], depth[0, 1] = 0, 65535
    return depth


def projected_flow(depth, poses, k):
    """The flow by OpenCV's projection, which shares no code with ours."""
    K = np.array([[50, 0, 20], [0, 50, 15], [0, 0, 1.0]])
    v, u = np.mgrid[:HEIGHT, :WIDTH].astype(np.float64)
    points = np.dstack([(u - 20) / 50 * depth, (v - 15) / 50 * depth, depth]).reshape(-1, 3)
    T = np.linalg.inv(poses[k + 1].as_matrix()) @ poses[k].as_matrix()
    ends = cv2.projectPoints(points, cv2.Rodrigues(T[:3, :3])[0], T[:3, 3], K, None)[0]
    return ends.reshape(HEIGHT, WIDTH, 2) - np.dstack([u, v])


def make_seven_scenes(root, suffix="png"):
    folder = root / "chess/seq-01"
    for k in range(3):
        save(folder / f"frame-{k:06d}.color.{suffix}", picture(k))
        save(folder / f"frame-{k:06d}.depth.png", some_depth_mm(k))
        np.savetxt(folder / f"frame-{k:06d}.pose.txt", some_poses(3)[k].as_matrix(), delimiter="\t ")
    return folder


@pytest.mark.parametrize("suffix", ["png", "jpg"])
def test_seven_scenes(tmp_path, suffix):
    sequence = open_sequence(make_seven_scenes(tmp_path, suffix), camera=CAMERA)
    assert sequence.name == "seven-scenes/chess-seq-01"
    assert (len(sequence), frame_pairs(sequence)) == (3, range(2))
    assert sequence.timestamp(2) == pytest.approx(2 / 30)
    np.testing.assert_allclose(sequence.T_n_c(2).as_matrix(), some_poses(3)[2].as_matrix(), atol=1e-12)
    depth = sequence.depth(1)
    assert np.isnan(depth[0, :2]).all()
    np.testing.assert_allclose(depth[1:], some_depth_mm(1)[1:] / 1000)
    np.testing.assert_allclose(sequence.flow(1)[1:], projected_flow(depth, some_poses(3), 1)[1:], atol=1e-9)
    assert np.isnan(sequence.flow(1)[0, 0]).all()
    assert sequence.visible(0).shape == (HEIGHT, WIDTH)
    with pytest.raises(DataError, match="no frame 3, there are 3 frames"):
        sequence.flow(2)


def test_seven_scenes_camera_is_its_own_unless_told(tmp_path):
    folder = make_seven_scenes(tmp_path)
    with pytest.raises(DataError, match="made for images of 640 x 480 pixels, these are 40 x 30"):
        _ = SevenScenes(folder).camera
    (folder / "camera-intrinsics.txt").write_text("50 0 20\n0 51 15\n0 0 1\n")
    assert SevenScenes(folder).camera == Pinhole(WIDTH, HEIGHT, 50, 51, 20, 15)
    for text in ("50 1 20\n0 51 15\n0 0 1\n", "50 0 20\n0 51 15\n", "50 0\n"):
        (folder / "camera-intrinsics.txt").write_text(text)
        with pytest.raises(DataError, match=r"camera-intrinsics\.txt"):
            SevenScenes(folder)


@pytest.mark.parametrize(
    ("pose", "message"),
    [
        ("1 0 0 0\n0 1 0 0\n0 0 1 0\n", "3 rows, but a pose is 4 x 4"),
        ("1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 2\n", "last row"),
        ("1 0 0 0\n0 1 0 0\n0 0 2 0\n0 0 0 1\n", "not a rotation"),
        ("1 0 0 0\n0 1 0 0\n0 0 -1 0\n0 0 0 1\n", "not a rotation"),
        ("1 0 0 0\n0 1 0 0\n0 0 -1.#IND 0\n0 0 0 1\n", "line 3"),
        ("1 0 0\n0 1 0\n0 0 1\n", "line 1: 3 columns"),
    ],
)
def test_bad_seven_scenes_poses(tmp_path, pose, message):
    folder = make_seven_scenes(tmp_path)
    (folder / "frame-000001.pose.txt").write_text(pose)
    with pytest.raises(DataError, match=rf"frame-000001\.pose\.txt.*{message}"):
        SevenScenes(folder, CAMERA).T_n_c(1)


def test_bad_seven_scenes(tmp_path):
    folder = make_seven_scenes(tmp_path)
    sequence = SevenScenes(folder, CAMERA)
    save(folder / "frame-000000.depth.png", np.zeros((HEIGHT, WIDTH), np.uint8))
    with pytest.raises(DataError, match="not a depth image"):
        sequence.depth(0)
    save(folder / "frame-000001.depth.png", np.zeros((HEIGHT, WIDTH - 2), np.uint16))
    with pytest.raises(
        DataError, match=r"frame-000001\.depth\.png: 38 x 30 pixels, but the image has 40 x 30"
    ):
        sequence.depth(1)
    (folder / "frame-000002.depth.png").unlink()
    with pytest.raises(DataError, match=r"frame-000002\.depth\.png: no such image"):
        sequence.depth(2)
    (folder / "frame-000002.pose.txt").unlink()
    with pytest.raises(DataError, match=r"frame-000002\.pose\.txt: no such file"):
        sequence.T_n_c(2)
    with pytest.raises(DataError, match=r"no images frame-NNNNNN.color\.png"):
        SevenScenes(tmp_path)
    with pytest.raises(DataError, match="no such folder"):
        SevenScenes(tmp_path / "none")


def test_real_depth_and_poses_explain_the_images(shared_data):
    sequence = open_sequence(shared_data / "sevenscenes")
    assert (len(sequence), sequence.camera) == (30, Pinhole(640, 480, 585, 585, 320, 240))
    before, after = np.mean(
        [
            photometric_errors(
                sequence.image(k), sequence.image(k + 1), sequence.flow(k), sequence.visible(k)
            )
            for k in (0, 14, 28)
        ],
        axis=0,
    )
    assert after < 0.65 * before


RGB_TIMES = 1e9 + np.array([0, 0.033, 0.066, 0.1, 0.133])
DEPTH_TIMES = 1e9 + np.array([0.002, 0.035, 0.105, 0.1345])


def make_tum(root, name="rgbd_dataset_freiburg3_x", calibration="50 50 20 15\n"):
    """Five images; the third is too far from any depth, the first and second share a pose's neighbourhood."""
    folder = root / name
    folder.mkdir(parents=True, exist_ok=True)
    if calibration is not None:
        (folder / "calibration.txt").write_text(calibration)
    lines = ["# color images", "# timestamp filename"]
    for k, t in enumerate(RGB_TIMES):
        save(folder / f"rgb/{t:.6f}.png", picture(k))
        lines.append(f"{t:.6f} rgb/{t:.6f}.png")
    (folder / "rgb.txt").write_text("\n".join(lines) + "\n")
    lines = ["# depth maps"]
    for k, t in enumerate(DEPTH_TIMES):
        save(folder / f"depth/{t:.6f}.png", 5 * some_depth_mm(k))
        lines.append(f"{t:.6f} depth/{t:.6f}.png")
    (folder / "depth.txt").write_text("\n".join(lines) + "\n")
    times = 1e9 - 0.004 + np.arange(15) * 0.01
    write_tum(folder / "groundtruth.txt", Trajectory(times, some_poses(15)))
    return folder


def test_tum_rgbd(tmp_path):
    sequence = open_sequence(make_tum(tmp_path), camera=CAMERA)
    assert sequence.name == "tum-rgbd/rgbd_dataset_freiburg3_x"
    times = [sequence.timestamp(k) for k in range(len(sequence))]
    np.testing.assert_allclose(times, RGB_TIMES[[0, 1, 3, 4]], atol=1e-6)
    np.testing.assert_array_equal(sequence.image(2), picture(3))
    depth = sequence.depth(2)
    np.testing.assert_allclose(depth[1:], some_depth_mm(2)[1:] / 1000)
    assert np.isnan(depth[0, 0])
    picked = some_poses(15)[[0, 4, 10, 14]]  # nearest to 0, 33, 100 and 133 ms
    for k in range(4):
        np.testing.assert_allclose(sequence.T_n_c(k).as_matrix(), picked[k].as_matrix(), atol=1e-12)
    np.testing.assert_allclose(sequence.flow(2)[1:], projected_flow(depth, picked, 2)[1:], atol=1e-9)


def test_tum_cameras(tmp_path):
    """The one told, else that of calibration.txt, else one of the benchmark's three, else none."""
    folder = make_tum(tmp_path)
    assert TumRgbd(folder, camera=(50, 51, 20, 15)).camera == Pinhole(WIDTH, HEIGHT, 50, 51, 20, 15)
    assert TumRgbd(folder).camera == Pinhole(WIDTH, HEIGHT, 50, 50, 20, 15)
    for name, fx, k1 in [
        ("freiburg1", 517.3, 0.2624),
        ("freiburg2", 520.9, 0.2312),
        ("freiburg3", 535.4, None),
    ]:
        folder = make_tum(tmp_path / name, f"rgbd_dataset_{name}_x", calibration=None)
        lens = TumRgbd(folder).lens
        assert (lens.fx, lens.size, lens.distorts) == (fx, (640, 480), k1 is not None)
        assert (lens.model.coefficients or (None,))[0] == k1
        assert lens.pinhole((480, 640)).fx == fx
        with pytest.raises(DataError, match="made for images of 640 x 480 pixels, these are 40 x 30"):
            _ = TumRgbd(folder).camera
    other = open_sequence(make_tum(tmp_path, "rgbd_bonn_balloon", calibration=None))
    assert other.image(0).shape == (HEIGHT, WIDTH)
    with pytest.raises(MissingFieldError, match="rgbd_bonn_balloon: this data set has no camera"):
        other.flow(0)
    with pytest.raises(DataError, match=r"calibration\.txt: not a mapping of names to values"):
        TumRgbd(make_tum(tmp_path, calibration="50 50 20\n"))


def test_tum_without_depth_or_poses_keeps_all_images(tmp_path):
    folder = make_tum(tmp_path)
    (folder / "depth.txt").unlink()
    sequence = open_sequence(folder)
    assert len(sequence) == 5
    with pytest.raises(MissingFieldError, match="no depth"):
        sequence.flow(0)
    (folder / "groundtruth.txt").unlink()
    with pytest.raises(MissingFieldError, match="no poses"):
        TumRgbd(folder).T_n_c(0)


@pytest.mark.parametrize(
    ("file", "text", "message"),
    [
        ("rgb.txt", "", "empty"),
        ("rgb.txt", "1\n", "line 1: expected a time"),
        ("rgb.txt", "# x\nnan rgb/a.png\n", "line 2: 'nan'"),
        ("rgb.txt", "2 a.png\n1 b.png\n", "times must increase"),
        ("depth.txt", "1 a.png\nx b.png\n", "line 2: 'x'"),
        ("groundtruth.txt", "1 0 0 0 0 0 1\n", "7 columns"),
    ],
)
def test_bad_tum_lists(tmp_path, file, text, message):
    folder = make_tum(tmp_path)
    (folder / file).write_text(text)
    with pytest.raises(DataError, match=rf"{file}.*{message}"):
        TumRgbd(folder)


def test_bad_tum_folders(tmp_path):
    folder = make_tum(tmp_path)
    sequence = TumRgbd(folder)
    next(iter(sorted((folder / "rgb").iterdir()))).unlink()
    with pytest.raises(DataError, match=r"1000000000\.000000\.png: no such image"):
        sequence.image(0)
    (folder / "depth.txt").write_text("5 depth/5.png\n")
    with pytest.raises(DataError, match=r"no image has depth and pose within 0\.02 s"):
        TumRgbd(folder)
    (folder / "rgb.txt").unlink()
    with pytest.raises(DataError, match=r"rgb\.txt: no such file"):
        TumRgbd(folder)
    with pytest.raises(DataError, match="no such folder"):
        TumRgbd(tmp_path / "none")


def test_a_damaged_file_name_in_a_tum_list(tmp_path):
    folder = make_tum(tmp_path)
    text = (folder / "depth.txt").read_text().replace("depth/1", "depth/\0")
    (folder / "depth.txt").write_text(text)
    with pytest.raises(DataError, match="not the name of a file"):
        TumRgbd(folder).depth(0)


def test_nearest_is_what_a_search_over_all_finds():
    rng = np.random.default_rng(0)
    for n, m in [(1, 1), (5, 1), (1, 5), (50, 30)]:
        times, others = np.sort(rng.random(n)), np.sort(rng.random(m))
        apart = np.abs(times[:, None] - others)
        expected = np.where(apart.min(axis=1) <= 0.02, apart.argmin(axis=1), -1)
        np.testing.assert_array_equal(nearest(times, others, 0.02), expected)
        found = mutual(times, others, 0.02)
        taken = found[found >= 0]
        assert len(set(taken)) == len(taken)
        for j in taken:
            assert found[apart[:, j].argmin()] == j
    assert (nearest(np.arange(3.0), np.array([]), 1) == -1).all()


def test_tum_lists_out_of_order_or_double_are_refused_or_sorted(tmp_path):
    folder = make_tum(tmp_path)
    expected = open_sequence(folder, camera=CAMERA)
    for name in ("rgb.txt", "depth.txt", "groundtruth.txt"):
        rows = (folder / name).read_text().splitlines()
        data = [row for row in rows if not row.startswith("#")]
        (folder / name).write_text("\n".join([data[1], data[0], *data[2:], data[-1]]) + "\n")
        with pytest.raises(DataError, match=f"{name}: times must increase, but number 0 is"):
            open_sequence(folder)
        sequence = open_sequence(folder, camera=CAMERA, lenient=True)
        assert len(sequence) == len(expected)
        for k in range(len(expected)):
            np.testing.assert_array_equal(sequence.image(k), expected.image(k))
            np.testing.assert_array_equal(sequence.depth(k), expected.depth(k))
            assert sequence.timestamp(k) == expected.timestamp(k)
            np.testing.assert_array_equal(sequence.T_n_c(k).as_matrix(), expected.T_n_c(k).as_matrix())
        notes = notes_of(sequence)
        assert any(f"{name}: 1 rows left out, whose time another row has" in note for note in notes)
        assert any("1 of 5 images have no depth or pose within 0.02 s, left out" in note for note in notes)
        (folder / name).write_text("\n".join(rows) + "\n")


def test_tum_depth_that_is_saturated_is_unknown(tmp_path):
    """What is beyond 16 bits is written as their largest value, 13.1 m: no measurement."""
    folder = make_tum(tmp_path)
    values = 5 * some_depth_mm(0)
    values[4, 5] = 65535
    save(folder / f"depth/{DEPTH_TIMES[0]:.6f}.png", values)
    depth = open_sequence(folder).depth(0)
    assert np.isnan(depth[4, 5])
    assert np.isfinite(depth).mean() > 0.5 and np.nanmax(depth) < 65535 / 5000
