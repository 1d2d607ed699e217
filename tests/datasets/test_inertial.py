"""IMU and GPS beside images: tiny files as others write them, and bad ones."""

from pathlib import Path

import numpy as np
import pytest
from scipy.io import loadmat
from scipy.spatial.transform import Rotation

from flowlik.datasets import ImuNoise, ImuSamples, check_imu, read_euroc_imu, read_gps, read_tartanair_imu
from flowlik.errors import DataError

# the layout of a published EuRoC sequence, body x up
EUROC_YAML = """#Default imu sensor yaml file
sensor_type: imu
comment: VI-Sensor IMU (ADIS16448)
T_BS:
  cols: 4
  rows: 4
  data: [1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0]
rate_hz: 200
gyroscope_noise_density: 1.6968e-04     # [ rad / s / sqrt(Hz) ]
gyroscope_random_walk: 1.9393e-05
accelerometer_noise_density: 2.0000e-3
accelerometer_random_walk: 3.0000e-3
"""
HEADER = "#timestamp [ns],w_RS_S_x [rad s^-1],w_RS_S_y,w_RS_S_z,a_RS_S_x [m s^-2],a_RS_S_y,a_RS_S_z\n"
ROWS = [f"{1403636579758555392 + 5000000 * k},-0.09,0.1{k},0.02,9.7,0.1{k},-1.2\n" for k in range(9)]
GPS = "time_s,x_n_m,y_n_m,z_n_m,sigma_x_m,sigma_y_m,sigma_z_m\n0.0,1,2,3,1.5,2.5,1.5\n0.2,4,5,6,1.5,2.5,1.5\n"


def euroc(folder: Path, rows: str = HEADER + "".join(ROWS), sensor: str = EUROC_YAML) -> Path:
    place = folder / "mav0" / "imu0"
    place.mkdir(parents=True)
    (place / "data.csv").write_text(rows)
    (place / "sensor.yaml").write_text(sensor)
    return folder


def tartanair(folder: Path, **changes: np.ndarray) -> Path:
    count = 20
    arrays = {
        "imu_time": np.arange(count) / 100,
        "gyro": np.tile([0.1, 0.2, 0.3], (count, 1)),
        "acc": np.tile([0.5, 0.6, -9.8], (count, 1)),
    }
    (folder / "imu").mkdir()
    for name, values in (arrays | changes).items():
        np.save(folder / "imu" / f"{name}.npy", values)
    return folder


@pytest.mark.parametrize("inside", ["", "mav0", "mav0/imu0"])
def test_eurocs_imu(tmp_path, inside):
    samples = read_euroc_imu(euroc(tmp_path) / inside)
    assert samples.noise == ImuNoise(1.6968e-4, 1.9393e-5, 2e-3, 3e-3)
    assert samples.T_b_i is not None and np.array_equal(samples.T_b_i.as_matrix(), np.eye(4))
    np.testing.assert_allclose(np.diff(samples.times_s), 0.005, atol=3e-7)
    np.testing.assert_array_equal(samples.angular_rate_radps[3], [-0.09, 0.13, 0.02])
    np.testing.assert_array_equal(samples.specific_force_mps2[3], [9.7, 0.13, -1.2])


def test_tartanairs_imu_is_turned_to_the_cameras_axes(tmp_path):
    """NED is x forward, y right, z down; {c} is x right, y down, z forward."""
    samples = read_tartanair_imu(tartanair(tmp_path))
    np.testing.assert_allclose(samples.angular_rate_radps[0], [0.2, 0.3, 0.1], atol=1e-15)
    np.testing.assert_allclose(samples.specific_force_mps2[0], [0.6, -9.8, 0.5], atol=1e-15)
    assert samples.noise is None and samples.T_b_i is None


def test_gps_columns_go_by_their_names(tmp_path):
    path = tmp_path / "fixes.csv"
    path.write_text(GPS)
    fixes = read_gps(path)
    np.testing.assert_array_equal(fixes.times_s, [0.0, 0.2])
    np.testing.assert_array_equal(fixes.positions_n_m, [[1, 2, 3], [4, 5, 6]])
    path.write_text("\n".join(",".join(reversed(row.split(","))) for row in GPS.split()))
    np.testing.assert_array_equal(read_gps(path).sigma_m, fixes.sigma_m)


@pytest.mark.parametrize(
    ("rows", "message"),
    [
        (HEADER, "empty, but expected rows of 7 numbers"),
        (ROWS[1] + ROWS[0], "times must increase"),
        (ROWS[0] + ROWS[1].replace("9.7", "nan"), "line 2: 'nan' is not a finite number"),
        (ROWS[0].replace(",0.02", ""), "line 1: 6 columns"),
        (ROWS[0].replace("\n", ",1\n"), "line 1: 8 columns"),
        (HEADER.replace("a_RS", "b_RS").replace("w_RS", "a_RS").replace("b_RS", "w_RS") + ROWS[0], "before"),
        ("".join([*ROWS[:2], *ROWS[8:], f"{1403636579803555392},0,0,0,9.8,0,0\n"]), "a gap of 0.035 s after"),
        (ROWS[0], "1 samples of an IMU"),
    ],
)
def test_bad_rows_of_euroc(tmp_path, rows, message):
    with pytest.raises(DataError, match=message):
        read_euroc_imu(euroc(tmp_path, rows))


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("gyroscope_random_walk: 1.9393e-05\n", "", "gyroscope_random_walk is missing"),
        ("2.0000e-3", "unknown", "accelerometer_noise_density is 'unknown', not a finite number"),
        ("3.0000e-3", "-3e-3", "accelerometer_random_walk is negative"),
        ("T_BS", "T_SB", "T_BS"),
    ],
)
def test_bad_settings_of_euroc(tmp_path, old, new, message):
    with pytest.raises(DataError, match=message):
        read_euroc_imu(euroc(tmp_path, sensor=EUROC_YAML.replace(old, new)))


