"""Contact sheets: places of every world as image, depth and flow."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from flowlik.report._hue import flow_scale, hue_colours
from flowlik.simulation import SimulatedSequence, simulate

Picture = NDArray[np.uint8]

NEAREST_M, FARTHEST_M = 1.0, 200.0
GAP_PX = 6
JPEG_QUALITY = 84
_FONT = cv2.FONT_HERSHEY_SIMPLEX, 0.5


@dataclass(frozen=True)
class Flight:
    """What `simulate` is asked for."""

    world: str
    trajectory: str | Path
    frames: int | None = None
    traffic: int = 0


@lru_cache(maxsize=1)
def fly(flight: Flight) -> SimulatedSequence:
    """Simulate; places of one flight follow one another, so that it is opened once."""
    return simulate(flight.world, flight.trajectory, flight.frames, traffic=flight.traffic)


Places = list[tuple[Flight, tuple[int, ...]]]


def sheets(kitti_poses: Path | None) -> dict[str, tuple[int, Places]]:
    """Columns, flights and frames of the sheet of each world; `driving` needs the folder of KITTI's poses."""
    found: dict[str, tuple[int, Places]] = {
        "planes": (2, [(Flight("planes", "training", 1500), (40, 700))]),
        "grid": (2, [(Flight("grid", "straight", 1000), (100, 600))]),
        "forest": (
            2,
            [
                (Flight("forest", "straight", 1020), (50, 600)),
                (Flight("forest", "forest-fig8", 1981), (250, 900, 1500)),
                (Flight("forest", "training", 1500), (700,)),
            ],
        ),
    }
    if kitti_poses is not None:
        street, motorway = kitti_poses / "00.txt", kitti_poses / "01.txt"
        found["driving"] = (
            1,
            [
                (Flight("driving", street), (60, 1500, 3300)),
                (Flight("driving", street, traffic=12), (505,)),
                (Flight("driving", motorway), (600,)),
                (Flight("driving", motorway, traffic=12), (50,)),
            ],
        )
    return found


def contact_sheet(columns: int, places: Places) -> Picture:
    """Picture (H, W, 3) in OpenCV's order of all places, in as many columns."""
    cells = [cell(fly(flight), k, _label(flight, k)) for flight, frames in places for k in frames]
    return below([beside(cells[i : i + columns]) for i in range(0, len(cells), columns)])


def _label(flight: Flight, k: int) -> str:
    along = flight.trajectory if isinstance(flight.trajectory, str) else f"KITTI {flight.trajectory.stem}"
    return f"{flight.world}{' with traffic' if flight.traffic else ''}: {along}, frame {k}"


def cell(sequence: SimulatedSequence, k: int, label: str) -> Picture:
    """One place: the image, and at half its size depth and flow, to the right of it or, if wide, below."""
    image = cv2.cvtColor(sequence.image(k), cv2.COLOR_GRAY2BGR)
    (width, height), _ = cv2.getTextSize(label, *_FONT, 1)
    cv2.rectangle(image, (0, 0), (width + 12, height + 12), (0, 0, 0), -1)
    cv2.putText(image, label, (6, height + 6), *_FONT, (255, 255, 255), 1, cv2.LINE_AA)
    flow = sequence.flow(k)
    rgb = hue_colours(flow, flow_scale(flow))
    coloured = np.rint(255 * rgb[..., ::-1]).astype(np.uint8)
    halves = [half(depth_colours(sequence.depth(k))), half(coloured)]
    wide = image.shape[1] > 3 * image.shape[0]
    return below([image, beside(halves, 0)], 0) if wide else beside([image, below(halves, 0)], 0)


def depth_colours(depth: NDArray[np.float64]) -> Picture:
    """Logarithm of depth from 1 (bright) to 200 m (dark) as colours (H, W, 3); the sky is white."""
    far = np.log(np.clip(depth, NEAREST_M, FARTHEST_M) / NEAREST_M) / np.log(FARTHEST_M / NEAREST_M)
    colours = cv2.applyColorMap(np.rint(255 * (1 - far)).astype(np.uint8), cv2.COLORMAP_INFERNO)
    colours[np.isinf(depth)] = 255
    return colours


def half(picture: Picture) -> Picture:
    """Picture of half the size, odd sizes rounded up; not interpolated, so that edges stay edges."""
    return picture[::2, ::2]


def beside(pictures: list[Picture], gap_px: int = GAP_PX) -> Picture:
    """Pictures side by side on white."""
    height = max(p.shape[0] for p in pictures)
    padded = [_padded(p, height, p.shape[1] + (gap_px if p is not pictures[-1] else 0)) for p in pictures]
    return np.hstack(padded)


def below(pictures: list[Picture], gap_px: int = GAP_PX) -> Picture:
    """Pictures one below the other on white."""
    width = max(p.shape[1] for p in pictures)
    padded = [_padded(p, p.shape[0] + (gap_px if p is not pictures[-1] else 0), width) for p in pictures]
    return np.vstack(padded)


def _padded(picture: Picture, height: int, width: int) -> Picture:
    room = np.full((height, width, 3), 255, np.uint8)
    room[: picture.shape[0], : picture.shape[1]] = picture
    return room


def write_sheets(folder: Path, kitti_poses: Path | None, only: list[str] | None = None) -> None:
    """Write ``simulation-WORLD.jpg`` of every world, or of some."""
    found = sheets(kitti_poses)
    for world in only or found:
        if world not in found:
            print(f"skipped {world}: no KITTI poses, see --data")
            continue
        path = folder / f"simulation-{world}.jpg"
        picture = contact_sheet(*found[world])
        cv2.imwrite(str(path), picture, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])
        print(
            f"{path}: {picture.shape[1]}x{picture.shape[0]}, {path.stat().st_size / 1e3:.0f} kB", flush=True
        )
