"""Write a simulated sequence to disk in TartanAir V2's layout."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform

from flowlik.datasets.tartanair import encode_depth, encode_flow, encode_poses
from flowlik.errors import DataError
from flowlik.simulation.flight._sequence import SimulatedSequence
from flowlik.support.files import atomic_write

MOST_MOVERS = 255


def write_sequence(
    sequence: SimulatedSequence,
    folder: Path | str,
    progress: Callable[[Iterable[int]], Iterable[int]] = iter,
) -> Path:
    """Write images, depth, flow, poses and camera; `flowlik.datasets.tartanair.TartanAir` reads them.

    The files are those of TartanAir V2 (left front camera, and the right one's images if there is one).
    Beside them stand ``camera.json`` with size, intrinsics, frame rate and provenance, ``times.txt`` with the
    time of each frame, and, where objects move, ``seg_lcam_front`` (0 static, m + 1 object m) and
    ``movers.txt`` (frame, object, x y z qx qy qz qw in NED axes). Each file is written under another name
    and then renamed. An interrupted writing of the same sequence is continued: files already there are kept.

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
        If the folder is a file or holds anything else, or cannot be written, as when the disk is full;
        nothing half-written is left.
    """
    folder = Path(folder)
    description = _description(sequence)
    movers = _mover_table(sequence)
    _check_free(folder, description)
    try:
        _sweep(folder)
        _write(folder / "camera.json", description.encode())
        times = "".join(f"{time_s!r}\n" for time_s in sequence.times_s.tolist())
        _write(folder / "times.txt", times.encode())
        _write(folder / "pose_lcam_front.txt", _pose_table(sequence.poses).encode())
        if sequence.baseline_m is not None:
            _write(folder / "pose_rcam_front.txt", _pose_table(sequence.right_poses).encode())
        if movers is not None:
            _write(folder / "movers.txt", movers.encode())
        _write_frames(sequence, folder, progress)
    except OSError as error:
        raise DataError(f"{folder}: cannot write the sequence ({error.strerror or error})") from error
    return folder


def _write_frames(
    sequence: SimulatedSequence, folder: Path, progress: Callable[[Iterable[int]], Iterable[int]]
) -> None:
    # one frame is packed and written while the next one is rendered
    with ThreadPoolExecutor(1, thread_name_prefix="flowlik-write") as writer:
        before: list[Future[None]] = []
        for k in progress(range(len(sequence))):
            now = [writer.submit(_write_png, path, pixels()) for path, pixels in _files(sequence, k, folder)]
            _finish(before)
            before = now
        _finish(before)


def _files(
    sequence: SimulatedSequence, k: int, folder: Path
) -> Iterator[tuple[Path, Callable[[], NDArray[np.integer]]]]:
    """Image files of frame k that are not there yet, each with a function that makes its pixels."""

    def flow() -> NDArray[np.uint16]:
        return encode_flow(sequence.flow(k), sequence.visible(k), sequence.camera)

    def labels() -> NDArray[np.uint8]:
        frame = sequence.frame(k)
        movers = np.full(frame.depth.shape, -1) if frame.movers is None else frame.movers
        return (movers + 1).astype(np.uint8)

    wanted: dict[str, Callable[[], NDArray[np.integer]]] = {
        f"image_lcam_front/{k:06d}_lcam_front.png": lambda: _colour(sequence.image(k)),
        f"depth_lcam_front/{k:06d}_lcam_front_depth.png": lambda: encode_depth(sequence.depth(k)),
    }
    if k + 1 < len(sequence):
        wanted[f"flow_lcam_front/{k:06d}_{k + 1:06d}_flow.png"] = flow
    if sequence.mover_poses(k) is not None:
        wanted[f"seg_lcam_front/{k:06d}_lcam_front_seg.png"] = labels
    if sequence.baseline_m is not None:
        wanted[f"image_rcam_front/{k:06d}_rcam_front.png"] = lambda: _colour(sequence.right_image(k))
    return ((folder / name, pixels) for name, pixels in wanted.items() if not (folder / name).exists())


def _finish(writings: list[Future[None]]) -> None:
    for writing in writings:
        writing.result()


def _colour(image: NDArray[np.uint8]) -> NDArray[np.uint8]:
    # three equal channels, since TartanAir's readers expect colour
    return np.asarray(cv2.cvtColor(image, cv2.COLOR_GRAY2BGR), dtype=np.uint8)


def _description(sequence: SimulatedSequence) -> str:
    values = {
        **vars(sequence.camera),
        "frames_per_second": sequence.frames_per_second,
        "baseline_m": sequence.baseline_m,
        "provenance": sequence.provenance,
    }
    return json.dumps(values, indent=2) + "\n"


def _pose_table(poses: RigidTransform) -> str:
    return "".join(" ".join(f"{x:.18e}" for x in row) + "\n" for row in encode_poses(poses))


def _mover_table(sequence: SimulatedSequence) -> str | None:
    """Rows frame, object, x y z qx qy qz qw (NED) of all moving objects; None if nothing moves."""
    lines = []
    for k in range(len(sequence)):
        poses = sequence.mover_poses(k)
        if poses is None:
            return None
        if len(poses) > MOST_MOVERS:
            raise DataError(f"{sequence.name}: {len(poses)} moving objects, the format holds {MOST_MOVERS}")
        lines += [f"{k} {m} {row}" for m, row in enumerate(_pose_table(poses).splitlines(keepends=True))]
    return "".join(lines)


def _check_free(folder: Path, description: str) -> None:
    """Allow a new or empty folder, or one begun for the same sequence."""
    if folder.exists() and not folder.is_dir():
        raise DataError(f"{folder}: is a file, a new or empty folder is needed")
    if not folder.exists() or not any(_is_whole(path) for path in folder.iterdir()):
        return
    begun = folder / "camera.json"
    if not begun.is_file() or begun.read_text() != description:
        raise DataError(f"{folder}: already holds something else, choose a new or empty folder")


def _sweep(folder: Path) -> None:
    """Remove what a killed run was writing at its end."""
    for path in [path for path in folder.rglob(".*") if not _is_whole(path)]:
        path.unlink()


def _is_whole(path: Path) -> bool:
    """Whether a file is not one that `atomic_write` had begun."""
    return not (path.name.startswith(".") and path.suffix == ".part")


def _write_png(path: Path, pixels: NDArray[np.integer]) -> None:
    # a low compression level is several times faster and costs little on noisy images
    _write(path, cv2.imencode(".png", pixels, [cv2.IMWRITE_PNG_COMPRESSION, 1])[1].tobytes())


def _write(path: Path, content: bytes) -> None:
    with atomic_write(path, "wb") as file:
        file.write(content)
