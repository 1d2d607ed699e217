"""Images of a ROS bag (ROS 1, ROS 2, MCAP); extra ``ros``."""

from __future__ import annotations

import re
import threading
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flowlik.datasets._camera_model import matrix_lens
from flowlik.datasets._frames import Lacking
from flowlik.datasets._images import of_size
from flowlik.datasets._lens import Lens
from flowlik.datasets._ros_images import COMPRESSED, IMAGE, largest_value, to_depth, to_grey
from flowlik.datasets.base import frame_index, lacks
from flowlik.datasets.intrinsics import CameraLike, GivenCamera, given_lens
from flowlik.datasets.ros_topic import TopicIndex, bag_reader, guarded, index_topic, opened
from flowlik.errors import DataError
from flowlik.geometry.times import check_times, mutual
from flowlik.support.arrays import Array
from flowlik.support.files import printable

KINDS = (IMAGE, COMPRESSED)
CAMERA_INFO = "sensor_msgs/msg/CameraInfo"

DEPTH_TOLERANCE_S = 0.02
"""Image and depth further apart in time are not of one frame."""


class RosBag(GivenCamera, Lacking):
    """Images of one topic of a ROS bag, a `ImageSequence` without poses.

    Times are those of the messages' headers; images are sorted by them. Where stamps are zero, or contradict
    the order of receipt by more than a second, all times are those of receipt, and `notes` says so. The
    camera is the one given, else that of the ``camera_info`` beside the topic: of a topic named ``…rect…``
    its projection matrix, else its camera matrix and `lens`, whose distortion `flowlik.open_sequence`
    removes.

    Grey levels of 16 bits (mono16) become 8 bits by one shift for the whole bag: the upper eight of as many
    bits as its largest value has.

    Parameters
    ----------
    path : Path or str
        Folder of a ROS 2 bag, or a ``.mcap``, ``.db3`` or (ROS 1) ``.bag`` file.
    camera : Pinhole, str or sequence of float, optional
        Camera of every image.
    topic : str, optional
        Topic of ``sensor_msgs/Image`` or ``CompressedImage``; needed where there are several.
    depth_topic : str, optional
        Topic of depth images, registered to the others: 16UC1 [mm] or 32FC1 [m]. A frame is then an image
        with the depth nearest in time, within 0.02 s; images without are left out, and `notes` says how many.
    lenient : bool
        Times may be equal: such frames are told when they are chosen.

    Attributes
    ----------
    lens : Lens or None
        The camera given, else what ``camera_info`` says.
    times_source : str
        ``header`` or ``receipt``.
    notes : tuple of str
        What had to be chosen.

    Raises
    ------
    MissingExtraError
        If rosbags is not installed.
    DataError
        If the bag cannot be read, does not have one such topic, or times do not increase.
    """

    def __init__(
        self,
        path: Path | str,
        camera: CameraLike | None = None,
        topic: str | None = None,
        depth_topic: str | None = None,
        lenient: bool = False,
    ) -> None:
        self.path = Path(path)
        self._lock = threading.Lock()
        self._reader: Any = None
        self._depths: TopicIndex | None = None
        with opened(self.path) as reader:
            self.topic = _topic(self.path, reader, topic, depth_topic)
            largest = [0]
            self._images = index_topic(
                reader, self.path, self.topic, KINDS, lambda m, where: largest.append(largest_value(m, where))
            )
            if depth_topic is not None:
                self._depths = _index_depth(reader, self.path, depth_topic)
            self.lens = None if camera is not None else _camera_info(self.path, reader, self.topic)
        self.name = f"ros/{printable(self.path.stem)}{self.topic.replace('/', '-')}"
        self._bits = max(8, max(largest).bit_length())
        self.notes: tuple[str, ...] = ()
        self._take_times(lenient)
        if max(largest):
            shift = f"the upper 8 of {self._bits} bits are read (value >> {self._bits - 8})"
            self.notes += (f"{self.name}: grey levels of 16 bits reach {max(largest)}, so {shift}",)
        self.shape: tuple[int, ...] = self._read(0).shape
        if camera is not None:
            self.lens = given_lens(camera, self.shape)
        elif self.lens is not None:
            self.lens.pinhole(self.shape)  # refuses what is no camera of these images

    def __len__(self) -> int:
        """Return the number of images."""
        return len(self._times)

    def image(self, k: int) -> NDArray[np.uint8]:
        """Grey image (H, W) of frame k.

        Raises
        ------
        DataError
            If there is no such frame, or it is unreadable or of another size than the first.
        """
        return of_size(self._read(k), self.shape, self.path, "the first image")

    def timestamp(self, k: int) -> float:
        """Return the time [s] of frame k: in its header, or of its receipt.

        Raises
        ------
        DataError
            If there is no such frame.
        """
        return float(self._times[frame_index(self, k)])

    def depth(self, k: int) -> Array:
        """Depth (H, W) [m] along z nearest in time to frame k; NaN where unknown.

        Raises
        ------
        MissingFieldError
            If no topic of depth was given.
        DataError
            If there is no such frame, or its depth is unreadable or of another size than the images.
        """
        if self._depths is None:
            raise lacks(self.name, "depth (give its topic by --depth-topic)")
        which = int(self._depth_of[frame_index(self, k)])
        where = f"{self.path}, {self._depths.topic}, message {which}"
        with self._lock, guarded(self.path):
            message, _ = self._depths.read(self._open(), which, where)
            depth = to_depth(message, where)
        return of_size(depth, self.shape, Path(where), "the image, to which depth must be registered,")

    def __getstate__(self) -> dict[str, Any]:
        """Leave the open bag behind: another process opens its own."""
        return {key: value for key, value in self.__dict__.items() if key != "_lock"} | {"_reader": None}

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Take the rest over."""
        self.__dict__.update(state, _lock=threading.Lock())

    def _take_times(self, lenient: bool) -> None:
        """Order of the frames, their times, and which depth each has."""
        why = self._images.untimely or (self._depths.untimely if self._depths is not None else "")
        self.times_source = "receipt" if why else "header"
        if why:
            self.notes += (f"{self.name}: {why}, so that times are those of receipt",)
        times_s, self._order = self._images.times_s(receipt=bool(why))
        if self._depths is not None:
            depth_s, order = self._depths.times_s(receipt=bool(why))
            found = mutual(times_s, depth_s, DEPTH_TOLERANCE_S)
            kept = found >= 0
            if not kept.any():
                within = f"within {DEPTH_TOLERANCE_S} s of an image"
                raise DataError(f"{self.path}: no depth on {self._depths.topic} {within}")
            if not kept.all():
                left = f"{(~kept).sum()} of {len(kept)} images have no depth within {DEPTH_TOLERANCE_S} s"
                self.notes += (f"{self.name}: {left} and are left out",)
            times_s, self._order, self._depth_of = times_s[kept], self._order[kept], order[found[kept]]
        self._times = times_s
        if not lenient:
            check_times(self._times, f"{self.path}, {self.topic}")

    def _open(self) -> Any:
        if self._reader is None:
            self._reader = bag_reader(self.path)
            self._reader.open()
        return self._reader

    def _read(self, k: int) -> NDArray[np.uint8]:
        which = int(self._order[frame_index(self, k)])
        where = f"{self.path}, image {k}"
        with self._lock, guarded(self.path):
            message, kind = self._images.read(self._open(), which, where)
            return to_grey(message, kind, where, self._bits)


def _index_depth(reader: Any, path: Path, topic: str) -> TopicIndex:
    found = sorted({c.topic for c in reader.connections if c.msgtype == IMAGE})
    if topic not in found:
        raise DataError(f"{path}: no images on {topic} to take as depth, but on {', '.join(found)}")
    return index_topic(reader, path, topic, (IMAGE,), lambda message, where: None)


def _topic(path: Path, reader: Any, asked: str | None, depth_topic: str | None) -> str:
    found = sorted({c.topic for c in reader.connections if c.msgtype in KINDS and c.topic != depth_topic})
    if not found:
        raise DataError(f"{path}: no topic of images ({IMAGE} or {COMPRESSED})")
    if asked is not None and asked not in found:
        raise DataError(f"{path}: no images on {asked}, but on {', '.join(found)}")
    if asked is None and len(found) > 1:
        raise DataError(f"{path}: several topics of images, choose one by --topic: {', '.join(found)}")
    return asked or found[0]


def _camera_info(path: Path, reader: Any, topic: str) -> Lens | None:
    """Lens that the ``camera_info`` beside an image topic tells, or None where there is none."""
    parts = topic.removesuffix("/compressed").rsplit("/", 1)
    name = f"{parts[0]}/camera_info" if len(parts) == 2 else "camera_info"
    connections = [c for c in reader.connections if c.topic == name and c.msgtype == CAMERA_INFO]
    first = next(reader.messages(connections), None) if connections else None
    if first is None:
        return None
    info = reader.deserialize(first[2], CAMERA_INFO)
    rectified = re.search(r"(?:^|[^A-Za-z])rect|Rect", parts[-1]) is not None
    # ROS 1 spells the fields in capitals
    K, D, P = (np.asarray(getattr(info, n, getattr(info, n.upper(), ())), np.float64) for n in "kdp")
    matrix, model, D = (P, "none", D[:0]) if rectified else (K, str(info.distortion_model), D)
    if not matrix.any():  # a camera that was never calibrated
        return None
    size = (int(info.width), int(info.height))
    return matrix_lens(matrix, f"{path}, {name}", model, D, size if all(size) else None)
