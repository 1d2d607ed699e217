"""IMU and GPS in messages of a ROS bag; extra ``ros``."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from flowlik.datasets._layouts import BAG_SUFFIXES
from flowlik.datasets.ros_topic import guarded, opened
from flowlik.errors import DataError
from flowlik.support.arrays import Array

IMU, NAV_SAT_FIX = "sensor_msgs/msg/Imu", "sensor_msgs/msg/NavSatFix"
UNKNOWN_COVARIANCE = 0


def is_bag(path: Path) -> bool:
    """Whether a path looks like a bag: a file by its ending, or a folder with ``metadata.yaml``."""
    return path.suffix.lower() in BAG_SUFFIXES or (path / "metadata.yaml").is_file()


def read_ros_imu(path: Path, topic: str | None) -> tuple[Array, Array, Array]:
    """Stamps (N,) [s] of headers in their order, angular rates and specific forces (N, 3) of ``Imu``.

    Raises
    ------
    MissingExtraError
        If rosbags is not installed.
    DataError
        If the bag cannot be read or has no one such topic; if a stamp is zero, or a message says that it has
        no rate or no acceleration.
    """
    rows = []
    for where, stamp_s, message in _messages(path, IMU, topic):
        for name in ("angular_velocity", "linear_acceleration"):
            if _covariance(message, f"{name}_covariance")[0] == -1:
                raise DataError(f"{where}: it says that it has no {name}")
        w, a = message.angular_velocity, message.linear_acceleration
        rows.append((stamp_s, w.x, w.y, w.z, a.x, a.y, a.z))
    table = np.array(sorted(rows))
    return table[:, 0], table[:, 1:4], table[:, 4:]


def read_nav_sat(path: Path, topic: str | None) -> tuple[Array, Array, Array, int]:
    """Stamps (N,) [s], latitude, longitude [deg] and altitude [m] (N, 3), deviations (N, 3) [m], and a count.

    The count is of messages whose status says that they have no fix: they are left out.

    Raises
    ------
    MissingExtraError
        If rosbags is not installed.
    DataError
        If the bag cannot be read or has no one such topic; if a stamp is zero, no message has a fix, or one
        has no covariance.
    """
    rows, left_out = [], 0
    for where, stamp_s, message in _messages(path, NAV_SAT_FIX, topic):
        if message.status.status < 0:
            left_out += 1
            continue
        if message.position_covariance_type == UNKNOWN_COVARIANCE:
            raise DataError(f"{where}: a fix without covariance; a filter needs it, and there is no default")
        variances = _covariance(message, "position_covariance")[[0, 4, 8]]
        if not (variances > 0).all():
            raise DataError(f"{where}: a variance of the position is not positive")
        place = message.latitude, message.longitude, message.altitude
        rows.append((stamp_s, *place, *np.sqrt(variances)))
    if not rows:
        raise DataError(f"{path}: none of {left_out} messages of NavSatFix has a fix")
    table = np.array(sorted(rows))
    return table[:, 0], table[:, 1:4], table[:, 4:], left_out


def _messages(path: Path, kind: str, topic: str | None) -> Iterator[tuple[str, float, Any]]:
    """Where each message of a topic stands, its header's stamp [s], and itself."""
    with opened(path) as reader, guarded(path):
        name = kind.rpartition("/")[2]
        found = sorted({c.topic for c in reader.connections if c.msgtype == kind})
        if topic is not None and topic not in found:
            there = f", but on {', '.join(found)}" if found else ""
            raise DataError(f"{path}: no {name} on {topic}{there}")
        if topic is None and len(found) != 1:
            what = (
                f"several topics of {name}, choose one: {', '.join(found)}"
                if found
                else f"no topic of {name}"
            )
            raise DataError(f"{path}: {what}")
        chosen = topic or found[0]
        mine = [c for c in reader.connections if c.topic == chosen and c.msgtype == kind]
        for number, (connection, _, data) in enumerate(reader.messages(mine)):
            message = reader.deserialize(data, connection.msgtype)
            stamp = message.header.stamp
            where = f"{path}, {chosen}, message {number}"
            if stamp.sec == 0 and stamp.nanosec == 0:
                raise DataError(
                    f"{where}: its stamp is zero, and the time of receipt is too late for a filter"
                )
            yield where, stamp.sec + stamp.nanosec * 1e-9, message


def _covariance(message: Any, name: str) -> Array:
    return np.asarray(getattr(message, name), dtype=np.float64)
