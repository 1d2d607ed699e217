import cv2
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from flowlik.datasets import open_sequence
from flowlik.datasets._euroc import Euroc
from flowlik.datasets._euroc_files import read_T_b_c
from flowlik.datasets._lens_models import KannalaBrandt
from flowlik.datasets.base import notes_of
from flowlik.datasets.selection import select_frames
from flowlik.errors import DataError, MissingFieldError
from flowlik.geometry.camera import Pinhole

from .fakes import picture, save

WIDTH, HEIGHT = 188, 120
INTRINSICS = [114.7, 114.3, 91.8, 62.1]
DISTORTION = [-0.283, 0.074, 0.0002, 1.8e-5]
R_B_C = Rotation.from_euler("xyz", [10, -80, 90], degrees=True)
P_B_C = np.array([-0.02, -0.06, 0.01])
START_NS = 1403636579763555584

SENSOR = """#Camera sensor.
sensor_type: camera
comment: a camera [of the left] # here

# Sensor extrinsics wrt. the body-frame.
T_BS:
  cols: 4
  rows: 4
  data: [{}, {}, {}, {},
         {}, {}, {}, {},
         {}, {}, {}, {},
         0.0, 0.0, 0.0, 1.0]

# Camera specific definitions.
rate_hz: 20
resolution: [188, 120]
camera_model: pinhole
intrinsics: [114.7, 114.3, 91.8, 62.1] #fu, fv, cu, cv
distortion_model: radial-tangential
distortion_coefficients: [-0.283, 0.074, 0.0002, 1.8e-05]
""".format(*np.column_stack([R_B_C.as_matrix(), P_B_C]).ravel())


def scene(x, y):
    """Grey level in a direction."""
    return 120 + 60 * np.sin(9 * x + 2) * np.cos(7 * y)


def distorted_image() -> np.ndarray:
    """What the distorted camera sees of the scene; OpenCV's iterative inverse serves as reference."""
    K = np.array([[INTRINSICS[0], 0, INTRINSICS[2]], [0, INTRINSICS[1], INTRINSICS[3]], [0, 0, 1]])
    v, u = np.mgrid[:HEIGHT, :WIDTH].astype(np.float64)
    pixels = np.dstack([u, v]).reshape(-1, 1, 2)
    directions = cv2.undistortPoints(pixels, K, np.array(DISTORTION)).reshape(HEIGHT, WIDTH, 2)
    return np.rint(scene(directions[..., 0], directions[..., 1])).astype(np.uint8)


def body_pose(k: float) -> tuple[Rotation, np.ndarray]:
    return Rotation.from_rotvec([0.1 * k, -0.2, 0.3 * k]), np.array([k, 2.0, -0.5 * k])


def make_euroc(root, frames: int = 5):
    """Five images at 20 Hz; poses from the second to the fourth."""
    folder = root / "MH_09_easy"
    rows = ["#timestamp [ns],filename"]
    for k in range(frames):
        stamp = START_NS + k * 50_000_000
        save(
            folder / f"mav0/cam0/data/{stamp}.png", distorted_image() if k == 1 else picture(k, WIDTH, HEIGHT)
        )
        rows.append(f"{stamp},{stamp}.png")
    (folder / "mav0/cam0/data.csv").write_text("\r\n".join(rows) + "\r\n")
    (folder / "mav0/cam0/sensor.yaml").write_text(SENSOR)
    rows = ["#timestamp, p_RS_R_x [m], ..."]
    for step in range(10, 31):  # 200 Hz
        R, p = body_pose(step / 10)
        values = [*p, *R.as_quat(scalar_first=True), *np.zeros(9)]
        rows.append(",".join([str(START_NS + step * 5_000_000), *map(str, values)]))
    (folder / "mav0/state_groundtruth_estimate0").mkdir()
    (folder / "mav0/state_groundtruth_estimate0/data.csv").write_text("\n".join(rows) + "\n")
    return folder