def test_no_imu_at_all(tmp_path):
    (tmp_path / "data.csv").write_text(ROWS[0])
    with pytest.raises(DataError, match=r"no imu0/data\.csv"):
        read_euroc_imu(tmp_path)
    with pytest.raises(DataError, match=r"imu_time\.npy: no such file"):
        read_tartanair_imu(tmp_path)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"acc": np.zeros((20, 2))}, r"acc\.npy: must be an array \(N, 3\) of floats"),
        ({"acc": np.zeros((20, 3), dtype="U3")}, r"acc\.npy: must be an array"),
        ({"gyro": np.zeros((19, 3))}, r"gyro\.npy: 19 rows for 20 times"),
        ({"gyro": np.full((20, 3), np.nan)}, "angular rate of sample 0 is not finite"),
        ({"imu_time": np.zeros(20)}, "times must increase"),
    ],
)
def test_bad_arrays_of_tartanair(tmp_path, changes, message):
    with pytest.raises(DataError, match=message):
        read_tartanair_imu(tartanair(tmp_path, **changes))


def resting(count: int = 400) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Times, rates [rad/s] and forces [m/s²] of an IMU at rest, with a bias of 0.5 deg/s an axis."""
    noise = np.random.default_rng(0).standard_normal((2, count, 3))
    return np.arange(count) / 200, np.deg2rad(0.5) + 2e-3 * noise[0], np.array([0, -9.8, 0]) + 0.03 * noise[1]


def test_units_are_told_by_what_must_be():
    times_s, rate, force = resting()
    check_imu(ImuSamples(times_s, rate, force), "rest")
    with pytest.raises(DataError, match=r"0\.999, not about 9.8: in g, not m/s\^2\?"):
        check_imu(ImuSamples(times_s, rate, force / 9.80665), "rest")
    with pytest.raises(DataError, match="without gravity"):
        check_imu(ImuSamples(times_s, rate, force + np.array([0, 9.8, 0])), "rest")
    with pytest.raises(DataError, match="in degrees"):
        check_imu(ImuSamples(times_s, np.rad2deg(rate), force), "rest")
    with pytest.raises(DataError, match="in degrees"):
        check_imu(ImuSamples(times_s, np.full((400, 3), 90.0), 3 * force), "flight")


def test_turning_about_the_vertical_and_banked_turns_are_no_degrees():
    times_s, rate, force = resting()
    check_imu(ImuSamples(times_s, rate + np.array([0, 2.0, 0]), force), "turning on the spot")
    bank = np.arctan(0.5 * 6 / 9.8)
    turning = 0.5 * np.array([np.sin(bank), np.cos(bank), 0])
    check_imu(ImuSamples(times_s, rate + turning, force / np.cos(bank)), "banked")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (GPS.replace("x_n_m", "lat_deg"), "unknown column 'lat_deg'; known are time, latitude"),
        (GPS.replace("sigma_y_m,", "sigma_y,"), "no unit in column 'sigma_y'; known are m, mm"),
        (GPS.replace("sigma_y_m", "sigma_y_km"), "unit 'km' of column 'sigma_y_km' is not read"),
        (GPS.replace("sigma_y_m", "x_n_mm"), "no column sigma_y with its unit, such as sigma_y_m"),
        (GPS.partition("\n")[0] + "\n", "no row under its names"),
        ("", "empty, but expected a row of columns' names"),
        (GPS.replace("4,5", "4,nan"), "line 3: 'nan' is not a finite number"),
        (GPS.replace("4,5", "4"), "line 3: 6 columns"),
        (GPS.replace("0.2", "0.0"), "times must increase"),
        (GPS.replace("6,1.5", "6,0"), "a standard deviation of fix 1 is not positive"),
    ],
)
def test_bad_tables_of_gps(tmp_path, text, message):
    (tmp_path / "fixes.csv").write_text(text)
    with pytest.raises(DataError, match=message):
        read_gps(tmp_path / "fixes.csv")


def test_tartanairs_own_gyroscope_turns_its_own_force_upright(shared_data):
    """The mean force of 86 s, turned by the gyroscope to the first moment, holds against gravity."""
    folder = shared_data / "tartanair_v2" / "abs_P000"
    if not (folder / "imu").is_dir():
        pytest.skip("no IMU there")
    samples = read_tartanair_imu(folder)
    rates = samples.angular_rate_radps
    turns = Rotation.from_rotvec(np.concatenate([np.zeros((1, 3)), (rates[1:] + rates[:-1]) / 200]))
    reach = 1
    while reach < len(turns):  # products of all turns up to each, by doubling
        turns = Rotation.concatenate([turns[:reach], turns[:-reach] * turns[reach:]])
        reach *= 2
    mean = turns.apply(samples.specific_force_mps2).mean(axis=0)
    np.testing.assert_allclose(mean, [0, -9.8, 0], atol=0.15)


@pytest.mark.parametrize("name", ["00", "10"])
def test_kittis_imu_passes_and_in_other_units_does_not(shared_data, name):
    path = shared_data / "fusion" / "kitti_imu" / f"{name}.mat"
    if not path.is_file():
        pytest.skip("no IMU of KITTI there")
    rows = loadmat(path)["imu_data_interp"]
    times_s = np.arange(len(rows)) / 100
    check_imu(ImuSamples(times_s, rows[:, 3:], rows[:, :3]), name)
    with pytest.raises(DataError, match="in g"):
        check_imu(ImuSamples(times_s, rows[:, 3:], rows[:, :3] / 9.80665), name)
