"""A video file, its frames decoded in order."""

from __future__ import annotations

import os
import threading
from collections import OrderedDict
from functools import cached_property
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from flowlik.datasets._containers import AVI, ISO, MPEG_PROGRAM, container_of, is_all_there
from flowlik.datasets._frames import Lacking
from flowlik.datasets._image_folder import check_rate
from flowlik.datasets._images import MAX_PIXELS
from flowlik.datasets.base import frame_index
from flowlik.datasets.intrinsics import CameraLike, GivenCamera, given_lens
from flowlik.errors import DataError
from flowlik.geometry.times import check_times
from flowlik.support.files import printable

RECENT_FRAMES = 8


class Video(GivenCamera, Lacking):
    """A video file that OpenCV can decode, a `ImageSequence` without truth.

    Frames are read in order, since seeking is inexact in many formats: the latest eight are at hand, an
    earlier one begins again from the start. Frames are counted by decoding once, when first asked for. Times
    are the container's time stamps, whether evenly spaced or not; a frame rate that is given counts instead,
    and the file's own where its container has none for all frames (AVI, MPEG program streams).

    Parameters
    ----------
    path : Path or str
        File.
    camera : Pinhole, str or sequence of float, optional
        Camera of every frame, free of distortion: ``f,cx,cy`` or ``fx,fy,cx,cy`` [px]. Without it `camera`
        raises.
    frames_per_second : float, optional
        Frame rate [Hz], instead of the file's time stamps.
    lenient : bool
        Time stamps may go back: such frames are told when they are chosen.

    Attributes
    ----------
    times_source : str
        ``container``, or such as ``frame/20s``; counts frames when first asked for.
    notes : tuple of str
        What is odd about the file.

    Raises
    ------
    DataError
        If the file is missing, cut off or not a readable video, or the camera does not fit; when a time is
        first asked for, if time stamps do not increase.
    """

    def __init__(
        self,
        path: Path | str,
        camera: CameraLike | None = None,
        frames_per_second: float | None = None,
        lenient: bool = False,
    ) -> None:
        self.path = Path(path)
        self.name = f"video/{printable(self.path.stem)}"
        self._capture: Any = None
        self._next = 0
        self._lock = threading.Lock()
        self._recent: OrderedDict[int, NDArray[np.uint8]] = OrderedDict()
        capture = self._open()
        self._claimed = float(capture.get(cv2.CAP_PROP_FRAME_COUNT))
        rate = float(capture.get(cv2.CAP_PROP_FPS))
        self._own_rate = rate if 0 < rate < float("inf") else None
        self._given_rate = None if frames_per_second is None else check_rate(frames_per_second)
        self._container, self._lenient = container_of(self.path), lenient
        self._capture = capture
        first = self._read(0)
        if first is None:
            raise DataError(f"{self.path}: no frame can be decoded (truncated, damaged or not a video)")
        self.shape: tuple[int, ...] = first.shape
        self.lens = None if camera is None else given_lens(camera, first.shape)

    def __len__(self) -> int:
        """Return the number of frames that can be decoded."""
        return len(self._stamps_s)

    def image(self, k: int) -> NDArray[np.uint8]:
        """Grey image (H, W) of frame k.

        Raises
        ------
        DataError
            If there is no such frame, or it is of another size than the first.
        """
        image = self._read(k) if k >= 0 else None
        if image is None:
            raise DataError(f"{self.name}: no frame {k}, there are {len(self)} frames in {self.path}")
        if image.shape != self.shape:
            raise DataError(f"{self.path}: frame {k} has shape {image.shape}, the first one {self.shape}")
        return image

    def timestamp(self, k: int) -> float:
        """Return the time [s] of frame k.

        Raises
        ------
        DataError
            If there is no such frame, or the file's time stamps do not increase.
        """
        rate = self._rate
        return k / rate if rate is not None else float(self._times_s[frame_index(self, k)])

    @property
    def notes(self) -> tuple[str, ...]:
        """What is odd about the file: frames end well before its header says."""
        if self._container not in (ISO, AVI) or self._own_rate is None:  # others count the sound too
            return ()
        claimed_s, found_s = self._claimed / self._own_rate, float(self._stamps_s.max(initial=0.0))
        if found_s > 0.9 * claimed_s - 3 / self._own_rate:
            return ()
        claim = f"its header claims {claimed_s:.2f} s, frames up to {found_s:.2f} s can be decoded"
        return (f"{self.name}: {claim}: trimmed by its player, or damaged",)

    @property
    def times_source(self) -> str:
        """Where the times come from."""
        return "container" if self._rate is None else f"frame/{self._rate:g}s"

    def __getstate__(self) -> dict[str, Any]:
        """Leave the open file behind: another process opens its own."""
        state = self.__dict__ | {"_capture": None, "_next": 0, "_recent": OrderedDict()}
        del state["_lock"]
        return state

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Take the rest over."""
        self.__dict__.update(state, _lock=threading.Lock())

    @cached_property
    def _stamps_s(self) -> NDArray[np.float64]:
        """Time stamps (N,) [s] of all frames that can be decoded."""
        capture = self._open()
        stamps = []
        while capture.grab():
            stamps.append(capture.get(cv2.CAP_PROP_POS_MSEC) / 1000)
        return np.array(stamps)

    @cached_property
    def _rate(self) -> float | None:
        """Frame rate [Hz] that was given, or stands for stamps that the container lacks, or None."""
        partly = self._container in (AVI, MPEG_PROGRAM)
        if self._given_rate is None and partly and (np.diff(self._stamps_s) <= 0).any():
            return self._own_rate
        return self._given_rate

    @cached_property
    def _times_s(self) -> NDArray[np.float64]:
        if not self._lenient:
            check_times(self._stamps_s, f"{self.path}, time stamps (--fps gives a frame rate instead)")
        return self._stamps_s

    def _read(self, k: int) -> NDArray[np.uint8] | None:
        """Frame k, or None beyond the end."""
        with self._lock:
            return self._decode(k)

    def _decode(self, k: int) -> NDArray[np.uint8] | None:
        if k in self._recent:
            return self._recent[k]
        if self._capture is None or k < self._next:
            self._capture, self._next = self._open(), 0
        while self._next < k:
            if not self._capture.grab():
                return None
            self._next += 1
        found, frame = self._capture.read()
        if not found:
            return None
        self._next += 1
        image = frame if frame.ndim == 2 else cv2.cvtColor(frame, cv2.COLOR_BGR2GRAY)
        self._recent[k] = np.asarray(image, dtype=np.uint8)
        if len(self._recent) > RECENT_FRAMES:
            self._recent.popitem(last=False)
        return self._recent[k]

    def _open(self) -> Any:
        if not self.path.is_file():
            raise DataError(f"{self.path}: no such video file")
        if printable(str(self.path)) != str(self.path):  # which ends the process inside OpenCV
            raise DataError(f"{self.path}: a video's name must be UTF-8; rename the file or its folder")
        # else FFmpeg's own complaints would stand beside the one error
        os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")
        if not is_all_there(self.path):
            raise DataError(f"{self.path}: not a readable video (truncated: its last part is cut off)")
        try:
            capture = cv2.VideoCapture(str(self.path))
        except cv2.error as error:
            raise DataError(f"{self.path}: not a readable video") from error
        if not capture.isOpened():
            raise DataError(
                f"{self.path}: not a readable video (truncated, damaged or of a kind OpenCV lacks)"
            )
        width, height = (capture.get(p) for p in (cv2.CAP_PROP_FRAME_WIDTH, cv2.CAP_PROP_FRAME_HEIGHT))
        if width * height > MAX_PIXELS:
            raise DataError(
                f"{self.path}: claims frames of {width:.0f} x {height:.0f} pixels, more than allowed"
            )
        return capture
