"""Write a simulated sequence to disk in TartanAir V2's layout."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable
from pathlib import Path

import cv2
from numpy.typing import NDArray

from flowlik.datasets.tartanair import encode_depth, encode_flow, encode_poses
from flowlik.errors import DataError
from flowlik.files import atomic_write
from flowlik.simulation.sequence import SimulatedSequence


def write_sequence(
    sequence: SimulatedSequence,
    folder: Path | str,
    progress: Callable[[Iterable[int]], Iterable[int]] = iter,
) -> Path:
    """Write images, depth, flow, poses and camera; `flowlik.datasets.tartanair.TartanAir` reads them.

    The files are those of TartanAir V2 (left front camera) plus ``camera.json`` with size, intrinsics, frame
    rate and provenance. Each file is written under another name and then renamed. An interrupted writing of
    the same sequence is continued: files already there are kept.

    Parameters
    ----------
    sequence : SimulatedSequence
        What to write.
    folder : Path or str
        New, empty, or begun by the same call.
    progress : callable
        Wraps the iterable of frame numbers, e.g. ``rich.progress.track``.

    Returns
    -------
    Path
        The folder.

    Raises
    ------
    DataError
        If the folder holds anything else, or a file cannot be written.
    """
    folder = Path(folder)
    description = _description(sequence)
    _check_free(folder, description)
    try:
        for kind in ("image", "depth", "flow"):
            (folder / f"{kind}_lcam_front").mkdir(parents=True, exist_ok=True)
        _write(folder / "camera.json", description.encode())
        _write(folder / "pose_lcam_front.txt", _pose_table(sequence).encode())
        for k in progress(range(len(sequence))):
            _write_frame(sequence, k, folder)
    except OSError as error:
        raise DataError(f"{folder}: cannot write the sequence ({error})") from error
    return folder


def _write_frame(sequence: SimulatedSequence, k: int, folder: Path) -> None:
    image = folder / "image_lcam_front" / f"{k:06d}_lcam_front.png"
    depth = folder / "depth_lcam_front" / f"{k:06d}_lcam_front_depth.png"
    flow = folder / "flow_lcam_front" / f"{k:06d}_{k + 1:06d}_flow.png"
    if not image.exists():
        # three equal channels, since TartanAir's readers expect colour
        _write(image, _png(cv2.cvtColor(sequence.image(k), cv2.COLOR_GRAY2BGR)))
    if not depth.exists():
        _write(depth, _png(encode_depth(sequence.depth(k))))
    if k + 1 < len(sequence) and not flow.exists():
        _write(flow, _png(encode_flow(sequence.flow(k), sequence.visible(k), sequence.camera)))


def _description(sequence: SimulatedSequence) -> str:
    values = {
        **vars(sequence.camera),
        "frames_per_second": sequence.frames_per_second,
        "provenance": sequence.provenance,
    }
    return json.dumps(values, indent=2) + "\n"


def _pose_table(sequence: SimulatedSequence) -> str:
    return "".join(" ".join(f"{x:.18e}" for x in row) + "\n" for row in encode_poses(sequence.poses))


def _check_free(folder: Path, description: str) -> None:
    """Allow a new or empty folder, or one begun for the same sequence."""
    if folder.exists() and not folder.is_dir():
        raise DataError(f"{folder}: is a file, a new or empty folder is needed")
    if not folder.exists() or not any(folder.iterdir()):
        return
    begun = folder / "camera.json"
    if not begun.is_file() or begun.read_text() != description:
        raise DataError(f"{folder}: already holds something else, choose a new or empty folder")


def _png(image: NDArray) -> bytes:
    # a low compression level is several times faster and costs little on noisy images
    return cv2.imencode(".png", image, [cv2.IMWRITE_PNG_COMPRESSION, 1])[1].tobytes()


def _write(path: Path, content: bytes) -> None:
    with atomic_write(path, "wb") as file:
        file.write(content)