def test_a_sequence_is_the_frames_that_have_poses(tmp_path):
    sequence = open_sequence(make_euroc(tmp_path))
    assert (sequence.name, len(sequence)) == ("euroc/MH_09_easy", 3)
    assert sequence.camera == Pinhole(WIDTH, HEIGHT, *INTRINSICS)
    assert sequence.timestamp(1) - sequence.timestamp(0) == pytest.approx(0.05, abs=1e-6)
    assert sequence.timestamp(0) == pytest.approx((START_NS + 50_000_000) / 1e9, abs=1e-6)
    in_camera = np.array([0.3, -0.2, 4])
    for k in range(3):
        R, p = body_pose(k + 1)
        expected = R.apply(R_B_C.apply(in_camera) + P_B_C) + p
        np.testing.assert_allclose(sequence.T_n_c(k).apply(in_camera), expected, atol=1e-9)
    for read in (sequence.depth, sequence.flow):
        with pytest.raises(MissingFieldError, match="euroc/MH_09_easy"):
            read(0)


def test_images_are_undistorted(tmp_path):
    folder = make_euroc(tmp_path)
    sequence = open_sequence(folder)
    rays = sequence.camera.rays(sequence.camera.pixel_grid())
    expected = scene(rays[:, 0], rays[:, 1]).reshape(HEIGHT, WIDTH)
    assert np.abs(sequence.image(0) - expected).max() < 2
    np.testing.assert_array_equal(Euroc(folder).image(0), distorted_image())
    assert np.abs(distorted_image() - expected).max() > 30
    assert sequence.mask(0).all()  # a barrel's undistorted image lies within the original


def test_an_equidistant_lens_is_read_too(tmp_path):
    folder = make_euroc(tmp_path)
    text = SENSOR.replace("radial-tangential", "equidistant").replace("-0.283, 0.074", "0.01, -0.02")
    (folder / "mav0/cam0/sensor.yaml").write_text(text)
    assert open_sequence(folder).lens.model == KannalaBrandt((0.01, -0.02, 0.0002, 1.8e-5))


def test_without_poses_all_frames_are_there(tmp_path):
    folder = make_euroc(tmp_path)
    (folder / "mav0/state_groundtruth_estimate0/data.csv").unlink()
    sequence = open_sequence(folder / "mav0")
    assert (sequence.name, len(sequence)) == ("euroc/MH_09_easy", 5)
    with pytest.raises(MissingFieldError, match="no poses"):
        sequence.T_n_c(0)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("camera_model: pinhole", "camera_model: omni", "camera_model omni is not known"),
        ("radial-tangential", "fov", "distortion model 'fov' is not known"),
        ("intrinsics: [114.7, ", "intrinsics: [", "intrinsics hold 3 numbers, expected fx"),
        ("intrinsics: [114.7", "intrinsics: [x", "intrinsics is not a list of finite numbers"),
        ("intrinsics: [114.7", "intrinsics: [-1", "impossible camera"),
        ("resolution: [188, 120]", "resolution: [188, 121]", "of 188 x 121 pixels, these are 188 x 120"),
        ("resolution: [188, 120]", "resolution: [188.5, 120]", "two positive whole numbers"),
        ("resolution: [188, 120]", "resolution: 188", "image size is not a list"),
        ("  data: [", "  data: 1 [", "the T_BS is not a list of finite numbers"),
        ("T_BS:", "T_SB:", "the T_BS is not a list of finite numbers"),
        ("0.0, 0.0, 0.0, 1.0]", "0.0, 0.0, 0.0, 2.0]", "T_BS: a rigid transform's last row"),
        ("0.0, 0.0, 0.0, 1.0]", "0.0, 0.0, 1.0]", "T_BS has 15 numbers, expected 4 x 4"),
        (SENSOR, "", "not a mapping of names to values"),
    ],
)  # fmt: skip
def test_bad_sensor_files(tmp_path, old, new, message):
    folder = make_euroc(tmp_path)
    assert old in SENSOR
    (folder / "mav0/cam0/sensor.yaml").write_text(SENSOR.replace(old, new))
    with pytest.raises(DataError, match=message):
        Euroc(folder)


