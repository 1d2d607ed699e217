"""Frames of a standard flight, read from its file in a cache."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform

from flowlik.calibration import Block
from flowlik.datasets.base import frame_index
from flowlik.flow.base import Image
from flowlik.geometry.camera import Pinhole
from flowlik.support.arrays import Array

FRAMES_PER_SECOND = 60


@lru_cache(maxsize=1)
def _arrays(path: Path) -> tuple[NDArray[np.uint8], NDArray[np.float32], NDArray[np.float32]]:
    """Images, flow and depth of a file, 50 to 150 MB: of one at a time."""
    with np.load(path) as data:
        return data["images"], data["flow"], data["depth"]


class Runs:
    """Frames of a flight from a cache: runs of neighbouring frames with their true flow, depth and poses.

    Frames k and k + 1 belong together only within a run, as `blocks` has them.
    """

    def __init__(self, path: Path, name: str | None = None) -> None:
        self.name, self._path = name or path.stem, path
        with np.load(path) as data:
            self.run = int(data["run"])
            self._poses = RigidTransform.from_matrix(data["pose"])
            width, height, *intrinsics = data["cam"]
            self.camera = Pinhole(int(width), int(height), *map(float, intrinsics))

    def blocks(self, seed: int, places: Sequence[int] | None = None) -> list[Block]:
        """One block a run, so that no pair spans two places: of all places or of some."""
        firsts = range(0, len(self), self.run)
        some = firsts if places is None else [firsts[place] for place in places]
        return [Block(self, range(k, k + self.run - 1), seed + k) for k in some]

    def __len__(self) -> int:
        """Return the number of frames."""
        return len(self._poses)

    def image(self, k: int) -> Image:
        """Grey image k.

        Raises
        ------
        DataError
            If there is no such frame.
        """
        return np.asarray(_arrays(self._path)[0][frame_index(self, k)])

    def flow(self, k: int) -> Array:
        """True flow (H, W, 2) [px] from frame k to k + 1; NaN at the end of a run.

        Raises
        ------
        DataError
            If there is no such frame.
        """
        return np.asarray(_arrays(self._path)[1][frame_index(self, k)], np.float64)

    def depth(self, k: int) -> Array:
        """True depth (H, W) [m] along z.

        Raises
        ------
        DataError
            If there is no such frame.
        """
        return np.asarray(_arrays(self._path)[2][frame_index(self, k)], np.float64)

    def T_n_c(self, k: int) -> RigidTransform:
        """True pose of the camera.

        Raises
        ------
        DataError
            If there is no such frame.
        """
        return self._poses[frame_index(self, k)]

    def timestamp(self, k: int) -> float:
        """Time [s] of frame k, as if all followed each other."""
        return k / FRAMES_PER_SECOND
