"""Images of a ROS bag (ROS 1, ROS 2, MCAP); extra ``ros``."""

from __future__ import annotations

import re
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from flowlik.datasets.base import MAX_PIXELS, decode_bytes, frame_index, of_size
from flowlik.datasets.camera_model import matrix_lens
from flowlik.datasets.frames import Lacking
from flowlik.datasets.intrinsics import CameraLike, GivenCamera, given_lens
from flowlik.datasets.lens import Lens
from flowlik.errors import DataError, FlowlikError
from flowlik.geometry.times import check_times
from flowlik.support.extras import extra
from flowlik.support.files import printable

IMAGE, COMPRESSED = "sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage"
CAMERA_INFO = "sensor_msgs/msg/CameraInfo"

TO_GREY: dict[str, tuple[int, int | None]] = {
    "mono8": (1, None),
    "8uc1": (1, None),
    "bgr8": (3, cv2.COLOR_BGR2GRAY),
    "8uc3": (3, cv2.COLOR_BGR2GRAY),
    "rgb8": (3, cv2.COLOR_RGB2GRAY),
    "bgra8": (4, cv2.COLOR_BGRA2GRAY),
    "rgba8": (4, cv2.COLOR_RGBA2GRAY),
    "yuv422_yuy2": (2, cv2.COLOR_YUV2GRAY_YUY2),
    "yuyv": (2, cv2.COLOR_YUV2GRAY_YUY2),
    "yuv422": (2, cv2.COLOR_YUV2GRAY_UYVY),
    "uyvy": (2, cv2.COLOR_YUV2GRAY_UYVY),
    "bayer_rggb8": (1, cv2.COLOR_BayerBG2GRAY),
    "bayer_bggr8": (1, cv2.COLOR_BayerRG2GRAY),
    "bayer_gbrg8": (1, cv2.COLOR_BayerGR2GRAY),
    "bayer_grbg8": (1, cv2.COLOR_BayerGB2GRAY),
}
"""Bytes a pixel of each encoding, and OpenCV's conversion to grey."""


