"""Camera files of ROS, OpenCV, Kalibr, ORB-SLAM, Basalt, COLMAP, KITTI and nerfstudio, read as a lens."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path

from flowlik.datasets._camera_content import parse_mappings
from flowlik.datasets._camera_formats import KNOWN, Cameras, cameras_in
from flowlik.datasets._camera_text import text_cameras
from flowlik.datasets._lens import Lens
from flowlik.errors import DataError
from flowlik.support.files import read_text

MAX_BYTES = 2**25
"""transforms.json holds a pose a frame."""


def read_camera(path: Path | str, name: str | None = None) -> Lens:
    """Read a camera file: intrinsics, distortion and, where the file has it, the image size.

    Whose file it is shows by what stands in it, not by its name; docs/file-formats.md lists what is read of
    each. Rectification and projection matrices are not used where there is a camera matrix: images are
    undistorted, not rectified. COLMAP and transforms.json put the pixels' origin at a corner: principal
    points are moved by half a pixel.

    Parameters
    ----------
    path : Path or str
        The file.
    name : str, optional
        Which camera, of a file with several: ``cam1`` (Kalibr, Basalt), ``P2`` (KITTI), ``Camera2`` or
        ``LEFT`` (ORB-SLAM), a number (COLMAP). Without it ``cam0`` or ``Camera1`` where the file has them,
        else all cameras must be the same.

    Raises
    ------
    DataError
        If the file is missing or malformed, has no camera of the name or several that differ, or says
        anything of its camera that is not known.
    """
    path = Path(path)
    if path.is_file() and path.stat().st_size > MAX_BYTES:
        raise DataError(f"{path}: larger than a camera file can be")
    text = read_text(path)
    try:
        return replace(_only(text_cameras(text) or _of_mappings(text), name), source=str(path))
    except DataError as error:
        raise DataError(f"{path}: {error}") from error


def _of_mappings(text: str) -> Cameras:
    try:
        documents = parse_mappings(text)
    except DataError as error:
        raise DataError(f"{error}, expected a camera file: {KNOWN}") from error
    if len(documents) == 1:
        return cameras_in(documents[0])
    messages = enumerate(documents, start=1)
    return Cameras({f"message {i}": partial(_only, cameras_in(message), None) for i, message in messages})


def _only(cameras: Cameras, name: str | None) -> Lens:
    names = ", ".join(sorted(cameras.read))
    chosen = name or cameras.default
    if chosen is not None:
        if chosen not in cameras.read:
            raise DataError(f"no camera {chosen}, there are {names}")
        return cameras.read[chosen]()
    lenses = [read() for read in cameras.read.values()]
    if any(lens != lenses[0] for lens in lenses):
        raise DataError(f"holds several cameras, choose one as FILE:NAME of {names}")
    return lenses[0]
