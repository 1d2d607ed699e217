"""Isolated image pairs with true flow: the sequence that KITTI flow, Middlebury and FlyingChairs share."""

from __future__ import annotations

import re
from collections.abc import Container
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from flowlik.datasets._frames import Lacking
from flowlik.datasets._images import of_size, read_grey
from flowlik.datasets._layouts import IMAGE_SUFFIXES
from flowlik.datasets.base import PairSequence, frame_index, lacks
from flowlik.datasets.flow_files import read_flow
from flowlik.datasets.naming import in_order
from flowlik.errors import DataError


@dataclass(frozen=True)
class ImagePair:
    """Files of one pair: two images, and the true flow from the first to the second where there is one."""

    first: Path
    second: Path
    truth: Path | None


class ImagePairs(PairSequence, Lacking):
    """Pairs of images of one size each, with true flow; frames 2i and 2i + 1 are pair i.

    ``png`` is the coding of true flow in PNG files, where the data set has one.

    Parameters
    ----------
    name : str
        Data set and scene.
    pairs : list of ImagePair
        Files.
    """

    png: ClassVar[str | None] = None

    def __init__(self, name: str, pairs: list[ImagePair]) -> None:
        self.name = name
        self.pairs = pairs
        self._shapes: dict[int, tuple[int, ...]] = {}

    def __len__(self) -> int:
        """Return the number of frames, twice that of pairs."""
        return 2 * len(self.pairs)

    def image(self, k: int) -> NDArray[np.uint8]:
        """Grey image (H, W) of frame k.

        Raises
        ------
        DataError
            If there is no such frame, or its file is unreadable or of another size than its partner.
        """
        pair = self.pairs[frame_index(self, k) // 2]
        if k % 2 == 0:
            image = read_grey(pair.first)
            self._shapes[k // 2] = image.shape
            return image
        return of_size(read_grey(pair.second), self._shape(k // 2), pair.second, pair.first.name)

    def flow(self, k: int) -> NDArray[np.float64]:
        """Return the true flow (H, W, 2) [px] from frame k, which must be even, to k + 1.

        Raises
        ------
        MissingFieldError
            If the pair has no truth.
        DataError
            If k is a second frame or there is no such frame, or the file is unreadable or of another
            size.
        """
        i = self.pair_index(k)
        path = self.pairs[i].truth
        if path is None:
            raise lacks(self.name, f"true flow for {self.pairs[i].first.name}")
        return of_size(self._read_truth(path), self._shape(i), path, self.pairs[i].first.name)

    def pair_index(self, k: int) -> int:
        """Number of the pair whose first frame is k.

        Raises
        ------
        DataError
            If k is a second frame, or there is no such frame.
        """
        if frame_index(self, k) % 2:
            raise DataError(f"{self.name}: frames {k} and {k + 1} are no pair, pairs begin at even frames")
        return k // 2

    def _read_truth(self, path: Path) -> NDArray[np.float64]:
        return read_flow(path, self.png)

    def _shape(self, i: int) -> tuple[int, ...]:
        if i not in self._shapes:
            self.image(2 * i)
        return self._shapes[i]


def image_pair(first: Path, second: Path, truth: Path | None) -> ImagePair:
    """Files of a pair whose images must both be there, and in one format each.

    Raises
    ------
    DataError
        If the second image is missing, or an image stands beside one of its name in another format.
    """
    if not second.is_file():
        raise DataError(f"{second}: no such image, the partner of {first.name}")
    for image in (first, second):
        for path in image.parent.iterdir():
            twin = path.stem == image.stem and path.suffix.lower() in IMAGE_SUFFIXES
            if twin and path.name != image.name:
                raise DataError(f"{path}: the same image is also {image.name}; keep one of them")
    return ImagePair(first, second, truth)


def by_stem(folder: Path, pattern: str, suffixes: Container[str]) -> dict[str, Path]:
    """Image files of a folder whose stem fits a pattern, by stem, in the order of the numbers in them.

    Raises
    ------
    DataError
        If there are two of one number, or one in two formats.
    """
    files = (p for p in folder.iterdir() if p.suffix.lower() in suffixes and re.fullmatch(pattern, p.stem))
    return {path.stem: path for path in in_order(files)}


def scene_folders(folder: Path, image: str) -> list[Path]:
    """The folder itself if it holds the named image, else those of its folders that do, sorted.

    Raises
    ------
    DataError
        If the folder is missing or neither is there.
    """
    if not folder.is_dir():
        raise DataError(f"{folder}: no such folder")
    scenes = [folder] if (folder / image).is_file() else sorted(p.parent for p in folder.glob(f"*/{image}"))
    if not scenes:
        raise DataError(f"{folder}: neither {image} nor folders with one")
    return scenes
