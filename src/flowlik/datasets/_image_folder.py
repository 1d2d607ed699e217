"""A plain folder of images, in the order of their names."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from flowlik.datasets._frames import FrameFiles
from flowlik.datasets._layouts import IMAGE_SUFFIXES
from flowlik.datasets._numbering import Numbered
from flowlik.datasets.base import NO_TIMES, frame_index
from flowlik.datasets.intrinsics import CameraLike, GivenCamera, given_lens
from flowlik.datasets.naming import counted, in_order, last_number, places
from flowlik.errors import DataError
from flowlik.geometry.times import read_times
from flowlik.support.files import printable


class ImageFolder(GivenCamera, FrameFiles):
    """The images of one size in a folder, a `ImageSequence` without truth.

    They are taken in the order of their names, in which numbers count as numbers and fractions as fractions
    (`flowlik.datasets.naming`). Times are those of ``times.txt`` (one [s] a row) if there is one in the
    folder: a row an image, or a row for every number in the images' names. Else they are frame / frame rate,
    and images that are missing by the numbers in their names are counted.

    Parameters
    ----------
    folder : Path or str
        Folder.
    camera : Pinhole, str or sequence of float, optional
        Camera of every image, free of distortion: ``f,cx,cy`` or ``fx,fy,cx,cy`` [px]. Without it `camera`
        raises.
    frames_per_second : float, optional
        Frame rate [Hz]; by default 1, so that times are frame numbers.
    lenient : bool
        Times may go back and the first images be unreadable: such frames are told when they are chosen.

    Attributes
    ----------
    times_source : str
        ``times.txt``, or such as ``frame/10s``, or ``frame number``.
    places, frame_numbers : int array (N,)
        Place of each image from the first, missing ones counted, and the number in its name.

    Raises
    ------
    DataError
        If there are no images, or two of a name, the camera does not fit, the frame rate is not positive, or
        times do not increase or are not those of these images.
    """

    def __init__(
        self,
        folder: Path | str,
        camera: CameraLike | None = None,
        frames_per_second: float | None = None,
        lenient: bool = False,
    ) -> None:
        folder = Path(folder)
        if not folder.is_dir():
            raise DataError(f"{folder}: no such folder")
        files = image_files(folder)
        if not files:
            raise DataError(f"{folder}: no images (files ending in {', '.join(sorted(IMAGE_SUFFIXES))})")
        super().__init__(f"image-folder/{printable(folder.resolve().name)}", files, lenient)
        self.lens = None if camera is None else given_lens(camera, self.shape)
        self.frames_per_second = check_rate(1.0 if frames_per_second is None else frames_per_second)
        path = folder / "times.txt"
        self._times_s = _times(path, files, lenient) if path.is_file() else None
        rate = NO_TIMES if frames_per_second is None else f"frame/{self.frames_per_second:g}s"
        self.times_source = rate if self._times_s is None else "times.txt"
        numbers, self.places = counted(files), places(files)
        self.frame_numbers = self.places if numbers is None else numbers
        if len(gaps := np.flatnonzero(np.diff(self.places) > 1)):
            first, second = (files[gaps[0] + i].name for i in (0, 1))
            others = f" and at {len(gaps) - 1} other places" if len(gaps) > 1 else ""
            self.notes = (f"{folder}: images are missing between {first} and {second}{others}",)

    def timestamp(self, k: int) -> float:
        """Return the time [s] of frame k.

        Raises
        ------
        DataError
            If there is no such frame.
        """
        k = frame_index(self, k)
        return (
            float(self.places[k] / self.frames_per_second)
            if self._times_s is None
            else float(self._times_s[k])
        )


def image_files(folder: Path) -> list[Path]:
    """Images of a folder in the order of their names, see `flowlik.datasets.naming.in_order`.

    Raises
    ------
    DataError
        If two names differ in nothing that orders them.
    """
    files = [path for path in folder.iterdir() if path.suffix.lower() in IMAGE_SUFFIXES and not path.is_dir()]
    return in_order(path for path in files if not path.name.startswith("."))


def check_rate(frames_per_second: float) -> float:
    """Frame rate [Hz] as float.

    Raises
    ------
    DataError
        If it is not positive and finite.
    """
    if not 0 < frames_per_second < float("inf"):
        raise DataError(f"frame rate {frames_per_second}: must be positive [frames/s]")
    return float(frames_per_second)


def _times(path: Path, files: list[Path], lenient: bool) -> NDArray[np.float64]:
    """Times (N,) [s] of the images: all rows, or those of the numbers in their names."""
    times_s = read_times(path, increasing=not lenient)
    if len(times_s) == len(files):
        return times_s
    numbers = [number for file in files if (number := last_number(file)) is not None]
    if len(numbers) < len(files) or any(b <= a for a, b in pairwise(numbers)):
        raise DataError(f"{path}: {len(times_s)} times for the {len(files)} images")
    frames = Numbered(files, np.array(numbers))
    return times_s[frames.rows(len(times_s), "times", path)]
