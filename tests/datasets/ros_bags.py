"""Bags as a camera driver leaves them: stamps, encodings and topics of one's own."""

from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest


class Message(NamedTuple):
    """An image: header stamp and time of receipt [s], encoding, values (H, W), and their order of bytes."""

    stamp_s: float
    received_s: float
    encoding: str
    values: np.ndarray
    big: bool = False
    topic: str = "/cam/image_raw"


def make_bag(path: Path, messages: list[Message]) -> Path:
    """A ROS 2 bag of these images; rows are padded, as drivers may do."""
    rosbag2 = pytest.importorskip("rosbags.rosbag2")
    typesys = pytest.importorskip("rosbags.typesys")
    store = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)
    kinds, kind = store.types, "sensor_msgs/msg/Image"
    with rosbag2.Writer(path, version=9, storage_plugin=rosbag2.StoragePlugin.MCAP) as writer:
        connections = {
            topic: writer.add_connection(topic, kind, typestore=store)
            for topic in dict.fromkeys(m.topic for m in messages)
        }
        for m in sorted(messages, key=lambda m: m.received_s):
            nanoseconds = round(m.stamp_s * 1e9)
            stamp = kinds["builtin_interfaces/msg/Time"](nanoseconds // 10**9, nanoseconds % 10**9)
            header = kinds["std_msgs/msg/Header"](stamp, "cam")
            order = m.values.dtype.newbyteorder(">" if m.big else "<")
            rows = np.ascontiguousarray(m.values.astype(order)).view(np.uint8).reshape(len(m.values), -1)
            padded = np.pad(rows, ((0, 0), (0, 0 if m.encoding == "nv12" else 6)))
            height, width = m.values.shape[:2]
            if m.encoding == "nv12":
                height = height * 2 // 3
            data = kinds[kind](header, height, width, m.encoding, m.big, padded.shape[1], padded.ravel())
            writer.write(connections[m.topic], round(m.received_s * 1e9), store.serialize_cdr(data, kind))
    return path
