"""Where TartanAir V1 and V2 keep the files of their left camera, and the conversions of their formats."""

from __future__ import annotations

import json
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform, Rotation

from flowlik.datasets._numbering import Numbered
from flowlik.datasets.flow_png import TARTANAIR_UNKNOWN
from flowlik.errors import DataError
from flowlik.geometry.camera import Pinhole
from flowlik.geometry.pose_table import camera_poses, ned_poses, read_pose_table
from flowlik.geometry.times import read_times
from flowlik.support.files import mapped_npy, read_table

FRAMES_PER_SECOND = 10.0

MOVER_LAYOUT = "9 numbers (frame, object, x y z qx qy qz qw)"


class Layout(NamedTuple):
    """Folders and the ends of file names of one version; frame NNNNNN is ``images/NNNNNN{ending}.png``."""

    images: str
    ending: str
    right: str
    right_ending: str
    depth: str
    depth_kind: str
    poses: str
    camera: Pinhole


LAYOUTS = (
    Layout(
        "image_lcam_front", "_lcam_front", "image_rcam_front", "_rcam_front", "depth_lcam_front", ".png",
        "pose_lcam_front.txt", Pinhole(640, 640, 320.0, 320.0, 320.0, 320.0),
    ),
    Layout(
        "image_left", "_left", "image_right", "_right", "depth_left", ".npy",
        "pose_left.txt", Pinhole(640, 480, 320.0, 320.0, 320.0, 240.0),
    ),
)  # fmt: skip
"""V2 and V1."""


def read_depth_npy(path: Path) -> NDArray[np.float64]:
    """Depth (H, W) [m] of a ``.npy`` file, as V1 has it.

    Raises
    ------
    DataError
        If the file is not a readable array (H, W) of floats.
    """
    depth = mapped_npy(path)
    if not isinstance(depth, np.ndarray) or depth.dtype.kind != "f" or depth.ndim != 2:
        raise DataError(f"{path}: depth must be an array (H, W) of floats [m]")
    return np.array(depth, dtype=np.float64)


def encode_depth(depth: NDArray[np.float64]) -> NDArray[np.uint8]:
    """Depth (H, W) [m] as little-endian float32 as a four-channel image (H, W, 4) for OpenCV."""
    return np.ascontiguousarray(depth, dtype="<f4").view(np.uint8).reshape(*depth.shape, 4)


def decode_depth(channels: NDArray[np.uint8], path: Path) -> NDArray[np.float64]:
    """Depth (H, W) [m] of a four-channel image; the path is named in errors.

    Raises
    ------
    DataError
        If the image is another.
    """
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


def read_poses(path: Path, frames: Numbered) -> RigidTransform | None:
    """Poses T_n_c (N,) of the frames, or None if there is no such file.

    Raises
    ------
    DataError
        If the file holds no poses, or not those of these frames.
    """
    if not path.is_file():
        return None
    poses = read_pose_table(path, columns=(7,)).poses
    return poses[frames.rows(len(poses), "poses", path)]


def read_movers(path: Path, frames: Numbered) -> list[RigidTransform] | None:
    """Poses T_n_o (M,) of all moving objects in each frame, or None if there is no such file.

    Raises
    ------
    DataError
        If the file does not hold all objects of all frames.
    """
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


def read_frame_times(path: Path, frames: Numbered, lenient: bool) -> NDArray[np.float64] | None:
    """Times (N,) [s] of the frames, or None if there is no such file.

    Raises
    ------
    DataError
        If the file holds no times, or not those of these frames.
    """
    if not path.is_file():
        return None
    times_s = read_times(path, increasing=not lenient)
    return times_s[frames.rows(len(times_s), "times", path)]


def read_camera(path: Path, own: Pinhole) -> tuple[Pinhole, float]:
    """Camera and frame rate [1/s] from a camera.json, or TartanAir's own if there is none.

    Raises
    ------
    DataError
        If the file is no such camera.
    """
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
