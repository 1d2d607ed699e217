"""MPI-Sintel: one scene in one rendering pass, with true flow."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from flowlik.datasets._frames import FrameFiles
from flowlik.datasets._images import decode_image, of_size
from flowlik.datasets._numbering import numbered
from flowlik.datasets.base import frame_index, lacks
from flowlik.datasets.flow_files import read_flow
from flowlik.errors import DataError
from flowlik.support.files import printable

PASSES = ("clean", "final", "albedo")


class Sintel(FrameFiles):
    """One scene of the MPI-Sintel flow data set (Butler et al. 2012), a `ImageSequence`.

    ``training/{clean,final,albedo}/<scene>/frame_NNNN.png`` with, beside the pass, ``flow/<scene>/*.flo``
    (exact, from the renderer), ``occlusions`` and ``invalid`` (masks, 0 where a pixel is fine). Occluded
    pixels keep their flow, invalid ones become NaN. Without camera, times, poses and depth (Sintel's extra
    download is not read).

    Parameters
    ----------
    folder : Path or str
        A scene of one pass, e.g. ``training/clean/alley_1``.
    lenient : bool
        Images may be missing between others: they are told when they are chosen.

    Raises
    ------
    DataError
        If the folder is not such a scene, or its frames are not numbered without gaps.
    """

    def __init__(self, folder: Path | str, lenient: bool = False) -> None:
        folder = Path(folder)
        if not folder.is_dir():
            raise DataError(f"{folder}: no such folder")
        files = list(folder.glob("frame_*.png"))
        if not files:
            raise DataError(
                f"{folder}: no images frame_NNNN.png, expected one scene such as training/clean/alley_1"
            )
        files = numbered(files, r"frame_([0-9]+)\.png", "frame_NNNN.png", lenient).files
        self.scene, self.root = folder.resolve().name, folder.resolve().parent.parent
        super().__init__(f"sintel/{printable(self.scene)}-{folder.resolve().parent.name}", files, lenient)

    def flow(self, k: int) -> NDArray[np.float64]:
        """Return the true flow (H, W, 2) [px] from frame k to k + 1; NaN where invalid.

        Raises
        ------
        MissingFieldError
            If there is no folder of true flow.
        DataError
            If there is no such frame or none after it, or a file is missing, damaged or of another size.
        """
        path = self._beside("flow", k, ".flo")
        flow = of_size(read_flow(path), self.shape, path, "the image")
        flow[self._mask("invalid", k)] = np.nan
        return flow

    def visible(self, k: int) -> NDArray[np.bool_]:
        """Return which pixels (H, W) of frame k are not occluded in frame k + 1."""
        return ~self._mask("occlusions", k)

    def _mask(self, kind: str, k: int) -> NDArray[np.bool_]:
        path = self._beside(kind, k, ".png")
        mask = decode_image(path, cv2.IMREAD_GRAYSCALE)
        return np.asarray(of_size(mask, self.shape, path, "the image") != 0)

    def _beside(self, kind: str, k: int, suffix: str) -> Path:
        """File of one kind for frame k."""
        frame_index(self, k + 1)
        path = self.root / kind / self.scene / (self.files[frame_index(self, k)].stem + suffix)
        if not (self.root / "flow").is_dir():
            raise lacks(self.name, f"true flow (no folder {self.root / 'flow'})")
        if not path.is_file():
            raise DataError(f"{path}: no such file, but {self.name} needs it for frame {k}")
        return path
