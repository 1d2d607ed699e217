"""A ROS 2 node: images in, `nav_msgs/Odometry` out, with a covariance that a filter can take.

    python examples/ros2_node.py --ros-args -p camera:=camera.yaml -r image:=/camera/image_raw

With a topic of depth (`depth`, 32FC1 [m], registered) motions are metric; without it turns are
known, velocities are not (variance 1e6). The twist is what `flowlik odometry --save-bag` writes. Needs
a ROS 2 with rclpy; flowlik itself does not.
"""

from __future__ import annotations

import cv2
import numpy as np

import flowlik
from flowlik.datasets.intrinsics import given_lens
from flowlik.flow import confirmed_method
from flowlik.odometry.ros_odometry import CAMERA, R_LINK_OPTICAL, TOPIC, UNKNOWN, WORLD

GREY = {"rgb8": cv2.COLOR_RGB2GRAY, "bgr8": cv2.COLOR_BGR2GRAY}


def twist_of(motion, seconds, persistence=None):  # type: ignore[no-untyped-def]
    """Linear [m/s] and angular [rad/s] velocity in ``camera_link``, and their covariance in ROS's order.

    What the images did not tell is 0 with the variance `UNKNOWN`. Where the model knows how errors stay over
    time (`Odometry.persistence`), the covariance is that of a filter's measurement, every frame.
    """
    T = motion.T_k_prev.inv()  # where the camera of image k is, seen from that of image k-1
    turn = motion.T_k_prev.rotation  # and seen from its own axes
    linear = R_LINK_OPTICAL.apply(turn.apply(T.translation)) / seconds
    angular = R_LINK_OPTICAL.apply(turn.apply(T.rotation.as_rotvec())) / seconds
    R = np.kron(np.eye(2), R_LINK_OPTICAL.as_matrix())
    factor = 1.0 if persistence is None else persistence.filter_factor(seconds)
    order = np.ix_([3, 4, 5, 0, 1, 2], [3, 4, 5, 0, 1, 2])
    covariance = factor * (R @ motion.covering @ R.T / seconds**2)[order]
    if not (motion.scale_known or motion.length_predicted):
        linear, covariance[:3], covariance[:, :3] = np.zeros(3), np.nan, np.nan
    for half in (slice(0, 3), slice(3, 6)):
        if not np.isfinite(covariance[half, half]).all():
            covariance[half] = covariance[:, half] = 0.0
            covariance[half, half] = UNKNOWN * np.eye(3)
    return linear, angular, covariance


def grey_of(message) -> np.ndarray:  # type: ignore[no-untyped-def]
    """Grey image (H, W) of a `sensor_msgs/Image` in mono8, rgb8 or bgr8.

    Raises
    ------
    ValueError
        If it has another encoding.
    """
    rows = np.frombuffer(bytes(message.data), np.uint8).reshape(message.height, message.step)
    if message.encoding == "mono8":
        return np.ascontiguousarray(rows[:, : message.width])
    if message.encoding not in GREY:
        raise ValueError(f"images in {message.encoding}: known are mono8, {', '.join(GREY)}")
    pixels = rows[:, : 3 * message.width].reshape(message.height, message.width, 3)
    return cv2.cvtColor(pixels, GREY[message.encoding])


def seconds_of(stamp) -> float:  # type: ignore[no-untyped-def]
    """Time [s] of a message."""
    return stamp.sec + 1e-9 * stamp.nanosec


def main() -> None:
    """Run the node until it is stopped."""
    import rclpy
    from nav_msgs.msg import Odometry as Message
    from rclpy.node import Node
    from sensor_msgs.msg import Image

    class FlowlikNode(Node):
        def __init__(self) -> None:
            super().__init__("flowlik")
            camera = str(self.declare_parameter("camera", "").value)
            model = flowlik.load_likelihood(str(self.declare_parameter("model", "lucas-kanade").value))
            self.lens, self.usable, self.camera = None, None, camera
            self.model, self.odometry = model, None
            self.depths: dict[float, np.ndarray] = {}
            self.publisher = self.create_publisher(Message, TOPIC, 10)
            self.create_subscription(Image, "depth", self.take_depth, 10)
            self.create_subscription(Image, "image", self.take_image, 10)

        def take_depth(self, message) -> None:  # type: ignore[no-untyped-def]
            rows = np.frombuffer(bytes(message.data), np.float32).reshape(message.height, message.step // 4)
            self.depths = {seconds_of(message.header.stamp): rows[:, : message.width].copy()}

        def take_image(self, message) -> None:  # type: ignore[no-untyped-def]
            image, time_s = grey_of(message), seconds_of(message.header.stamp)
            if self.odometry is None:
                self.lens = given_lens(self.camera, image.shape)
                method = confirmed_method(self.model.method, None)
                camera = self.lens.pinhole(image.shape)
                self.odometry = flowlik.Odometry(camera, method, flowlik.lcmsac(self.model))
                self.usable = self.lens.valid(image.shape) if self.lens.distorts else None
            before = self.odometry.timestamps[-1] if self.odometry.timestamps else None
            image = self.lens.undistort(image)
            motion = self.odometry.step(image, time_s, self.depths.get(time_s), usable=self.usable)
            if before is None:
                return
            linear, angular, covariance = twist_of(motion, time_s - before, self.odometry.persistence)
            found = Message()
            found.header.stamp, found.header.frame_id, found.child_frame_id = (
                message.header.stamp,
                WORLD,
                CAMERA,
            )
            v, w = found.twist.twist.linear, found.twist.twist.angular
            v.x, v.y, v.z = map(float, linear)
            w.x, w.y, w.z = map(float, angular)
            found.twist.covariance = covariance.ravel().tolist()
            found.pose.covariance = (UNKNOWN * np.eye(6)).ravel().tolist()  # a filter integrates the twist
            self.publisher.publish(found)

    rclpy.init()
    node = FlowlikNode()
    try:
        rclpy.spin(node)
    finally:
        node.destroy_node()
        rclpy.shutdown()


if __name__ == "__main__":
    main()
