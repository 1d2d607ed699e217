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
UNKNOWN = -1.0
"""First entry of a covariance that is not known, as in ROS's other messages."""

R_LINK_OPTICAL = Rotation.from_matrix([[0, 0, 1], [-1, 0, 0], [0, -1, 0]])
"""Takes the camera's axes (x right, y down, z forward) to ROS's (x forward, y left, z up)."""

_SWAPPED = np.ix_([3, 4, 5, 0, 1, 2], [3, 4, 5, 0, 1, 2])
"""Translation and rotation change places, in both directions."""


def write_odometry_bag(
    path: Path | str, trajectory: Trajectory, motions: Sequence[EgoMotion], topic: str = TOPIC
) -> Path:
    """Write a trajectory as a ROS 2 bag (MCAP) of odometry messages with covariance.

    Axes are ROS's (REP 103): ``odom`` is the first camera's frame and ``camera_link`` the camera's, both
    turned to x forward, y left, z up. The pose's covariance is, as ROS has it, of x, y, z [m] and of turns
    about the *fixed* axes of ``odom`` [rad]. The twist is the mean velocity since the frame before, in
    ``camera_link``, with its covariance. Where a covariance is not determined its first entry is -1.

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
    covariance = trajectory_covariance(trajectory.timestamps, motions)
    partial = path.with_name(f".{path.name}.{uuid4().hex}.part")
    try:
        partial.parent.mkdir(parents=True, exist_ok=True)
        plugin = rosbag2.StoragePlugin.MCAP
        with rosbag2.Writer(partial, version=9, storage_plugin=plugin) as writer:
            connection = writer.add_connection(topic, MESSAGE, typestore=store)
            for k in range(len(trajectory)):
                message = _message(store, trajectory, covariance, k)
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
            if fixed[3, 3] == UNKNOWN:
                fixed = np.full((6, 6), np.nan)
            turned = world_covariance(RigidTransform.from_rotation(T.rotation.inv()), fixed)
            covariances.append(world_covariance(link.inv(), turned))
    return Trajectory(np.array(times), RigidTransform.concatenate(poses)), np.array(covariances)


def ros_pose(T_n_c: RigidTransform, covariance: Array) -> tuple[RigidTransform, Array]:
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


def _message(store: Any, trajectory: Trajectory, covariance: TrajectoryCovariance, k: int) -> Any:
    kinds = store.types
    pose, pose_covariance = ros_pose(trajectory.poses[k], covariance.poses[k])
    velocity, velocity_covariance = _twist(trajectory, covariance, k)
    stamp = round(float(trajectory.timestamps[k]) * 1e9)

    def kind(name: str, *values: Any) -> Any:
        return kinds[name](*values)

    vector = "geometry_msgs/msg/Vector3"
    header = kind(
        "std_msgs/msg/Header", kind("builtin_interfaces/msg/Time", stamp // 10**9, stamp % 10**9), WORLD
    )
    position = kind("geometry_msgs/msg/Point", *map(float, pose.translation))
    orientation = kind("geometry_msgs/msg/Quaternion", *map(float, pose.rotation.as_quat()))
    where = kind(
        "geometry_msgs/msg/PoseWithCovariance",
        kind("geometry_msgs/msg/Pose", position, orientation),
        _entries(pose_covariance),
    )
    twist = kind(
        "geometry_msgs/msg/TwistWithCovariance",
        kind(
            "geometry_msgs/msg/Twist",
            kind(vector, *map(float, velocity[:3])),
            kind(vector, *map(float, velocity[3:])),
        ),
        _entries(velocity_covariance),
    )
    return kind(MESSAGE, header, CAMERA, where, twist)


def _twist(trajectory: Trajectory, covariance: TrajectoryCovariance, k: int) -> tuple[Array, Array]:
    """Linear [m/s] and angular [rad/s] velocity (6,) in ``camera_link``, and its covariance."""
    if k == 0:
        return np.zeros(6), np.full((6, 6), np.nan)
    seconds = trajectory.timestamps[k] - trajectory.timestamps[k - 1]
    # the move T_k-1_k, seen from the camera of frame k: that of inv(T_k_prev), to first order the negative
    T_k_prev = trajectory.poses[k].inv() * trajectory.poses[k - 1]
    linear = R_LINK_OPTICAL.apply(-T_k_prev.translation)
    angular = R_LINK_OPTICAL.apply(-T_k_prev.rotation.as_rotvec())
    turned = world_covariance(RigidTransform.from_rotation(R_LINK_OPTICAL), covariance.motions[k])
    ordered = turned[_SWAPPED]
    return np.concatenate([linear, angular]) / seconds, ordered / seconds**2


def _entries(covariance: Array) -> Array:
    """The 36 numbers of a message, row by row."""
    if not np.isfinite(covariance).all():
        covariance = np.zeros((6, 6))
        covariance[0, 0] = UNKNOWN
    return np.ascontiguousarray(covariance, dtype=np.float64).ravel()
