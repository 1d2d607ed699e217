"""One reader of an IMU for all formats: it recognises which."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.io import loadmat

from flowlik.datasets._camera_content import parse_mappings
from flowlik.datasets._euroc_files import read_T_b_c
from flowlik.datasets._named_columns import read_named_columns
from flowlik.datasets._oxts import FORCE, RATE, is_oxts, read_oxts
from flowlik.datasets._ros_sensors import is_bag, read_ros_imu
from flowlik.datasets.inertial import (
    ImuSamples,
    check_imu,
    read_euroc_imu,
    read_imu_noise,
    read_tartanair_imu,
)
from flowlik.errors import DataError
from flowlik.support.files import read_text

FORMATS = (
    "EuRoC's imu0, TartanAir V2's imu, KITTI raw's oxts, a KITTI .mat with imu_data_interp, a ROS bag, "
    "or a .csv whose columns name their units"
)
MAT_RATE_HZ = 100.0

_COLUMNS = {"time": "time"} | {
    f"{name}_{axis}": kind
    for name, kind in (("gyro", "angular rate"), ("accel", "specific force"))
    for axis in "xyz"
}


def read_imu(path: Path | str, sensor: Path | str | None = None, topic: str | None = None) -> ImuSamples:
    """Read what an IMU measured; the format is recognised.

    ===================================  ====================================================================
    EuRoC: ``imu0/data.csv``             in the IMU's axes, with noise and ``T_b_i``
    TartanAir V2: ``imu/imu_time.npy``   in the left camera's axes; no noise
    KITTI raw: ``oxts/data``             x forward, y left, z up; times from the first row; no noise
    KITTI: ``.mat``, imu_data_interp     the same; 100 rows a second, of which the first is at 0 s; no noise
    ROS: bag with ``sensor_msgs/Imu``    in the message's frame, times of headers; no noise
    table: ``.csv``                      columns time, gyro_x … accel_z, each with its unit (``gyro_x_rad_s``,
                                         ``accel_z [g]``); no noise
    ===================================  ====================================================================

    Parameters
    ----------
    path : Path or str
        File or folder.
    sensor : Path or str, optional
        YAML of the four noise densities in EuRoC's and Kalibr's names, and ``T_BS`` if it has one: they stand
        in place of the format's own.
    topic : str, optional
        Topic of ``sensor_msgs/Imu``; needed where a bag has several.

    Raises
    ------
    DataError
        If it is no such format, a file is missing or malformed, a unit is unknown, or samples are not what
        `check_imu` asks for.
    MissingExtraError
        If a bag is read and rosbags is not installed.
    """
    path = Path(path)
    if topic is not None and not is_bag(path):
        raise DataError(f"{path}: a topic is asked for, but this is no ROS bag")
    samples = _read(path, topic)
    check_imu(samples, str(path))
    if sensor is None:
        return samples
    told = parse_mappings(read_text(sensor))
    T_b_i = read_T_b_c(sensor) if told and "T_BS" in told[0] else samples.T_b_i
    return replace(samples, noise=read_imu_noise(sensor), T_b_i=T_b_i)


def _read(path: Path, topic: str | None) -> ImuSamples:
    if is_bag(path):
        return ImuSamples(*read_ros_imu(path, topic))
    if any((path / place / "data.csv").is_file() for place in ("mav0/imu0", "imu0")) or path.name == "imu0":
        return read_euroc_imu(path)
    if (path / "imu" / "imu_time.npy").is_file() or (path / "imu_time.npy").is_file():
        return read_tartanair_imu(path)
    if is_oxts(path):
        times_s, rows = read_oxts(path)
        return ImuSamples(times_s, rows[:, RATE], rows[:, FORCE])
    if path.suffix == ".mat" and path.is_file():
        return _read_mat(path)
    if path.suffix == ".csv":
        columns = read_named_columns(path, _COLUMNS)
        rate, force = (
            np.column_stack([columns[f"{name}_{axis}"] for axis in "xyz"]) for name in ("gyro", "accel")
        )
        return ImuSamples(columns["time"], rate, force)
    if not path.exists():
        raise DataError(f"{path}: no such file or folder")
    raise DataError(f"{path}: not an IMU that is known: {FORMATS}")


def _read_mat(path: Path) -> ImuSamples:
    try:
        table = loadmat(path, variable_names=["imu_data_interp"]).get("imu_data_interp")
    # damaged files make the parser fail in ways of its own
    except Exception as error:
        raise DataError(f"{path}: no MATLAB file that can be read ({error})") from error
    if table is None or table.ndim != 2 or table.shape[1] != 6 or table.dtype.kind != "f":
        raise DataError(f"{path}: no imu_data_interp (N, 6) of floats")
    values = np.asarray(table, dtype=np.float64)
    return ImuSamples(np.arange(len(values)) / MAT_RATE_HZ, values[:, 3:], values[:, :3])
