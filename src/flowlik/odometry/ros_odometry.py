"""A trajectory as a ROS 2 bag of nav_msgs/Odometry, with its covariance; extra ``ros``."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import Any
from uuid import uuid4

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from flowlik.egomotion import EgoMotion
from flowlik.errors import DataError
from flowlik.geometry.trajectory import Trajectory
from flowlik.likelihood.over_time import Persistence
from flowlik.odometry.trajectory_covariance import (
    TrajectoryCovariance,
    trajectory_covariance,
    world_covariance,
)
from flowlik.support.arrays import Array
from flowlik.support.extras import extra

MESSAGE = "nav_msgs/msg/Odometry"
TOPIC = "/flowlik/odometry"
WORLD, CAMERA = "odom", "camera_link"
UNKNOWN = 1e6
"""Variance [m², rad², and per s²] of what is not known.

The usual filter (robot_localization) takes the size of a -1, ROS's other mark, for a variance of 1, and a 0
for 1e-9.
"""

R_LINK_OPTICAL = Rotation.from_matrix([[0, 0, 1], [-1, 0, 0], [0, -1, 0]])
"""Takes the camera's axes (x right, y down, z forward) to ROS's (x forward, y left, z up)."""

_SWAPPED = np.ix_([3, 4, 5, 0, 1, 2], [3, 4, 5, 0, 1, 2])
"""Translation and rotation change places, in both directions."""


def write_odometry_bag(
    path: Path | str,
    trajectory: Trajectory,
    motions: Sequence[EgoMotion],
    topic: str = TOPIC,
    unscaled: bool = False,
    persistence: Persistence | None = None,
) -> Path:
    """Write a trajectory as a ROS 2 bag (MCAP) of odometry messages with covariance.

    Axes are ROS's (REP 103): ``odom`` is the first camera's frame and ``camera_link`` the camera's, both
    turned to x forward, y left, z up. The pose's covariance is, as ROS has it, of x, y, z [m] and of turns
    about the *fixed* axes of ``odom`` [rad]. The twist is the mean velocity since the frame before, in
    ``camera_link``, with a covariance for a filter that takes every message as independent of the others.
    What is not known has the variance `UNKNOWN`: the twist of the first
    message, turns and places whose covariance is not determined, and, where a motion has no scale, all
    positions and linear velocities, which are then 0, since they would not be in metres.

    Parameters
    ----------
    path : Path or str
        Folder of the bag; an earlier bag there is replaced.
    trajectory : Trajectory
        Poses ``T_n_c``.
    motions : sequence of EgoMotion
        Of every frame after the first, with their covariances.
    topic : str
        Topic of the messages.
    unscaled : bool
        Write positions and velocities though motions have no scale, each of length 1.
    persistence : Persistence, optional
        How the errors of motions stay (`flowlik.odometry.trajectory_covariance`); by default they are taken
        as independent, and a filter becomes too sure.

    Raises
    ------
    MissingExtraError
        If rosbags is not installed.
    DataError
        If the folder holds something other than a bag, or cannot be written.
    """
    rosbag2 = extra("rosbags.rosbag2", "writing a ROS bag")
    store = _typestore()
    path = Path(path)
    if path.exists() and not (path / "metadata.yaml").is_file():
        raise DataError(f"{path}: holds something other than a ROS 2 bag")
    told = _Told(trajectory, motions, unscaled or _has_scale(motions), persistence)
    partial = path.with_name(f".{path.name}.{uuid4().hex}.part")
    try:
        partial.parent.mkdir(parents=True, exist_ok=True)
        plugin = rosbag2.StoragePlugin.MCAP
        with rosbag2.Writer(partial, version=9, storage_plugin=plugin) as writer:
            connection = writer.add_connection(topic, MESSAGE, typestore=store)
            for k in range(len(trajectory)):
                message = _message(store, told, k)
                stamp = round(float(trajectory.timestamps[k]) * 1e9)
                writer.write(connection, stamp, store.serialize_cdr(message, MESSAGE))
        (partial / f"{partial.name}.mcap").rename(partial / f"{path.name}.mcap")
        metadata = partial / "metadata.yaml"
        metadata.write_text(metadata.read_text().replace(partial.name, path.name))
        if path.exists():
            shutil.rmtree(path)
        partial.rename(path)
    except OSError as error:
        raise DataError(f"{path}: cannot be written ({error.strerror})") from error
    finally:
        shutil.rmtree(partial, ignore_errors=True)
    return path


def read_odometry_bag(path: Path | str, topic: str = TOPIC) -> tuple[Trajectory, Array]:
    """Read the poses ``T_n_c`` of a bag that `write_odometry_bag` wrote, in the camera's own axes.

    Returns
    -------
    trajectory : Trajectory
        Poses.
    covariance : array (N, 6, 6)
        Of the right perturbation of each pose, (rotation vector, translation); NaN where unknown.

    Raises
    ------
    DataError
        If there is no such topic, or the bag cannot be read.
    """
    from flowlik.datasets.ros_topic import opened

    times, poses, covariances = [], [], []
    with opened(Path(path)) as reader:
        connections = [c for c in reader.connections if c.topic == topic and c.msgtype == MESSAGE]
        if not connections:
            raise DataError(f"{path}: no {MESSAGE} on {topic}")
        for connection, _, data in reader.messages(connections):
            message = reader.deserialize(data, connection.msgtype)
            stamp, pose = message.header.stamp, message.pose.pose
            times.append(stamp.sec + stamp.nanosec * 1e-9)
            p, q = pose.position, pose.orientation
            T = RigidTransform.from_components([p.x, p.y, p.z], Rotation.from_quat([q.x, q.y, q.z, q.w]))
            link = RigidTransform.from_rotation(R_LINK_OPTICAL)
            poses.append(link.inv() * T * link)
            fixed = np.reshape(message.pose.covariance, (6, 6))[_SWAPPED]
            unknown = fixed.diagonal() >= UNKNOWN
            turned = world_covariance(RigidTransform.from_rotation(T.rotation.inv()), fixed)
            found = world_covariance(link.inv(), turned)
            found[unknown] = found[:, unknown] = np.nan
            covariances.append(found)
    return Trajectory(np.array(times), RigidTransform.concatenate(poses)), np.array(covariances)


def _ros_pose(T_n_c: RigidTransform, covariance: Array) -> tuple[RigidTransform, Array]:
    """Pose of ``camera_link`` in ``odom``, and its covariance (6, 6) as ROS orders and frames it.

    Parameters
    ----------
    T_n_c : RigidTransform
        Pose in the camera's axes.
    covariance : array (6, 6)
        Of its right perturbation, (rotation vector [rad], translation [m]).
    """
    link = RigidTransform.from_rotation(R_LINK_OPTICAL)
    fixed = world_covariance(link * T_n_c, covariance)
    return link * T_n_c * link.inv(), fixed[_SWAPPED]


def _typestore() -> Any:
    typesys = extra("rosbags.typesys", "a ROS bag")
    return typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)


class _Told:
    """Poses and twists of a trajectory as messages tell them: of what is not known nothing."""

    def __init__(
        self,
        trajectory: Trajectory,
        motions: Sequence[EgoMotion],
        metric: bool,
        persistence: Persistence | None,
    ) -> None:
        self.trajectory, self.metric, self.persistence = trajectory, metric, persistence
        self.covariance = trajectory_covariance(trajectory.timestamps, motions, persistence)

    def pose(self, k: int) -> tuple[Array, Array, Array]:
        """Position (3,) [m], quaternion x y z w, and covariance (6, 6) of ``camera_link`` in ``odom``."""
        pose, covariance = _ros_pose(self.trajectory.poses[k], self.covariance.poses[k])
        position, covariance = self._told(pose.translation, covariance)
        return position, pose.rotation.as_quat(), covariance

    def twist(self, k: int) -> tuple[Array, Array, Array]:
        """Linear [m/s] and angular [rad/s] velocity (3,) in ``camera_link``, and their covariance (6, 6)."""
        if k == 0:
            return np.zeros(3), np.zeros(3), UNKNOWN * np.eye(6)
        linear, angular, covariance = _twist(self.trajectory, self.covariance, k)
        if self.persistence is not None:
            interval_s = float(np.diff(self.trajectory.timestamps[k - 1 : k + 1])[0])
            covariance = self.persistence.filter_factor(interval_s) * covariance
        told, covariance = self._told(linear, covariance)
        return told, angular, covariance

    def _told(self, linear: Array, covariance: Array) -> tuple[Array, Array]:
        if not self.metric:
            linear, covariance = np.zeros(3), covariance.copy()
            covariance[:3] = covariance[:, :3] = np.nan
        return linear, _with_unknown(covariance)


def _has_scale(motions: Sequence[EgoMotion]) -> bool:
    """Whether all motions that go anywhere are in metres."""
    return all(
        motion.scale_known or motion.length_predicted or not np.any(motion.T_k_prev.translation)
        for motion in motions
    )


def _with_unknown(covariance: Array) -> Array:
    """Covariance (6, 6) in ROS's order, in which a half that is not determined has the variance `UNKNOWN`."""
    found = covariance.copy()
    for half in (slice(0, 3), slice(3, 6)):
        if not np.isfinite(covariance[half, half]).all():
            found[half] = found[:, half] = 0.0
            found[half, half] = UNKNOWN * np.eye(3)
    return np.where(np.isfinite(found), found, 0.0)