class RosBag(GivenCamera, Lacking):
    """Images of one topic of a ROS bag, a `ImageSequence` without truth.

    Times are those of the messages' headers; images are sorted by them. The camera is the one given, else
    that of the ``camera_info`` beside the topic: of a topic named ``…rect…`` its projection matrix, else its
    camera matrix and `lens`, whose distortion `flowlik.open_sequence` removes.

    Parameters
    ----------
    path : Path or str
        Folder of a ROS 2 bag, or a ``.mcap``, ``.db3`` or (ROS 1) ``.bag`` file.
    camera : Pinhole, str or sequence of float, optional
        Camera of every image.
    topic : str, optional
        Topic of ``sensor_msgs/Image`` or ``CompressedImage``; needed where there are several.

    Attributes
    ----------
    lens : Lens or None
        The camera given, else what ``camera_info`` says.

    Raises
    ------
    MissingExtraError
        If rosbags is not installed.
    DataError
        If the bag cannot be read, or does not have one such topic.
    """

    times_source = "header"

    def __init__(self, path: Path | str, camera: CameraLike | None = None, topic: str | None = None) -> None:
        self.path = Path(path)
        self._lock = threading.Lock()
        self._reader: Any = None
        with opened(self.path) as reader:
            self.topic = _topic(self.path, reader, topic)
            self._index(reader)
            self.lens = None if camera is not None else _camera_info(self.path, reader, self.topic)
        self.name = f"ros/{printable(self.path.stem)}{self.topic.replace('/', '-')}"
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
        """Return the time [s] in the header of frame k.

        Raises
        ------
        DataError
            If there is no such frame.
        """
        return float(self._times[frame_index(self, k)])

    def __getstate__(self) -> dict[str, Any]:
        """Leave the open bag behind: another process opens its own."""
        return {key: value for key, value in self.__dict__.items() if key != "_lock"} | {"_reader": None}

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Take the rest over."""
        self.__dict__.update(state, _lock=threading.Lock())

    def _index(self, reader: Any) -> None:
        """Header times, and where in the bag each image is: time of writing, and which of those."""
        found: list[tuple[float, int, int]] = []
        last, same = None, 0
        for connection, written, data in reader.messages(_connections(reader, self.topic)):
            same = same + 1 if written == last else 0
            last = written
            stamp = reader.deserialize(data, connection.msgtype).header.stamp
            found.append((stamp.sec + stamp.nanosec * 1e-9, written, same))
        if not found:
            raise DataError(f"{self.path}: no image on {self.topic}")
        found.sort(key=lambda row: row[0])
        self._times = np.array([row[0] for row in found])
        check_times(self._times, f"{self.path}, {self.topic}")
        self._places = [row[1:] for row in found]

    def _open(self) -> Any:
        if self._reader is None:
            self._reader = _reader(self.path)
            self._reader.open()
        return self._reader

    def _read(self, k: int) -> NDArray[np.uint8]:
        written, same = self._places[frame_index(self, k)]
        where = f"{self.path}, image {k}"
        with self._lock, _guarded(self.path):
            reader = self._open()
            messages = reader.messages(_connections(reader, self.topic), start=written, stop=written + 1)
            for number, (connection, _, data) in enumerate(messages):
                if number == same:
                    return to_grey(reader.deserialize(data, connection.msgtype), connection.msgtype, where)
        raise DataError(f"{where}: gone from the bag")


def _reader(path: Path) -> Any:
    highlevel = extra("rosbags.highlevel", "reading a ROS bag")
    typesys = extra("rosbags.typesys", "reading a ROS bag")
    if not path.exists():
        raise DataError(f"{path}: no such bag")
    store = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)
    return highlevel.AnyReader([path], default_typestore=store)


@contextmanager
def opened(path: Path) -> Iterator[Any]:
    """Reader of a bag; whatever is wrong with the bag is one DataError.

    Raises
    ------
    MissingExtraError
        If rosbags is not installed.
    DataError
        If the bag is missing or cannot be read.
    """
    with _guarded(path), _reader(path) as reader:
        yield reader


@contextmanager
def _guarded(path: Path) -> Iterator[None]:
    """Turn what is wrong with a bag into one DataError."""
    try:
        yield
    except FlowlikError:
        raise
    # damaged bags make rosbags, its parsers and the databases below fail in ways of their own
    except Exception as error:
        reason = " ".join(str(error).split())[:200] or type(error).__name__
        raise DataError(f"{path}: not a readable ROS bag ({reason})") from error


def to_grey(message: Any, kind: str, where: str) -> NDArray[np.uint8]:
    """Grey image (H, W) of a message.

    Raises
    ------
    DataError
        If its encoding is not known, or it holds fewer bytes than its size needs.
    """
    if kind == COMPRESSED:
        image = decode_bytes(bytes(message.data), where, cv2.IMREAD_ANYCOLOR)
        grey = image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
        return np.asarray(grey, dtype=np.uint8)
    height, width, step = int(message.height), int(message.width), int(message.step)
    if str(message.encoding).lower() not in TO_GREY:
        known = ", ".join(TO_GREY)
        raise DataError(f"{where}: encoding {str(message.encoding)!r} is not read, known are {known}")
    channels, conversion = TO_GREY[str(message.encoding).lower()]
    if not (0 < height * width <= MAX_PIXELS and width * channels <= step):
        raise DataError(f"{where}: impossible size {width} x {height} with rows of {step} bytes")
    if len(message.data) < height * step:
        raise DataError(f"{where}: {len(message.data)} bytes, but {height} rows take {height * step}")
    rows = np.frombuffer(message.data, np.uint8, height * step).reshape(height, step)
    pixels = np.ascontiguousarray(rows[:, : width * channels].reshape(height, width, channels))
    if channels == 1:
        pixels = pixels[..., 0]
    try:
        grey = pixels if conversion is None else cv2.cvtColor(pixels, conversion)
    except cv2.error as error:
        raise DataError(f"{where}: no image of {width} x {height} pixels has that encoding") from error
    return np.array(grey, dtype=np.uint8)


def _connections(reader: Any, topic: str) -> list[Any]:
    return [c for c in reader.connections if c.topic == topic and c.msgtype in (IMAGE, COMPRESSED)]


def _topic(path: Path, reader: Any, asked: str | None) -> str:
    found = sorted({c.topic for c in reader.connections if c.msgtype in (IMAGE, COMPRESSED)})
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
