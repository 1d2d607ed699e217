"""Messages of one topic of a ROS bag: when they were taken, and where in the bag they are."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flowlik.errors import DataError, FlowlikError
from flowlik.support.arrays import Array
from flowlik.support.extras import extra

LATE_S = 1.0
"""Messages received so much [s] after others of later stamps: their stamps are no times of images."""


@dataclass(frozen=True, eq=False)
class TopicIndex:
    """Messages of a topic in the order of their receipt.

    Attributes
    ----------
    topic : str
        Its name.
    kinds : tuple of str
        Types of messages that count.
    header_s, received_s : array (N,)
        Times [s] in their headers, and of their receipt.
    places : list of tuple of int
        Time of receipt [ns], and which of the messages of that time.
    """

    topic: str
    kinds: tuple[str, ...]
    header_s: Array
    received_s: Array
    places: list[tuple[int, int]]

    @property
    def untimely(self) -> str:
        """Why the headers' times are no times of images, or nothing."""
        unset = int((self.header_s == 0).sum())
        if unset:
            return f"{unset} of {len(self.places)} header stamps are zero"
        received_s = self.received_s[np.argsort(self.header_s, kind="stable")]
        late_s = float((np.maximum.accumulate(received_s) - received_s).max())
        if late_s > LATE_S:
            return f"header stamps contradict the order of receipt by up to {late_s:.3g} s"
        return ""

    def times_s(self, receipt: bool) -> tuple[Array, NDArray[np.int64]]:
        """Times (N,) [s] in their order, of receipt or of the headers, and which message each is."""
        times_s = self.received_s if receipt else self.header_s
        order = np.argsort(times_s, kind="stable")
        return times_s[order], order

    def read(self, reader: Any, which: int, where: str) -> tuple[Any, str]:
        """Message of a number in the order of receipt, from an open reader, and its type.

        Raises
        ------
        DataError
            If it is no longer there.
        """
        received, same = self.places[which]
        mine = _connections(reader, self.topic, self.kinds)
        messages = reader.messages(mine, start=received, stop=received + 1)
        for number, (connection, _, data) in enumerate(messages):
            if number == same:
                return reader.deserialize(data, connection.msgtype), connection.msgtype
        raise DataError(f"{where}: gone from the bag")


def index_topic(
    reader: Any, path: Path, topic: str, kinds: tuple[str, ...], look: Callable[[Any, str], None]
) -> TopicIndex:
    """Go through all messages of a topic once; ``look`` sees each, and the beginning of its errors.

    Raises
    ------
    DataError
        If there are none.
    """
    header_s: list[float] = []
    places: list[tuple[int, int]] = []
    for connection, received, data in reader.messages(_connections(reader, topic, kinds)):
        same = places[-1][1] + 1 if places and places[-1][0] == received else 0
        message = reader.deserialize(data, connection.msgtype)
        stamp = message.header.stamp
        header_s.append(stamp.sec + stamp.nanosec * 1e-9)
        places.append((received, same))
        look(message, f"{path}, {topic}, message {len(places) - 1}")
    if not places:
        raise DataError(f"{path}: no image on {topic}")
    received_s = np.array([received for received, _ in places]) * 1e-9
    return TopicIndex(topic, kinds, np.array(header_s), received_s, places)


def bag_reader(path: Path) -> Any:
    """Reader of a bag that is still to be opened.

    Raises
    ------
    MissingExtraError
        If rosbags is not installed.
    DataError
        If there is no such bag.
    """
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
    with guarded(path), bag_reader(path) as reader:
        yield reader


@contextmanager
def guarded(path: Path) -> Iterator[None]:
    """Turn what is wrong with a bag into one DataError.

    Raises
    ------
    DataError
        If anything else than flowlik's own errors is raised inside.
    """
    try:
        yield
    except FlowlikError:
        raise
    # damaged bags make rosbags, its parsers and the databases below fail in ways of their own
    except Exception as error:
        reason = " ".join(str(error).split())[:200] or type(error).__name__
        raise DataError(f"{path}: not a readable ROS bag ({reason})") from error


def _connections(reader: Any, topic: str, kinds: tuple[str, ...]) -> list[Any]:
    return [c for c in reader.connections if c.topic == topic and c.msgtype in kinds]
