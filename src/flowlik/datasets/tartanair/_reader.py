"""The left camera of one trajectory of TartanAir V1 or V2."""

from __future__ import annotations

from pathlib import Path
from typing import TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform

from flowlik.datasets._images import decode_image, read_grey
from flowlik.datasets._numbering import numbered
from flowlik.datasets.base import frame_index, lacks
from flowlik.datasets.next_frame import (
    Movers,
    is_visible,
    motion_to_next,
    mover_motions,
    true_flow,
    visibility_next,
)
from flowlik.datasets.tartanair._files import (
    LAYOUTS,
    decode_depth,
    read_camera,
    read_depth_npy,
    read_frame_times,
    read_movers,
    read_poses,
)
from flowlik.errors import DataError
from flowlik.geometry.camera import Pinhole
from flowlik.support.files import printable

_T = TypeVar("_T", bound=np.generic)


class TartanAir:
    """The left camera of one trajectory; implements `flowlik.datasets.base.ImageSequence`.

    The folder holds ``image_lcam_front`` and, where it has them, ``depth_lcam_front``, ``image_rcam_front``
    and ``pose_lcam_front.txt`` (V2), or ``image_left``, ``depth_left``, ``image_right`` and ``pose_left.txt``
    (V1). The number in an image's name says which depth, right image, and rows of the poses (row k is frame
    k, or the first row the first image), of ``times.txt`` and of ``movers.txt`` are its own. The camera comes
    from ``camera.json`` if there is one, else it is TartanAir's own; times come from ``times.txt`` if there
    is one, else they are number / frame rate. World axes are x right, y down, z forward. True flow is
    computed from depth and poses in float64, not read from the flow images, which are rounded to 1/64 px;
    where ``movers.txt`` and ``seg_lcam_front`` say what moves (see `flowlik.simulation.write_sequence`) it
    follows them.

    Parameters
    ----------
    folder : Path or str
        One trajectory, e.g. ``abandonedfactory/Data_easy/P000``.
    lenient : bool
        Images may be missing between others, and times go back: what cannot be used is told when it is read.

    Raises
    ------
    DataError
        If folder, images or camera file are missing or invalid, images are not numbered without gaps, or
        poses, times or movers are malformed or not those of these frames.
    """

    def __init__(self, folder: Path | str, lenient: bool = False) -> None:
        self.folder = Path(folder)
        self.name = printable(self.folder.resolve().name)
        if not self.folder.is_dir():
            raise DataError(f"{self.folder}: no such folder")
        there = [layout for layout in LAYOUTS if (self.folder / layout.images).is_dir()]
        self._layout = layout = there[0] if there else LAYOUTS[0]
        files = list((self.folder / layout.images).glob(f"*{layout.ending}.png"))
        if not files:
            raise DataError(
                f"{self.folder}: no images {layout.images}/*{layout.ending}.png, not a TartanAir folder"
            )
        shape = f"NNNNNN{layout.ending}.png"
        frames = numbered(files, rf"([0-9]+){layout.ending}\.png", shape, lenient)
        self._images, self._numbers = frames.files, frames.numbers
        self._camera, self.frames_per_second = read_camera(self.folder / "camera.json", layout.camera)
        self._poses = read_poses(self.folder / layout.poses, frames)
        self._movers = read_movers(self.folder / "movers.txt", frames)
        self._times_s = read_frame_times(self.folder / "times.txt", frames, lenient)
        rate = f"frame/{self.frames_per_second:g}s"
        self.times_source = rate if self._times_s is None else "times.txt"

    @property
    def camera(self) -> Pinhole:
        """The camera of every frame."""
        return self._camera

    def __len__(self) -> int:
        """Return the number of images."""
        return len(self._images)

    def image(self, k: int) -> NDArray[np.uint8]:
        """Return the grey image (H, W) of frame k.

        Raises
        ------
        DataError
            If there is no such frame, or its file is unreadable or of another size than the camera.
        """
        path = self._images[frame_index(self, k)]
        return _of_size(read_grey(path), self.camera, path)

    def right_image(self, k: int) -> NDArray[np.uint8]:
        """Return the grey image (H, W) of the right front camera, level with the left one.

        Raises
        ------
        MissingFieldError
            If its file is not there.
        DataError
            If there is no such frame, or its file is unreadable or of another size than the camera.
        """
        path = self._beside(k, self._layout.right, f"{self._layout.right_ending}.png")
        if not path.is_file():
            raise lacks(self.name, f"right image for frame {k} ({path.name})")
        return _of_size(read_grey(path), self.camera, path)

    def timestamp(self, k: int) -> float:
        """Return the time [s] of frame k.

        Raises
        ------
        DataError
            If there is no such frame.
        """
        k = frame_index(self, k)
        return float(self._numbers[k] / self.frames_per_second if self._times_s is None else self._times_s[k])

    def T_n_c(self, k: int) -> RigidTransform:
        """Return the true pose of frame k: takes points in {c} to points in {n} [m].

        Raises
        ------
        MissingFieldError
            If there are no poses.
        DataError
            If there is no such frame.
        """
        if self._poses is None:
            raise lacks(self.name, f"poses ({self._layout.poses})")
        return self._poses[frame_index(self, k)]

    def depth(self, k: int) -> NDArray[np.float64]:
        """Return the true depth (H, W) [m] along z at pixel centres, of float32 precision.

        Raises
        ------
        MissingFieldError
            If its file is not there.
        DataError
            If there is no such frame, or its file is damaged or of another size than the camera.
        """
        kind = self._layout.depth_kind
        path = self._beside(k, self._layout.depth, f"{self._layout.ending}_depth{kind}")
        if not path.is_file():
            raise lacks(self.name, f"depth for frame {k} ({path.name})")
        if kind == ".npy":
            return _of_size(read_depth_npy(path), self.camera, path)
        depth = decode_depth(decode_image(path, cv2.IMREAD_UNCHANGED), path)
        return _of_size(depth, self.camera, path)

    def flow(self, k: int) -> NDArray[np.float64]:
        """Return the true flow (H, W, 2) [px] from frame k to k + 1; occluded pixels keep theirs.

        Raises
        ------
        MissingFieldError
            If there is no depth or no pose.
        DataError
            If there is no such frame or none after it, or a file is damaged.
        """
        return true_flow(self.camera, self.depth(k), motion_to_next(self, k), self._moving(k))

    @property
    def has_movers(self) -> bool:
        """Whether something moves besides the camera, so that depth and poses do not tell all flow."""
        return self._movers is not None

    def visibility(self, k: int) -> NDArray[np.uint8]:
        """Return what becomes of each pixel (H, W) in frame k + 1, a `Visibility`.

        Needs the depth of both frames.

        Raises
        ------
        MissingFieldError
            If there is no depth or no pose.
        DataError
            If there is no such frame or none after it, or a file is damaged.
        """
        motion, movers = motion_to_next(self, k), self._moving(k)
        return visibility_next(self.camera, self.depth(k), self.depth(k + 1), motion, movers)

    def visible(self, k: int) -> NDArray[np.bool_]:
        """Return which pixels (H, W) of frame k are seen in frame k + 1 too; needs the depth of both."""
        return is_visible(self.visibility(k))

    def _moving(self, k: int) -> Movers | None:
        """Objects that move from frame k to k + 1."""
        if self._movers is None:
            return None
        here, there = self._movers[k], self._movers[k + 1]
        path = self._beside(k, "seg_lcam_front", f"{self._layout.ending}_seg.png")
        labels = _of_size(decode_image(path, cv2.IMREAD_UNCHANGED), self.camera, path).astype(np.int16) - 1
        if labels.max() >= len(here):
            raise DataError(f"{path}: shows object {labels.max()}, movers.txt has {len(here)}")
        return Movers(labels, mover_motions(self.T_n_c(k), self.T_n_c(k + 1), here, there))

    def _beside(self, k: int, folder: str, ending: str) -> Path:
        """File of frame k in another folder."""
        name = self._images[frame_index(self, k)].name
        return self.folder / folder / (name.removesuffix(f"{self._layout.ending}.png") + ending)


def _of_size(values: NDArray[_T], camera: Pinhole, path: Path) -> NDArray[_T]:
    if values.shape != (camera.height, camera.width):
        size = f"{values.shape[1]}x{values.shape[0]}"
        raise DataError(f"{path}: image is {size}, the camera is {camera.width}x{camera.height}")
    return values
