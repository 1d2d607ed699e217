"""Readers of an IMU beside images: EuRoC's ``imu0`` and TartanAir V2's ``imu``."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial.transform import RigidTransform

from flowlik.datasets._camera_content import number_of, parse_mappings
from flowlik.datasets._euroc_files import read_T_b_c
from flowlik.errors import DataError
from flowlik.geometry.pose_table import camera_vectors, nanoseconds
from flowlik.geometry.times import check_times, time_text
from flowlik.support.arrays import Array
from flowlik.support.files import mapped_npy, numbers, read_csv, read_text

GRAVITY_MPS2 = 9.80665
MOST_PERIODS = 5.0
MOST_RATE_RADPS = 35.0
"""2000 deg/s, the widest range of common MEMS gyroscopes, and a little more."""

EUROC_LAYOUT = "7 numbers (time [ns], angular rate x y z [rad/s], specific force x y z [m/s^2])"
_NOISE = (
    "gyroscope_noise_density",
    "gyroscope_random_walk",
    "accelerometer_noise_density",
    "accelerometer_random_walk",
)


@dataclass(frozen=True)
class ImuNoise:
    """Noise of an IMU, of continuous time.

    Attributes
    ----------
    gyroscope_noise_density : float
        [rad/s/√Hz].
    gyroscope_random_walk : float
        [rad/s²/√Hz].
    accelerometer_noise_density : float
        [m/s²/√Hz].
    accelerometer_random_walk : float
        [m/s³/√Hz].
    """

    gyroscope_noise_density: float
    gyroscope_random_walk: float
    accelerometer_noise_density: float
    accelerometer_random_walk: float


@dataclass(frozen=True, eq=False)
class ImuSamples:
    """What an IMU measured.

    Attributes
    ----------
    times_s : array (N,)
        Stamps [s], increasing, no gap of more than five periods.
    angular_rate_radps : array (N, 3)
        Angular velocity [rad/s].
    specific_force_mps2 : array (N, 3)
        Acceleration minus gravity [m/s²].
    noise : ImuNoise or None
        Where the data set tells it.
    T_b_i : RigidTransform or None
        Takes points in the IMU's axes to the body's [m], where the data set tells it.
    """

    times_s: Array
    angular_rate_radps: Array
    specific_force_mps2: Array
    noise: ImuNoise | None = None
    T_b_i: RigidTransform | None = None


def read_euroc_imu(folder: Path | str) -> ImuSamples:
    """Read ``imu0/data.csv`` and ``imu0/sensor.yaml`` of EuRoC's layout.

    Parameters
    ----------
    folder : Path or str
        The sequence, its ``mav0``, or ``imu0`` itself.

    Returns
    -------
    ImuSamples
        In the IMU's own axes, with noise and ``T_b_i`` (``T_BS`` of the file).

    Raises
    ------
    DataError
        If a file is missing or malformed, or lacks a noise density or ``T_BS``; or if the samples are not
        what `check_imu` asks for.
    """
    folder = Path(folder)
    places = [folder / "mav0" / "imu0", folder / "imu0", folder]
    found = [place for place in places if (place / "data.csv").is_file()]
    if not found or (found[0] == folder and folder.name != "imu0"):
        raise DataError(f"{folder}: no imu0/data.csv, not a sequence with an IMU in EuRoC's layout")
    place = found[0]
    noise = read_imu_noise(place / "sensor.yaml")
    T_b_i = read_T_b_c(place / "sensor.yaml")
    path = place / "data.csv"
    _check_header(path)
    stamps, rows = [], []
    for where, words in read_csv(path, 7, EUROC_LAYOUT):
        if len(words) != 7:
            raise DataError(f"{where}: {len(words)} columns, but expected {EUROC_LAYOUT}")
        stamps.append(nanoseconds(words[0], where))
        rows.append(numbers(words[1:], where))
    table = np.array(rows)
    samples = ImuSamples(np.array(stamps), table[:, :3], table[:, 3:], noise, T_b_i)
    check_imu(samples, str(path))
    return samples


def read_tartanair_imu(folder: Path | str) -> ImuSamples:
    """Read ``imu/imu_time.npy``, ``gyro.npy`` and ``acc.npy`` of TartanAir V2.

    Parameters
    ----------
    folder : Path or str
        The sequence, e.g. ``P000``, or its ``imu``.

    Returns
    -------
    ImuSamples
        In the left front camera's axes (x right, y down, z forward), turned from the files' NED axes. The
        format tells no noise.

    Raises
    ------
    DataError
        If a file is missing, or is no array of that shape; or if the samples are not what `check_imu`
        asks for.
    """
    folder = Path(folder)
    place = folder / "imu" if (folder / "imu").is_dir() else folder
    times_s = _read_npy(place / "imu_time.npy", 1)
    rate, force = _read_npy(place / "gyro.npy", 2), _read_npy(place / "acc.npy", 2)
    for name, values in (("gyro.npy", rate), ("acc.npy", force)):
        if len(values) != len(times_s):
            raise DataError(f"{place / name}: {len(values)} rows for {len(times_s)} times of imu_time.npy")
    samples = ImuSamples(times_s, camera_vectors(rate), camera_vectors(force))
    check_imu(samples, str(place))
    return samples


def check_imu(samples: ImuSamples, where: str) -> None:
    """Refuse samples that no filter may be given.

    Units are told by what must be: over a long time the mean magnitude of the specific force is at least
    gravity; a gyroscope reads less than 35 rad/s; and where the specific force rests at gravity, there is no
    turn of more than 0.35 rad/s about a level axis. Degrees that stay below these bounds are not noticed.

    Parameters
    ----------
    samples : ImuSamples
        What was read.
    where : str
        Begins the message.

    Raises
    ------
    DataError
        If there are fewer than two samples, one is not finite, times do not increase, there is a gap of more
        than five periods, or units are g or degrees, or gravity is missing.
    """
    times_s, rate, force = samples.times_s, samples.angular_rate_radps, samples.specific_force_mps2
    if len(times_s) < 2:
        raise DataError(f"{where}: {len(times_s)} samples of an IMU, at least 2 are needed")
    for name, values in (("angular rate", rate), ("specific force", force)):
        bad = np.flatnonzero(~np.isfinite(values).all(axis=1))
        if bad.size:
            raise DataError(f"{where}: the {name} of sample {bad[0]} is not finite")
    check_times(times_s, where)
    steps_s = np.diff(times_s)
    period_s = float(np.median(steps_s))
    if steps_s.max() > MOST_PERIODS * period_s:
        k = int(steps_s.argmax())
        raise DataError(
            f"{where}: a gap of {steps_s[k]:.3g} s after {time_text(times_s[k])} s, more than "
            f"{MOST_PERIODS:g} periods of {period_s:.3g} s"
        )
    mean = float(np.linalg.norm(force, axis=1).mean())
    if mean < GRAVITY_MPS2 / 2:
        what = "in g, not m/s^2?" if 0.8 < mean < 1.3 else "without gravity, or not in m/s^2?"
        raise DataError(f"{where}: the specific force's mean magnitude is {mean:.3g}, not about 9.8: {what}")
    most = float(np.linalg.norm(rate, axis=1).max())
    if most > MOST_RATE_RADPS or _turns_at_rest(rate, force, round(1 / period_s)):
        raise DataError(f"{where}: angular rates of up to {most:.3g} cannot be rad/s: in degrees?")


def read_imu_noise(path: Path | str) -> ImuNoise:
    """Read an IMU's four noise densities of a YAML file, in the names of EuRoC's and Kalibr's.

    Raises
    ------
    DataError
        If the file is missing or no YAML, or a density is missing, negative or no number.
    """
    text = read_text(path)
    try:
        values = parse_mappings(text)[0]
        found = {name: number_of(values[name], name) for name in _NOISE if name in values}
    except DataError as error:
        raise DataError(f"{path}: {error}") from error
    missing = [name for name in _NOISE if name not in found]
    if missing:
        raise DataError(f"{path}: {missing[0]} is missing; a filter needs it, and there is no default")
    negative = [name for name, value in found.items() if value < 0]
    if negative:
        raise DataError(f"{path}: {negative[0]} is negative")
    return ImuNoise(**found)


def _turns_at_rest(rate: Array, force: Array, count: int) -> bool:
    """Whether the gyroscope tells of tilting while the specific force rests at gravity, in windows of 1 s."""
    windows = len(rate) // count if count >= 10 else 0
    if windows == 0:
        return False
    f = force[: windows * count].reshape(windows, count, 3)
    w = rate[: windows * count].reshape(windows, count, 3).mean(axis=1)
    mean = f.mean(axis=1)
    size = np.linalg.norm(mean, axis=1)
    moved = np.linalg.norm(f[:, count // 2 :].mean(axis=1) - f[:, : count // 2].mean(axis=1), axis=1)
    at_rest = (np.abs(size - GRAVITY_MPS2) < 0.4) & (moved < 0.1) & (f.std(axis=1).max(axis=1) < 0.5)
    if not at_rest.any():
        return False
    tilting = np.linalg.norm(np.cross(w[at_rest], mean[at_rest]), axis=1) / size[at_rest]
    return bool(np.median(tilting) > 0.35)


def _check_header(path: Path) -> None:
    """Refuse a header that names accelerations before angular rates."""
    header = read_text(path).partition("\n")[0]
    if header.startswith("#") and 0 <= header.find("a_RS_S_x") < header.find("w_RS_S_x"):
        raise DataError(f"{path}: accelerations stand before angular rates, but expected {EUROC_LAYOUT}")


def _read_npy(path: Path, dimensions: int) -> Array:
    """Array (N,) or (N, 3) of numbers."""
    if not path.is_file():
        raise DataError(f"{path}: no such file")
    values = mapped_npy(path)
    shape = "(N,)" if dimensions == 1 else "(N, 3)"
    right = isinstance(values, np.ndarray) and values.dtype.kind == "f" and values.ndim == dimensions
    if not right or (dimensions == 2 and values.shape[1] != 3):
        raise DataError(f"{path}: must be an array {shape} of floats")
    return np.array(values, dtype=np.float64)
