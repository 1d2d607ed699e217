"""TartanAir V1 and V2: one camera of one trajectory, and the conversions of its file formats."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform, Rotation

from flowlik.datasets.base import (
    Movers,
    decode_image,
    frame_index,
    is_visible,
    lacks,
    motion_to_next,
    mover_motions,
    read_grey,
    true_flow,
    visibility_next,
)
from flowlik.datasets.flow_png import TARTANAIR_UNKNOWN
from flowlik.datasets.numbering import Numbered, numbered
from flowlik.datasets.tartanair_layouts import LAYOUTS, read_depth_npy
from flowlik.errors import DataError
from flowlik.geometry.camera import Pinhole
from flowlik.geometry.pose_table import camera_poses, ned_poses, read_pose_table
from flowlik.geometry.times import read_times
from flowlik.support.files import printable, read_table

FRAMES_PER_SECOND = 10.0

MOVER_LAYOUT = "9 numbers (frame, object, x y z qx qy qz qw)"

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
        self._camera, self.frames_per_second = _read_camera(self.folder / "camera.json", layout.camera)
        self._poses = _read_poses(self.folder / layout.poses, frames)
        self._movers = _read_movers(self.folder / "movers.txt", frames)
        self._times_s = _read_times(self.folder / "times.txt", frames, lenient)
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
        depth = _decode_depth(decode_image(path, cv2.IMREAD_UNCHANGED), path)
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

    def visibility(self, k: int) -> NDArray[np.uint8]:
        """Return what becomes of each pixel (H, W) in frame k + 1, a `flowlik.datasets.base.Visibility`.

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


def encode_depth(depth: NDArray[np.float64]) -> NDArray[np.uint8]:
    """Depth (H, W) [m] as little-endian float32 as a four-channel image (H, W, 4) for OpenCV."""
    return np.ascontiguousarray(depth, dtype="<f4").view(np.uint8).reshape(*depth.shape, 4)


def _decode_depth(channels: NDArray[np.uint8], path: Path) -> NDArray[np.float64]:
    """Depth (H, W) [m] of a four-channel image; the path is named in errors."""
    if channels.dtype != np.uint8 or channels.ndim != 3 or channels.shape[2] != 4:
        raise DataError(f"{path}: depth must be an 8-bit PNG of 4 channels, this one is {channels.shape}")
    return np.ascontiguousarray(channels).view("<f4")[..., 0].astype(np.float64)


def encode_flow(flow: NDArray[np.float64], visible: NDArray[np.bool_], camera: Pinhole) -> NDArray[np.uint16]:
    """Three-channel image (H, W, 3), in OpenCV's order: u and v as 64 * flow + 32768, and a mask.

    The mask is 0 where the pixel is seen again, 1 where occluded, 100 where its end lies outside the image,
    200 where there is no flow or none that the format holds.
    """
    levels = np.rint(64 * np.nan_to_num(flow, nan=0.0, posinf=1e6, neginf=-1e6) + 32768)
    held = np.isfinite(flow).all(axis=-1) & (np.abs(levels - 32768) < 32768).all(axis=-1)
    inside = held & camera.contains(camera.pixel_grid().reshape(flow.shape) + flow)
    mask = np.select([~held, visible, inside], [TARTANAIR_UNKNOWN, 0, 1], 100)
    return np.dstack([np.clip(levels, 0, 65535), mask]).astype(np.uint16)


def encode_poses(poses: RigidTransform) -> NDArray[np.float64]:
    """Rows (N, 7) x y z qx qy qz qw in NED axes of poses T_n_c whose axes are x right, y down, z forward."""
    ned = ned_poses(poses)
    return np.column_stack([ned.translation, ned.rotation.as_quat()])


def decode_poses(rows: NDArray[np.float64]) -> RigidTransform:
    """Poses T_n_c, axes x right, y down, z forward, of rows (N, 7) x y z qx qy qz qw in NED axes."""
    return camera_poses(RigidTransform.from_components(rows[:, :3], Rotation.from_quat(rows[:, 3:])))


def _read_poses(path: Path, frames: Numbered) -> RigidTransform | None:
    if not path.is_file():
        return None
    poses = read_pose_table(path, columns=(7,)).poses
    return poses[frames.rows(len(poses), "poses", path)]


def _read_movers(path: Path, frames: Numbered) -> list[RigidTransform] | None:
    """Poses T_n_o (M,) of all moving objects in each frame, or None if there is no such file."""
    if not path.is_file():
        return None
    rows, _ = read_table(path, 9, MOVER_LAYOUT)
    most = int(max(rows[-1, 0], frames.numbers[-1])) + 1
    count = len(rows) // most
    wanted = [(k, m) for k in range(most if count else 0) for m in range(count)]
    if not (wanted and np.array_equal(rows[:, :2], wanted)):
        raise DataError(f"{path}: must hold every object of every one of {most} frames, in order")
    if (np.abs(np.linalg.norm(rows[:, 5:], axis=1) - 1) > 0.5).any():
        raise DataError(f"{path}: every row must hold a unit quaternion qx qy qz qw")
    return [decode_poses(rows[k * count : (k + 1) * count, 2:]) for k in frames.numbers]


def _read_times(path: Path, frames: Numbered, lenient: bool) -> NDArray[np.float64] | None:
    """Times (N,) [s], or None if there is no such file."""
    if not path.is_file():
        return None
    times_s = read_times(path, increasing=not lenient)
    return times_s[frames.rows(len(times_s), "times", path)]


def _read_camera(path: Path, own: Pinhole) -> tuple[Pinhole, float]:
    """Camera and frame rate [1/s] from a camera.json, or TartanAir's own if there is none."""
    if not path.is_file():
        return own, FRAMES_PER_SECOND
    try:
        values = json.loads(path.read_text())
        names = ("fx", "fy", "cx", "cy")
        camera = Pinhole(
            int(values["width"]), int(values["height"]), *(float(values[name]) for name in names)
        )
        return camera, float(values["frames_per_second"])
    except (ValueError, TypeError, KeyError) as error:
        needed = "width, height, fx, fy, cx, cy and frames_per_second"
        raise DataError(f"{path}: must be a JSON object with {needed} ({error!r})") from error


def _of_size(values: NDArray[_T], camera: Pinhole, path: Path) -> NDArray[_T]:
    if values.shape != (camera.height, camera.width):
        size = f"{values.shape[1]}x{values.shape[0]}"
        raise DataError(f"{path}: image is {size}, the camera is {camera.width}x{camera.height}")
    return values
