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

from flowlik.datasets.base import MAX_PIXELS, lacks
from flowlik.datasets.frames import Lacking
from flowlik.datasets.image_folder import check_rate
from flowlik.datasets.intrinsics import CameraLike, GivenCamera, given_camera
from flowlik.errors import DataError

RECENT_FRAMES = 8


class Video(GivenCamera, Lacking):
    """A video file that OpenCV can decode, a `ImageSequence` without truth.

    Frames are read in order, since seeking is inexact in many formats: the latest eight are at hand, an
    earlier one begins again from the start. The number of frames is counted by decoding once, when first
    asked for. Times are frame / frame rate, also where a file has a variable one.

    Parameters
    ----------
    path : Path or str
        File.
    camera : Pinhole, str or sequence of float, optional
        Camera of every frame, free of distortion: ``f,cx,cy`` or ``fx,fy,cx,cy`` [px]. Without it `camera`
        raises.
    frames_per_second : float, optional
        Frame rate [Hz]; by default the file's.

    Raises
    ------
    DataError
        If the file is missing or not a readable video, or the camera does not fit; when frames are counted,
        if the file ends well before its header says.
    """

    def __init__(
        self, path: Path | str, camera: CameraLike | None = None, frames_per_second: float | None = None
    ) -> None:
        self.path = Path(path)
        self.name = f"video/{self.path.stem}"
        self._capture: Any = None
        self._next = 0
        self._lock = threading.Lock()
        self._recent: OrderedDict[int, NDArray[np.uint8]] = OrderedDict()
        capture = self._open()
        self._claimed = float(capture.get(cv2.CAP_PROP_FRAME_COUNT))
        rate = capture.get(cv2.CAP_PROP_FPS) if frames_per_second is None else check_rate(frames_per_second)
        self._rate = rate if 0 < rate < float("inf") else None
        self.times_source = None if self._rate is None else f"frame/{self._rate:g}s"
        self._capture = capture
        first = self._read(0)
        if first is None:
            raise DataError(f"{self.path}: no frame can be decoded (truncated, damaged or not a video)")
        self.shape: tuple[int, ...] = first.shape
        self._camera = None if camera is None else given_camera(camera, first.shape)

    def __len__(self) -> int:
        """Return the number of frames that can be decoded."""
        return self._frames

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
        MissingFieldError
            If neither the file nor the user gives a frame rate.
        """
        if self._rate is None:
            raise lacks(self.name, "frame rate (give one by --frames-per-second)")
        return k / self._rate

    def __getstate__(self) -> dict[str, Any]:
        """Leave the open file behind: another process opens its own."""
        state = self.__dict__ | {"_capture": None, "_next": 0, "_recent": OrderedDict()}
        del state["_lock"]
        return state

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Take the rest over."""
        self.__dict__.update(state, _lock=threading.Lock())

    @cached_property
    def _frames(self) -> int:
        capture = self._open()
        count = 0
        while capture.grab():
            count += 1
        if count < 0.9 * self._claimed - 2:
            claim = f"its header claims {self._claimed:.0f} frames, {count} can be decoded"
            raise DataError(f"{self.path}: {claim} (truncated or damaged)")
        return count

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
        # else FFmpeg's own complaints would stand beside the one error
        os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")
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