def bag_notes(motions: Sequence[EgoMotion], unscaled: bool = False) -> list[str]:
    """What a user of the bag that `write_odometry_bag` writes should know of it, a sentence each."""
    notes = []
    unknown = "variance 1e6"
    if not _has_scale(motions) and not unscaled:
        notes.append(
            f"odometry_bag: no scale, so that only turns are told and positions are unknown ({unknown}); "
            "--scale gives one, --save-bag-unscaled writes steps of length 1"
        )
    elif not _has_scale(motions):
        notes.append("odometry_bag: no scale, so that positions are in steps of length 1, not in metres")
    lost = next((k for k, m in enumerate(motions, start=1) if not np.isfinite(m.covariance).all()), None)
    if lost is not None:
        notes.append(
            f"odometry_bag: the covariance is not determined at frame {lost}, "
            f"and poses are unknown from there ({unknown})"
        )
    return notes


def _message(store: Any, told: _Told, k: int) -> Any:
    kinds = store.types
    place, quaternion, pose_covariance = told.pose(k)
    linear, angular, velocity_covariance = told.twist(k)
    trajectory = told.trajectory
    stamp = round(float(trajectory.timestamps[k]) * 1e9)

    def kind(name: str, *values: Any) -> Any:
        return kinds[name](*values)

    vector = "geometry_msgs/msg/Vector3"
    header = kind(
        "std_msgs/msg/Header", kind("builtin_interfaces/msg/Time", stamp // 10**9, stamp % 10**9), WORLD
    )
    position = kind("geometry_msgs/msg/Point", *map(float, place))
    orientation = kind("geometry_msgs/msg/Quaternion", *map(float, quaternion))
    where = kind(
        "geometry_msgs/msg/PoseWithCovariance",
        kind("geometry_msgs/msg/Pose", position, orientation),
        np.ascontiguousarray(pose_covariance).ravel(),
    )
    twist = kind(
        "geometry_msgs/msg/TwistWithCovariance",
        kind(
            "geometry_msgs/msg/Twist",
            kind(vector, *map(float, linear)),
            kind(vector, *map(float, angular)),
        ),
        np.ascontiguousarray(velocity_covariance).ravel(),
    )
    return kind(MESSAGE, header, CAMERA, where, twist)


def _twist(trajectory: Trajectory, covariance: TrajectoryCovariance, k: int) -> tuple[Array, Array, Array]:
    """Linear [m/s] and angular [rad/s] velocity (3,) in ``camera_link``, and their covariance (6, 6)."""
    seconds = trajectory.timestamps[k] - trajectory.timestamps[k - 1]
    # the move T_k-1_k, seen from the camera of frame k: that of inv(T_k_prev), to first order the negative
    T_k_prev = trajectory.poses[k].inv() * trajectory.poses[k - 1]
    linear = R_LINK_OPTICAL.apply(-T_k_prev.translation)
    angular = R_LINK_OPTICAL.apply(-T_k_prev.rotation.as_rotvec())
    turned = world_covariance(RigidTransform.from_rotation(R_LINK_OPTICAL), covariance.motions[k])
    return linear / seconds, angular / seconds, turned[_SWAPPED] / seconds**2
