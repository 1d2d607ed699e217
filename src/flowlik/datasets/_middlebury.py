"""Middlebury: optical flow pairs, and stereo pairs whose disparity is a flow."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from flowlik.datasets._disparity import read_disparity
from flowlik.datasets._layouts import STEREO_FILES
from flowlik.datasets._pairs import ImagePair, ImagePairs, image_pair, scene_folders
from flowlik.errors import DataError
from flowlik.support.files import printable


class MiddleburyFlow(ImagePairs):
    """Pairs of the Middlebury flow data set (Baker et al. 2011), a `PairSequence`.

    A scene holds ``frame10.png``, ``frame11.png`` and ``flow10.flo``; in the original downloads the flow is
    in ``../../other-gt-flow/<scene>``. The truth is dense, from hidden fluorescent texture or a renderer.

    Parameters
    ----------
    folder : Path or str
        One scene, or a folder of scenes.

    Raises
    ------
    DataError
        If there is no ``frame10.png``, or one lacks its partner, or is there in another format too.
    """

    def __init__(self, folder: Path | str) -> None:
        folder = Path(folder)
        pairs = []
        for scene in scene_folders(folder, "frame10.png"):
            apart = scene.resolve().parent.parent / "other-gt-flow" / scene.resolve().name / "flow10.flo"
            truth = next((path for path in (scene / "flow10.flo", apart) if path.is_file()), None)
            pairs.append(image_pair(scene / "frame10.png", scene / "frame11.png", truth))
        super().__init__(f"middlebury-flow/{printable(folder.resolve().name)}", pairs)


class MiddleburyStereo(ImagePairs):
    """Pairs of the Middlebury stereo data set of 2014 (Scharstein et al.), a `PairSequence`.

    Left and right image of a rectified pair are its first and second frame. The truth is the flow (-d, 0) of
    the left disparity d, known to a fraction of a pixel, also where the right camera does not see the point.
    The original's ``im0.png``, ``im1.png``, ``disp0.pfm`` are read, and ``*_left.png``, ``*_right.png``,
    ``*_disp.npz``.

    Parameters
    ----------
    folder : Path or str
        One scene, or a folder of scenes.

    Raises
    ------
    DataError
        If there is no left image, or more than one in a scene, or one lacks its partner, or is there in
        another format too.
    """

    def __init__(self, folder: Path | str) -> None:
        folder = Path(folder)
        if not folder.is_dir():
            raise DataError(f"{folder}: no such folder")
        pairs = _stereo_pairs(folder) or [
            pair for scene in sorted(folder.iterdir()) if scene.is_dir() for pair in _stereo_pairs(scene)
        ]
        if not pairs:
            expected = " or ".join(f"{left} with {truth}" for left, _, truth in STEREO_FILES)
            raise DataError(
                f"{folder}: no stereo pair, neither here nor in its folders (expected {expected})"
            )
        super().__init__(f"middlebury-stereo/{printable(folder.resolve().name)}", pairs)

    def _read_truth(self, path: Path) -> NDArray[np.float64]:
        disparity = read_disparity(path)
        return np.stack([-disparity, np.where(np.isnan(disparity), np.nan, 0)], axis=-1)


def _stereo_pairs(folder: Path) -> list[ImagePair]:
    """The one pair of a scene, or none if there is no left image."""
    found = [(first, *names) for names in STEREO_FILES for first in sorted(folder.glob(names[0]))]
    if len(found) > 1:
        names = ", ".join(first.name for first, *_ in found)
        raise DataError(f"{folder}: {len(found)} left images ({names}), but a scene has one")
    pairs = []
    for first, left, right, disparity in found:
        scene = first.name.removesuffix(left.lstrip("*"))
        second, truth = (folder / (scene + name.lstrip("*")) for name in (right, disparity))
        pairs.append(image_pair(first, second, truth if truth.is_file() else None))
    return pairs
