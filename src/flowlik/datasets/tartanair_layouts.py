"""Where TartanAir V1 and V2 keep the files of their left camera."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from flowlik.errors import DataError
from flowlik.geometry.camera import Pinhole


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
    try:
        # mapped, a header that promises more than the file holds is refused before memory is asked for
        depth = np.load(path, mmap_mode="r", allow_pickle=False)
    except Exception as error:  # NumPy's parser of headers raises a dozen kinds
        raise DataError(f"{path}: not a readable .npy file (truncated or of another kind)") from error
    if not isinstance(depth, np.ndarray) or depth.dtype.kind != "f" or depth.ndim != 2:
        raise DataError(f"{path}: depth must be an array (H, W) of floats [m]")
    return np.array(depth, dtype=np.float64)