@pytest.mark.parametrize(
    ("table", "text", "message"),
    [
        ("cam0", "", "empty"),
        ("cam0", "1\n", "line 1: 1 columns, but expected a time"),
        ("cam0", "1.5,a.png\n", "'1.5' is not a time"),
        ("cam0", "-1,a.png\n", "'-1' is not a time"),
        ("cam0", "2,a.png\n1,b.png\n", "times must increase"),
        ("cam0", "1,a.png\n", "no pose within 0.003 s"),
        ("state_groundtruth_estimate0", "1,0,0,0,1,0,0\n", "7 columns"),
        ("state_groundtruth_estimate0", "1,0,0,0,1,1,0,0\n", "not a unit quaternion"),
        ("state_groundtruth_estimate0", "1,0,0,nan,1,0,0,0\n", "'nan' is not a finite number"),
    ],
)
def test_bad_tables(tmp_path, table, text, message):
    folder = make_euroc(tmp_path)
    (folder / "mav0" / table / "data.csv").write_text(text)
    with pytest.raises(DataError, match=rf"data\.csv.*{message}"):
        Euroc(folder)


def test_bad_folders_and_images(tmp_path):
    folder = make_euroc(tmp_path)
    sequence = Euroc(folder)
    path = sequence.files[1]
    save(path, picture(0, WIDTH + 1, HEIGHT))
    with pytest.raises(DataError, match=rf"{path.name}: 189 x 120 pixels"):
        sequence.image(1)
    path.unlink()
    with pytest.raises(DataError, match=rf"{path.name}: no such image"):
        sequence.image(1)
    with (folder / "mav0/cam0/sensor.yaml").open("a") as file:
        file.write("#" * 2**17)
    with pytest.raises(DataError, match="larger than a camera file"):
        Euroc(folder)
    (folder / "mav0/cam0/sensor.yaml").unlink()
    with pytest.raises(DataError, match=r"sensor\.yaml: no such file"):
        Euroc(folder)
    with pytest.raises(DataError, match="no folder mav0/cam0"):
        Euroc(tmp_path)
    with pytest.raises(DataError, match="no such folder"):
        Euroc(tmp_path / "none")


@given(st.lists(st.tuples(st.floats(0, 1), st.text(max_size=3)), max_size=5))
@settings(max_examples=100, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_damaged_sensor_files_end_in_one_error_at_worst(tmp_path, changes):
    text = SENSOR
    for where, what in changes:
        at = int(where * len(text))
        text = text[:at] + what + text[at + len(what) :]
    (tmp_path / "sensor.yaml").write_bytes(text.encode(errors="ignore"))
    try:
        assert read_T_b_c(tmp_path / "sensor.yaml").as_matrix().shape == (4, 4)
    except DataError as error:
        assert "sensor.yaml" in str(error)


def test_tables_with_a_gap_a_double_or_a_swapped_row(tmp_path):
    folder = make_euroc(tmp_path)
    expected = open_sequence(folder)
    images = [expected.image(k) for k in range(len(expected))]
    assert any("2 of 5 images have no pose within 0.003 s, left out" in note for note in notes_of(expected))
    for name in ("cam0", "state_groundtruth_estimate0"):
        table = folder / "mav0" / name / "data.csv"
        rows = table.read_text().splitlines()
        table.write_text("\n".join([rows[0], rows[2], rows[1], *rows[3:], rows[-1]]) + "\n")
        with pytest.raises(DataError, match=r"data\.csv: times must increase, but number 0 is 14036365"):
            open_sequence(folder)
        sequence = open_sequence(folder, lenient=True)
        assert len(sequence) == len(expected)
        for k in range(len(expected)):
            np.testing.assert_array_equal(sequence.image(k), images[k])
            assert sequence.timestamp(k) == expected.timestamp(k)
            np.testing.assert_array_equal(sequence.T_n_c(k).as_matrix(), expected.T_n_c(k).as_matrix())
        assert any("1 rows left out, whose time another row has" in note for note in notes_of(sequence))
        table.write_text("\n".join(rows) + "\n")
    (folder / f"mav0/cam0/data/{START_NS + 2 * 50_000_000}.png").unlink()
    chosen, skipped = select_frames(open_sequence(folder, lenient=True), skip_bad=True)
    assert ([bad.frame for bad in skipped], len(chosen)) == ([1], 2)
    np.testing.assert_array_equal(chosen.T_n_c(1).as_matrix(), expected.T_n_c(2).as_matrix())
