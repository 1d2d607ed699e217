"""Sets of pictures, and what is known of their depth and flow: real ones, renders of others, and ours."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform

from flowlik.datasets import open_sequence, read_grey
from flowlik.datasets.base import ImageSequence
from flowlik.datasets.flow_files import read_flow
from flowlik.datasets.next_frame import true_flow
from flowlik.geometry.camera import Pinhole
from flowlik.geometry.motion import relative_motion

REAL, RENDERED, OURS = "photographs", "renders of others", "ours"


@dataclass(frozen=True)
class Picture:
    """One picture; depth (H, W) [m] is NaN where unknown, flow [px] is the lengths (N,) that are known."""

    image: NDArray[np.uint8]
    depth: NDArray[np.float64] | None = None
    flow_px: NDArray[np.float64] | None = None


@dataclass(frozen=True)
class PictureSet:
    """Pictures of one kind, made when asked for; `flow` says where their flow comes from."""

    name: str
    kind: str
    flow: str
    pictures: Callable[[], Iterator[Picture]]


def lengths(flow: NDArray[np.float64]) -> NDArray[np.float64]:
    """Lengths (N,) [px] of the known vectors of a flow (H, W, 2)."""
    length = np.linalg.norm(flow, axis=-1)
    return length[np.isfinite(length)]


def simulated(name: str, sequence: Callable[[], ImageSequence], count: int) -> PictureSet:
    """Evenly spread frames of a simulated flight, with the true flow to the next frame."""

    def pictures() -> Iterator[Picture]:
        flight = sequence()
        for k in np.linspace(0, len(flight) - 2, count).astype(int):
            depth = flight.depth(k)
            # as in the truth of real sets, the sky has no flow
            flow = np.where(np.isfinite(depth)[..., None], flight.flow(k), np.nan)
            yield Picture(flight.image(k), depth, lengths(flow))

    return PictureSet(name, OURS, "truth", pictures)


def real_sets(data: Path, count: int) -> list[PictureSet]:
    """Return the sets that are there; what is missing is said on standard output."""
    flow = data / "flow"
    sintel = flow / "sintel" / "training"
    sets = [
        *(_kitti(data / "kitti_odometry" / number, count) for number in ("00", "01", "03")),
        _pair("KITTI 2012", REAL, flow / "kitti2012/training/image_0/000045_10.png",
              flow / "kitti2012/training/flow_noc/000045_10.png"),
        _pair("Middlebury", REAL, flow / "middlebury/RubberWhale/frame10.png",
              flow / "middlebury/RubberWhale/flow10.flo"),
        (data / "stereo/motorcycle", PictureSet("Motorcycle", REAL, "disparity", lambda: _stereo(data))),
        (data / "sevenscenes", PictureSet("7-Scenes", REAL, "depth and pose", lambda: _sevenscenes(data))),
        _sintel("Sintel clean", sintel, (("clean", "alley_1"), ("clean", "alley_2"))),
        _sintel("Sintel final", sintel, (("final", "alley_1"), ("final", "cave_2"))),
        (data / "tartanair_v2/abs_P000",
         PictureSet("TartanAir V2", RENDERED, "truth", lambda: _tartanair(data / "tartanair_v2/abs_P000"))),
    ]  # fmt: skip
    for path, pictures in sets:
        if not path.exists():
            print(f"skipped {pictures.name}: {path} is not there")
    return [pictures for path, pictures in sets if path.exists()]


def _kitti(folder: Path, count: int) -> tuple[Path, PictureSet]:
    def pictures() -> Iterator[Picture]:
        sequence = open_sequence(folder, "kitti")
        dis = cv2.DISOpticalFlow_create(cv2.DISOPTICAL_FLOW_PRESET_MEDIUM)
        for k in np.unique(np.linspace(0, len(sequence) - 2, count).astype(int)):
            image = sequence.image(k)
            yield Picture(image, None, lengths(dis.calc(image, sequence.image(k + 1), None).astype(float)))

    return folder, PictureSet(f"KITTI {folder.name}", REAL, "measured by DIS", pictures)


def _pair(name: str, kind: str, image: Path, flow: Path) -> tuple[Path, PictureSet]:
    def pictures() -> Iterator[Picture]:
        yield Picture(read_grey(image), None, lengths(read_flow(flow)))

    return image, PictureSet(name, kind, "truth", pictures)


def _sintel(name: str, folder: Path, clips: tuple[tuple[str, str], ...]) -> tuple[Path, PictureSet]:
    def pictures() -> Iterator[Picture]:
        for look, clip in clips:
            flow = read_flow(folder / "flow" / clip / "frame_0002.flo")
            yield Picture(read_grey(folder / look / clip / "frame_0002.png"), None, lengths(flow))

    return folder, PictureSet(name, RENDERED, "truth", pictures)


def _stereo(data: Path) -> Iterator[Picture]:
    folder = data / "stereo/motorcycle"
    with np.load(folder / "motorcycle_disp.npz") as file:
        disparity = file["arr_0"].astype(np.float64)
    disparity[~np.isfinite(disparity)] = np.nan
    # only ratios of depth are asked for
    yield Picture(read_grey(folder / "motorcycle_left.png"), 1 / disparity, lengths(disparity[..., None]))


def _sevenscenes(data: Path) -> Iterator[Picture]:
    folder, camera = data / "sevenscenes", Pinhole(640, 480, 585.0, 585.0, 320.0, 240.0)

    def pose(k: int) -> RigidTransform:
        return RigidTransform.from_matrix(np.loadtxt(folder / f"frame-{k:06d}.pose.txt"))

    for k in range(300, 329, 4):
        raw = cv2.imread(str(folder / f"frame-{k:06d}.depth.png"), cv2.IMREAD_UNCHANGED)
        depth = np.where((raw == 0) | (raw == 65535), np.nan, raw / 1000.0)
        flow = true_flow(camera, depth, relative_motion(pose(k), pose(k + 1)))
        yield Picture(read_grey(folder / f"frame-{k:06d}.color.jpg"), depth, lengths(flow))


def _tartanair(folder: Path) -> Iterator[Picture]:
    sequence = open_sequence(folder, "tartanair")
    for k in range(5):
        yield Picture(sequence.image(k), sequence.depth(k), lengths(sequence.flow(k)))
