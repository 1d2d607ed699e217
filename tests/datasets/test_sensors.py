"""IMU and GPS of any format through one reader each: tiny files, made here, and bad ones."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.io import savemat

from flowlik.datasets import check_geodetic, read_gps, read_imu, read_imu_noise
from flowlik.errors import DataError

COUNT = 30
RATE, FORCE = np.array([0.01, -0.02, 0.3]), np.array([0.5, -0.2, 9.7])
NOISE = """gyroscope_noise_density: 1.0e-4
gyroscope_random_walk: 2.0e-5
accelerometer_noise_density: 3.0e-3
accelerometer_random_walk: 4.0e-4
"""


def table(
    path: Path, header: str, rate_unit: float = 1.0, force_unit: float = 1.0, time_unit: float = 0.01
) -> Path:
    rows = [[k * time_unit, *(RATE * rate_unit), *(FORCE * force_unit)] for k in range(COUNT)]
    path.write_text("\n".join([header, *(",".join(map(repr, map(float, row))) for row in rows), ""]))
    return path


def oxts(folder: Path) -> Path:
    (folder / "oxts" / "data").mkdir(parents=True)
    for k in range(COUNT):
        row = np.zeros(30)
        row[:3] = 49.0 + k * 1e-5, 8.4, 115.0
        row[11:14], row[17:20], row[23] = FORCE, RATE, 0.05
        (folder / "oxts" / "data" / f"{k:010d}.txt").write_text(" ".join(map(str, row)))
    stamps = [f"2011-09-26 13:02:{25 + 0.1 * k:012.9f}" for k in range(COUNT)]
    (folder / "oxts" / "timestamps.txt").write_text("\n".join(stamps) + "\n")
    return folder


def mat(path: Path) -> Path:
    savemat(path, {"imu_data_interp": np.tile([*FORCE, *RATE], (COUNT, 1))})
    return path


def by_names(path: Path) -> Path:
    return table(path, "time_s,gyro_x_rad_s,gyro_y_rad_s,gyro_z_rad_s,accel_x_m_s2,accel_y_m_s2,accel_z_m_s2")


def by_brackets(path: Path) -> Path:
    header = (
        "# time [ms], gyro_x [deg/s], gyro_y [deg/s], gyro_z [deg/s], accel_x (g), accel_y (g), accel_z (g)"
    )
    return table(path, header, 180 / np.pi, 1 / 9.80665, 10.0)


@pytest.mark.parametrize(
    ("make", "name", "period_s"),
    [(by_names, "a.csv", 0.01), (by_brackets, "b.csv", 0.01), (oxts, "drive", 0.1), (mat, "00.mat", 0.01)],
)
def test_an_imu_is_the_same_in_every_format(tmp_path, make, name, period_s):
    samples = read_imu(make(tmp_path / name))
    np.testing.assert_allclose(samples.times_s, np.arange(COUNT) * period_s, atol=1e-9)
    np.testing.assert_allclose(samples.angular_rate_radps, np.tile(RATE, (COUNT, 1)), rtol=1e-12)
    np.testing.assert_allclose(samples.specific_force_mps2, np.tile(FORCE, (COUNT, 1)), rtol=1e-12)
    assert samples.noise is None and samples.T_b_i is None


def test_noise_and_place_come_from_a_file_of_their_own(tmp_path):
    (tmp_path / "noise.yaml").write_text(NOISE)
    samples = read_imu(by_names(tmp_path / "a.csv"), sensor=tmp_path / "noise.yaml")
    assert samples.noise == read_imu_noise(tmp_path / "noise.yaml")
    assert samples.noise.accelerometer_random_walk == 4e-4 and samples.T_b_i is None
    T = np.diag([-1.0, -1.0, 1.0, 1.0])
    T[:3, 3] = 0.1, 0.2, 0.3
    place = f"T_BS:\n  rows: 4\n  cols: 4\n  data: {T.ravel().tolist()}\n"
    (tmp_path / "both.yaml").write_text(NOISE + place)
    T_b_i = read_imu(tmp_path / "a.csv", sensor=tmp_path / "both.yaml").T_b_i
    np.testing.assert_allclose(T_b_i.as_matrix(), T)


def test_oxts_tells_gps_too(tmp_path):
    fixes = read_gps(oxts(tmp_path / "drive"))
    assert fixes.origin == (49.0, 8.4, 115.0)
    # a degree of latitude is 111.2 km there
    np.testing.assert_allclose(fixes.positions_n_m[-1], [0, 1.11212e5 * 29e-5, 0], atol=1e-3)
    assert (fixes.sigma_m == 0.05).all()


GEODETIC = """time_s,latitude_deg,longitude_deg,height_m,sigma_east_m,sigma_north_m,sigma_up_m
0.0,49.0,8.4,115.0,1.5,1.6,2.5
0.2,49.0,8.40001,116.0,1.5,1.6,2.5
0.4,49.0,8.40002,117.0,1.5,1.6,2.5
"""


def test_a_table_of_latitudes_is_east_north_up(tmp_path):
    path = tmp_path / "fixes.csv"
    path.write_text(GEODETIC)
    fixes = read_gps(path)
    np.testing.assert_allclose(fixes.positions_n_m, [[0, 0, 0], [0.7315, 0, 1], [1.463, 0, 2]], atol=1e-3)
    np.testing.assert_array_equal(fixes.sigma_m[0], [1.5, 1.6, 2.5])
    assert fixes.origin == (49.0, 8.4, 115.0)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("49.0,8.40001", "8.40001,49.0", "latitude and longitude of fix 1 are swapped, by the other fixes"),
        ("49.0,8.40001", "-117.3,33.1", "latitude -117.3 of fix 1 is beyond 90 degrees: swapped"),
        (
            "49.0,8.40001",
            "490000000,84000100",
            "latitude 4.9e[+]08 of fix 1 is beyond 90 degrees: not in degrees",
        ),
        ("49.0,8.40001", "0.0,0.0", "fix 1 is at latitude 0, longitude 0: no fix"),
        ("49.0,8.40001", "nan,8.4", "'nan' is not a finite number"),
        ("1.5,1.6", "1.5,0", "a standard deviation of fix 0 is not positive"),
        (",sigma_up_m", "", "no column sigma_up with its unit"),
        ("height_m", "height_ft", "unit 'ft' of column 'height_ft' is not read"),
    ],
)
def test_bad_positions(tmp_path, old, new, message):
    path = tmp_path / "fixes.csv"
    path.write_text(GEODETIC.replace(old, new, 1))
    with pytest.raises(DataError, match=message):
        read_gps(path)


def test_a_position_that_is_not_finite():
    with pytest.raises(DataError, match="somewhere: the longitude of fix 1 is not finite"):
        check_geodetic(np.array([49.0, 49.0]), np.array([8.4, np.inf]), "somewhere")


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("gyro_x_rad_s", "gyro_x", "no unit in column 'gyro_x'; known are rad_s"),
        ("gyro_x_rad_s", "gyro_x_rpm", "unit 'rpm' of column 'gyro_x_rpm' is not read"),
        ("gyro_x_rad_s", "gyro_y_rad_s", "no column gyro_x with its unit, such as gyro_x_rad_s"),
        ("gyro_x_rad_s", "temperature", "unknown column 'temperature'; known are time, gyro_x"),
        ("0.29,", "0.28,", "times must increase"),
    ],
)
def test_bad_tables_of_an_imu(tmp_path, old, new, message):
    path = by_names(tmp_path / "imu.csv")
    path.write_text(path.read_text().replace(old, new, 1))
    with pytest.raises(DataError, match=message):
        read_imu(path)


def test_units_that_are_named_wrongly_are_noticed(tmp_path):
    """Numbers in g under a name that says m/s²: the name does not make them so."""
    path = table(
        tmp_path / "imu.csv", by_names(tmp_path / "a.csv").read_text().partition("\n")[0], 1.0, 1 / 9.80665
    )
    with pytest.raises(DataError, match="in g, not m/s"):
        read_imu(path)


def test_what_is_no_imu(tmp_path):
    (tmp_path / "damaged.mat").write_bytes(b"no matrix")
    savemat(tmp_path / "other.mat", {"imu": np.zeros((3, 6))})
    (tmp_path / "imu.txt").write_text("0")
    for name, message in (
        ("damaged.mat", "no MATLAB file that can be read"),
        ("other.mat", r"no imu_data_interp \(N, 6\)"),
        ("imu.txt", "not an IMU that is known: EuRoC's imu0"),
        ("absent.csv", "absent.csv"),
        ("absent", "no such file or folder"),
    ):
        with pytest.raises(DataError, match=message):
            read_imu(tmp_path / name)
    with pytest.raises(DataError, match="no ROS bag"):
        read_imu(tmp_path, topic="/imu")
    with pytest.raises(DataError, match="no ROS bag"):
        read_gps(tmp_path, topic="/fix")


def test_oxts_without_as_many_times(tmp_path):
    drive = oxts(tmp_path / "drive")
    stamps = drive / "oxts" / "timestamps.txt"
    stamps.write_text(stamps.read_text().split("\n", 1)[1])
    with pytest.raises(DataError, match=r"30 rows of OXTS, but 29 times"):
        read_imu(drive)
    stamps.write_text("yesterday\n")
    with pytest.raises(DataError, match="not times such as"):
        read_gps(drive)


def sensor_bag(path: Path, **changes) -> Path:
    """A ROS 2 bag with an IMU and a GPS receiver; changes of fields by name."""
    rosbag2 = pytest.importorskip("rosbags.rosbag2")
    typesys = pytest.importorskip("rosbags.typesys")
    store = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)
    kinds = {name.rpartition("/")[2]: kind for name, kind in store.types.items()}
    told = {"stamp_s": 100.0, "rate_covariance": 0.0, "status": 0, "covariance_type": 2, "variance": 2.25}
    told = SimpleNamespace(**told | changes)
    with rosbag2.Writer(path, version=9) as writer:
        imu, fix = (writer.add_connection(f"/{n}", f"sensor_msgs/msg/{k}", typestore=store)
                    for n, k in (("imu", "Imu"), ("fix", "NavSatFix")))  # fmt: skip
        for k in range(COUNT):
            stamp_s = told.stamp_s + k * 0.01 if told.stamp_s else 0.0
            stamp = kinds["Time"](int(stamp_s), round((stamp_s % 1) * 1e9))
            header, no = kinds["Header"](stamp, "imu"), np.zeros(9)
            rate_covariance = np.full(9, told.rate_covariance)
            turn = kinds["Quaternion"](0.0, 0.0, 0.0, 1.0)
            rate, force = kinds["Vector3"](*RATE), kinds["Vector3"](*FORCE)
            message = kinds["Imu"](header, turn, no, rate, rate_covariance, force, no)
            writer.write(imu, round(k * 1e7), store.serialize_cdr(message, "sensor_msgs/msg/Imu"))
            # the first has no fix yet
            status = kinds["NavSatStatus"](-1 if k == 0 else told.status, 1)
            variances = (told.variance * np.diag([1.0, 1.0, 4.0])).ravel()
            place = 49.0 + 1e-5 * k, 8.4, 115.0
            message = kinds["NavSatFix"](header, status, *place, variances, told.covariance_type)
            writer.write(fix, round(k * 1e7), store.serialize_cdr(message, "sensor_msgs/msg/NavSatFix"))
    return path


def test_a_bag_has_both(tmp_path):
    bag = sensor_bag(tmp_path / "bag")
    samples, fixes = read_imu(bag), read_gps(bag, topic="/fix")
    np.testing.assert_allclose(samples.times_s, 100 + np.arange(COUNT) / 100, atol=1e-6)
    np.testing.assert_array_equal(samples.angular_rate_radps[3], RATE)
    np.testing.assert_array_equal(samples.specific_force_mps2[3], FORCE)
    assert len(fixes.times_s) == COUNT - 1 and fixes.left_out == 1
    assert fixes.origin == (49.00001, 8.4, 115.0)
    np.testing.assert_array_equal(fixes.sigma_m[0], [1.5, 1.5, 3.0])


@pytest.mark.parametrize(
    ("changes", "read", "message"),
    [
        ({"status": -1}, read_gps, "none of 30 messages of NavSatFix has a fix"),
        ({"covariance_type": 0}, read_gps, "/fix, message 1: a fix without covariance"),
        ({"variance": 0.0}, read_gps, "a variance of the position is not positive"),
        ({"rate_covariance": -1.0}, read_imu, "it says that it has no angular_velocity"),
        ({"stamp_s": 0.0}, read_imu, "/imu, message 0: its stamp is zero"),
        ({}, lambda bag: read_imu(bag, topic="/fix"), "no Imu on /fix, but on /imu"),
    ],
)
def test_bad_bags(tmp_path, changes, read, message):
    bag = sensor_bag(tmp_path / "bag", **changes)
    with pytest.raises(DataError, match=message):
        read(bag)
