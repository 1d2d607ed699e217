"""The ROS 2 node, with stand-ins for ROS."""

import sys
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

from examples import gtsam_fusion, ros2_node
from flowlik.egomotion import EgoMotion, Status
from flowlik.egomotion.result import unsolved
from flowlik.geometry.trajectory import Trajectory, chain
from flowlik.odometry import trajectory_covariance
from flowlik.odometry.ros_odometry import UNKNOWN, _twist
from tests.helpers import textured_image


def test_the_twist_is_that_of_the_bag():
    _, motions = gtsam_fusion.drawn_flight(3, np.random.default_rng(0))
    trajectory = Trajectory(0.1 * np.arange(4), chain([motion.T_k_prev for motion in motions]))
    covariance = trajectory_covariance(trajectory.timestamps, motions)
    for k, motion in enumerate(motions, start=1):
        for ours, theirs in zip(ros2_node.twist_of(motion, 0.1), _twist(trajectory, covariance, k)):
            np.testing.assert_allclose(ours, theirs, rtol=1e-6, atol=1e-9)


def test_what_is_not_known_is_said_so():
    unscaled = EgoMotion(
        RigidTransform.from_translation([0, 0, 1.0]), np.eye(6), np.eye(6), Status.SOLVED, scale_known=False
    )
    linear, _, covariance = ros2_node.twist_of(unscaled, 0.5)
    assert not linear.any() and covariance[0, 0] == UNKNOWN and covariance[5, 5] == 4.0
    assert np.isfinite(ros2_node.twist_of(unsolved(Status.TOO_FEW, "dark"), 0.5)[2]).all()


def message(image, time_s):
    stamp = SimpleNamespace(sec=int(time_s), nanosec=round(1e9 * (time_s % 1)))
    height, width = image.shape
    data = np.dstack([image] * 3)
    return SimpleNamespace(
        header=SimpleNamespace(stamp=stamp), height=height, width=width, step=3 * width, encoding="bgr8",
        data=data.tobytes(),
    )  # fmt: skip


@pytest.fixture
def published(monkeypatch):
    """Run the node on two images that move by a pixel; what it published."""
    found, callbacks = [], {}

    def blank():
        return SimpleNamespace(
            header=SimpleNamespace(), pose=SimpleNamespace(),
            twist=SimpleNamespace(twist=SimpleNamespace(linear=SimpleNamespace(), angular=SimpleNamespace())),
        )  # fmt: skip

    class Node:
        def __init__(self, name):
            pass

        def declare_parameter(self, name, default):
            return SimpleNamespace(value={"camera": "100,79.5,59.5"}.get(name, default))

        def create_publisher(self, kind, topic, depth):
            return SimpleNamespace(publish=found.append)

        def create_subscription(self, kind, topic, callback, depth):
            callbacks[topic] = callback

        def destroy_node(self):
            pass

    def spin(node):
        scene = textured_image((130, 170))
        for k in range(3):
            callbacks["image"](message(scene[k : k + 120, 2 * k : 2 * k + 160], 1.0 + 0.1 * k))

    modules = {
        "rclpy": {"init": lambda: None, "shutdown": lambda: None, "spin": spin},
        "rclpy.node": {"Node": Node},
        "nav_msgs": {}, "nav_msgs.msg": {"Odometry": blank},
        "sensor_msgs": {}, "sensor_msgs.msg": {"Image": object},
    }  # fmt: skip
    for name, contents in modules.items():
        module = ModuleType(name)
        vars(module).update(contents)
        monkeypatch.setitem(sys.modules, name, module)
    ros2_node.main()
    return found


def test_the_node_publishes_a_motion_an_image(published):
    assert len(published) == 2
    for odometry in published:
        assert (odometry.header.frame_id, odometry.child_frame_id) == ("odom", "camera_link")
        covariance = np.reshape(odometry.twist.covariance, (6, 6))
        assert (np.linalg.eigvalsh(covariance) > 0).all()
        assert covariance[0, 0] == UNKNOWN  # one camera: no scale


def test_an_unknown_encoding_is_refused():
    with pytest.raises(ValueError, match="yuv422"):
        ros2_node.grey_of(SimpleNamespace(data=b"1234", height=1, step=4, width=2, encoding="yuv422"))
