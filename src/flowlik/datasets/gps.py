"""Readers of GPS positions: tables whose columns name their units, KITTI's OXTS, and ROS ``NavSatFix``."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from flowlik.datasets._named_columns import column_names, read_named_columns
from flowlik.datasets._oxts import ACCURACY, POSITION, is_oxts, read_oxts
from flowlik.datasets._ros_sensors import is_bag, read_nav_sat
from flowlik.errors import DataError
from flowlik.geometry.geodesy import east_north_up
from flowlik.geometry.times import check_times
from flowlik.support.arrays import Array

GPS_COLUMNS = ("time_s", "x_n_m", "y_n_m", "z_n_m", "sigma_x_m", "sigma_y_m", "sigma_z_m")
"""Time [s], position [m] in {n} and its standard deviations [m]."""

_IN_N = {"time": "time"} | dict.fromkeys(("x_n", "y_n", "z_n", "sigma_x", "sigma_y", "sigma_z"), "length")
_GEODETIC = {
    "time": "time", "latitude": "angle", "longitude": "angle", "height": "length",
    "sigma_east": "length", "sigma_north": "length", "sigma_up": "length",
}  # fmt: skip

NEAR_ZERO_DEG = 1e-3
FAR_DEG = 0.5


@dataclass(frozen=True, eq=False)
class GpsFixes:
    """Positions that a GPS receiver told.

    Attributes
    ----------
    times_s : array (N,)
        Times [s], increasing.
    positions_n_m : array (N, 3)
        Positions [m] of the antenna in {n}.
    sigma_m : array (N, 3)
        Standard deviations [m] that the receiver claims, above 0.
    origin : tuple of 3 float or None
        Where the receiver told latitude and longitude: those [deg] and the height [m] of the first fix. {n}
        is then east, north, up from there. None where positions were told in {n}.
    left_out : int
        Messages without a fix.
    """

    times_s: Array
    positions_n_m: Array
    sigma_m: Array
    origin: tuple[float, float, float] | None = None
    left_out: int = 0


def read_gps(path: Path | str, topic: str | None = None) -> GpsFixes:
    """Read positions of a GPS receiver; the format is recognised.

    A table names its columns with their units, in any order: `GPS_COLUMNS`, or time, latitude, longitude,
    height, sigma_east, sigma_north and sigma_up (``latitude_deg``, ``height_m``, ``time [ms]`` ...). Of
    KITTI's OXTS the position is that of the unit, with its stated accuracy along each axis. Of ``NavSatFix``
    messages those whose status says that there is no fix are left out and counted; of the covariance the
    diagonal is kept.

    Parameters
    ----------
    path : Path or str
        A table, a folder with ``gps0/data.csv``, a drive of KITTI raw with ``oxts/data``, or a ROS bag.
    topic : str, optional
        Topic of ``sensor_msgs/NavSatFix``; needed where a bag has several.

    Raises
    ------
    DataError
        If the path is none of these, is missing or empty; if columns are missing, unknown, double or without
        a unit that is known; if a number is not finite, a standard deviation is not positive or not told,
        times do not increase; or if latitude and longitude are impossible, 0 and 0, or swapped.
    MissingExtraError
        If a bag is read and rosbags is not installed.
    """
    path = Path(path)
    if is_bag(path):
        times_s, geodetic, sigma_m, left_out = read_nav_sat(path, topic)
        return _from_geodetic(times_s, geodetic, sigma_m, str(path), left_out)
    if topic is not None:
        raise DataError(f"{path}: a topic is asked for, but this is no ROS bag")
    if is_oxts(path):
        times_s, rows = read_oxts(path)
        return _from_geodetic(times_s, rows[:, POSITION], np.tile(rows[:, ACCURACY, None], 3), str(path))
    if path.is_dir():
        path = path / "gps0" / "data.csv"
    geodetic_table = any(name.lower().startswith("lat") for name in column_names(path))
    columns = read_named_columns(path, _GEODETIC if geodetic_table else _IN_N)
    table = np.column_stack(list(columns[name] for name in (_GEODETIC if geodetic_table else _IN_N)))
    if geodetic_table:
        return _from_geodetic(table[:, 0], table[:, 1:4], table[:, 4:], str(path))
    return _checked(GpsFixes(table[:, 0], table[:, 1:4], table[:, 4:]), str(path))


def check_geodetic(latitude_deg: Array, longitude_deg: Array, where: str) -> None:
    """Refuse latitudes and longitudes (N,) [deg] that no receiver can have told in that order.

    That all are swapped is noticed only where a latitude is then beyond 90 degrees.

    Parameters
    ----------
    latitude_deg, longitude_deg : array (N,)
        What was read.
    where : str
        Begins the message.

    Raises
    ------
    DataError
        If one is not finite, out of range, 0 and 0, or far from the others and near them once swapped.
    """
    for name, values, most in (("latitude", latitude_deg, 90.0), ("longitude", longitude_deg, 360.0)):
        if (bad := np.flatnonzero(~np.isfinite(values))).size:
            raise DataError(f"{where}: the {name} of fix {bad[0]} is not finite")
        if (bad := np.flatnonzero(np.abs(values) > most)).size:
            value = values[bad[0]]
            what = (
                "swapped with longitude?" if name == "latitude" and abs(value) <= 180 else "not in degrees?"
            )
            raise DataError(f"{where}: {name} {value:g} of fix {bad[0]} is beyond {most:g} degrees: {what}")
    at_zero = (np.abs(latitude_deg) < NEAR_ZERO_DEG) & (np.abs(longitude_deg) < NEAR_ZERO_DEG)
    if at_zero.any():
        raise DataError(f"{where}: fix {int(at_zero.argmax())} is at latitude 0, longitude 0: no fix?")
    both = np.stack([latitude_deg, longitude_deg])
    middle = np.median(both, axis=1, keepdims=True)
    off, off_swapped = (np.abs(values - middle).max(axis=0) for values in (both, both[::-1]))
    swapped = (off > FAR_DEG) & (off_swapped < off / 10)
    if swapped.any():
        k = int(swapped.argmax())
        raise DataError(f"{where}: latitude and longitude of fix {k} are swapped, by the other fixes")


def _from_geodetic(
    times_s: Array, geodetic: Array, sigma_m: Array, where: str, left_out: int = 0
) -> GpsFixes:
    """Fixes of latitudes, longitudes [deg] and heights [m] (N, 3)."""
    check_geodetic(geodetic[:, 0], geodetic[:, 1], where)
    latitude, longitude, height = geodetic[0].tolist()
    origin = (latitude, longitude, height)
    positions_n_m = east_north_up(geodetic[:, 0], geodetic[:, 1], geodetic[:, 2], origin)
    return _checked(GpsFixes(times_s, positions_n_m, sigma_m, origin, left_out), where)


def _checked(fixes: GpsFixes, where: str) -> GpsFixes:
    check_times(fixes.times_s, where)
    for name, values in (("position", fixes.positions_n_m), ("standard deviation", fixes.sigma_m)):
        if (bad := np.flatnonzero(~np.isfinite(values).all(axis=1))).size:
            raise DataError(f"{where}: the {name} of fix {bad[0]} is not finite")
    if (bad := np.flatnonzero((fixes.sigma_m <= 0).any(axis=1))).size:
        raise DataError(f"{where}: a standard deviation of fix {bad[0]} is not positive")
    return fixes
