"""A camera while it films: a device of this machine, or a stream's address."""

from __future__ import annotations

import re
import threading
import time
from pathlib import Path
from types import TracebackType
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from flowlik.datasets._frames import Lacking
from flowlik.datasets.intrinsics import CameraLike, GivenCamera, given_lens
from flowlik.errors import DataError

DEVICE = re.compile(r"/dev/video(\d+)")
# a path loses one of the two slashes of an address
ADDRESS = re.compile(r"(rtsp|rtsps|rtmp|http|https|udp|tcp|rtp):/+(.+)")
PATIENCE_S = 10.0


def live_address(data: Path | str) -> str | None:
    """Device (``/dev/video0``) or address (``rtsp://…``) of a live camera; None for all that is a file."""
    if DEVICE.fullmatch(str(data)):
        return str(data)
    found = ADDRESS.fullmatch(str(data))
    return None if found is None else f"{found[1]}://{found[2]}"


class Live(GivenCamera, Lacking):
    """Images of a camera as they come, read by OpenCV; an `ImageSequence` that can be read once, in order.

    A thread takes every image from the camera, so that none waits there; who asks for the next frame gets the
    newest. What came in between is left out and counted. Times are those of receipt: a camera's delay is in
    them, and what the network adds.

    Parameters
    ----------
    address : str
        As `live_address` gives it.
    camera : Pinhole, Lens, str, Path or sequence of float, optional
        Camera of every frame, as `flowlik.datasets.open_sequence` takes it. Without it `camera` raises.

    Attributes
    ----------
    dropped : int
        Images that came while another was worked on.

    Raises
    ------
    DataError
        If the camera cannot be opened, or gives no image for ten seconds.
    """

    times_source = "receipt"

    def __init__(self, address: str, camera: CameraLike | None = None) -> None:
        self.name = f"live/{re.sub(r'[^0-9A-Za-z.-]+', '-', address).strip('-')}"
        self.address, self.dropped = address, 0
        self._times_s: list[float] = []
        self._image: NDArray[np.uint8] | None = None
        self._newest: tuple[float, Any] | None = None
        self._ended, self._arrived = False, threading.Condition()
        device = DEVICE.fullmatch(address)
        self._capture = cv2.VideoCapture(int(device[1]) if device else address)
        if not self._capture.isOpened():
            raise DataError(f"{address}: this camera or stream cannot be opened")
        threading.Thread(target=self._receive, daemon=True, name="flowlik-live").start()
        if not self.more():
            raise DataError(f"{address}: the stream ended before its first image")
        assert self._image is not None
        self.shape: tuple[int, ...] = self._image.shape
        self.lens = None if camera is None else given_lens(camera, self.shape)

    def __enter__(self) -> Live:
        """Return the camera itself."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Let go of the camera."""
        self.close()

    def close(self) -> None:
        """Let go of the camera; `more` is then False."""
        with self._arrived:
            self._ended, self._newest = True, None
            self._arrived.notify_all()

    def __len__(self) -> int:
        """Return the number of frames so far."""
        return len(self._times_s)

    def more(self) -> bool:
        """Wait for the next frame, and say whether one came before the end.

        Raises
        ------
        DataError
            If none comes for ten seconds, or it is of another size than the first.
        """
        with self._arrived:
            if not self._arrived.wait_for(lambda: self._newest is not None or self._ended, PATIENCE_S):
                raise DataError(f"{self.address}: no image for {PATIENCE_S:g} s")
            if self._newest is None:
                return False
            (time_s, image), self._newest = self._newest, None
        grey = image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
        if self._times_s and grey.shape != self.shape:
            raise DataError(f"{self.address}: an image has shape {grey.shape}, the first one {self.shape}")
        self._times_s.append(time_s)
        self._image = grey
        return True

    def image(self, k: int) -> NDArray[np.uint8]:
        """Grey image (H, W) of the last frame.

        Raises
        ------
        DataError
            If another frame is asked for: it is gone.
        """
        if k != len(self) - 1 or self._image is None:
            raise DataError(f"{self.name}: frame {k} is gone or not there yet; the last is {len(self) - 1}")
        return self._image

    def timestamp(self, k: int) -> float:
        """Return the time [s since 1970] at which frame k was received."""
        return self._times_s[k]

    def _receive(self) -> None:
        while True:
            taken, image = self._capture.read()
            with self._arrived:
                if self._ended or not taken:
                    self._ended = True
                    self._arrived.notify_all()
                    break
                self.dropped += self._newest is not None
                # two images of one clock tick would have no time between them
                last = self._times_s[-1] if self._times_s else -np.inf
                self._newest = (max(time.time(), float(np.nextafter(last, np.inf))), image)
                self._arrived.notify_all()
        self._capture.release()
