"""Tiny fakes of the real data sets' layouts, and what they hold."""

import struct
import zlib
from pathlib import Path

import cv2
import numpy as np

from flowlik.datasets.flow_files import write_flo, write_kitti_flow

WIDTH, HEIGHT = 40, 30


def picture(seed: int, width: int = WIDTH, height: int = HEIGHT) -> np.ndarray:
    noise = np.random.default_rng(seed).integers(0, 256, (height, width), dtype=np.uint8)
    return cv2.GaussianBlur(noise, (5, 5), 1.5)


def some_flow(seed: int = 0, width: int = WIDTH, height: int = HEIGHT) -> np.ndarray:
    flow = np.random.default_rng(seed).normal(0, 3, (height, width, 2))
    flow[:3, :5] = np.nan
    return flow


def save(path: Path, image: np.ndarray) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    assert cv2.imwrite(str(path), image)
    return path


def make_sintel(root: Path, frames: int = 3) -> Path:
    """A scene; its first row is invalid, its first column occluded."""
    for k in range(1, frames + 1):
        save(root / f"training/clean/alley_9/frame_{k:04d}.png", picture(k))
        if k < frames:
            (root / "training/flow/alley_9").mkdir(parents=True, exist_ok=True)
            write_flo(root / f"training/flow/alley_9/frame_{k:04d}.flo", np.full((HEIGHT, WIDTH, 2), k))
            mask = np.zeros((HEIGHT, WIDTH), np.uint8)
            mask[0] = 255
            save(root / f"training/invalid/alley_9/frame_{k:04d}.png", mask)
            mask = np.zeros((HEIGHT, WIDTH), np.uint8)
            mask[:, 0] = 255
            save(root / f"training/occlusions/alley_9/frame_{k:04d}.png", mask)
    return root / "training/clean/alley_9"


def make_kitti_flow(root: Path, images: str = "image_2") -> Path:
    """Two pairs of different sizes; of the second's flow the left half is occluded."""
    for i, width in enumerate((WIDTH, WIDTH + 2)):
        for k in (10, 11):
            save(root / f"training/{images}/{i:06d}_{k}.png", picture(i, width))
        flow = some_flow(i, width)
        (root / "training/flow_occ").mkdir(exist_ok=True)
        (root / "training/flow_noc").mkdir(exist_ok=True)
        write_kitti_flow(root / f"training/flow_occ/{i:06d}_10.png", flow)
        flow[:, : width // 2 * i] = np.nan
        write_kitti_flow(root / f"training/flow_noc/{i:06d}_10.png", flow)
    save(root / f"training/{images}/000000_09.png", picture(9))
    return root / "training"


def make_middlebury_flow(root: Path, apart: bool = False) -> Path:
    """Two scenes, of which the second has no truth; the flow beside the images or in a folder of its own."""
    for scene in ("Army", "Boat"):
        for k in (10, 11):
            save(root / f"other-data/{scene}/frame{k}.png", picture(k))
    truth = root / ("other-gt-flow/Army" if apart else "other-data/Army")
    truth.mkdir(parents=True, exist_ok=True)
    write_flo(truth / "flow10.flo", some_flow())
    return root / "other-data"


def make_chairs(root: Path, names: tuple[str, str, str] = ("_img1.ppm", "_img2.ppm", "_flow.flo")) -> Path:
    folder = root / "FlyingChairs_release/data"
    for i in (1, 2):
        for k in (0, 1):
            save(folder / f"{i:05d}{names[k]}", cv2.cvtColor(picture(10 * i + k), cv2.COLOR_GRAY2BGR))
        write_flo(folder / f"{i:05d}{names[2]}", some_flow(i))
    return folder


def write_pfm(path: Path, values: np.ndarray, little: bool = True) -> None:
    letters = "Pf" if values.ndim == 2 else "PF"
    header = f"{letters}\n{values.shape[1]} {values.shape[0]}\n{-1 if little else 1}.0\n".encode()
    path.write_bytes(header + values[::-1].astype("<f4" if little else ">f4").tobytes())


def make_stereo(root: Path) -> Path:
    folder = root / "Jadeplant-perfect"
    save(folder / "im0.png", picture(0))
    save(folder / "im1.png", picture(1))
    disparity = np.arange(HEIGHT * WIDTH, dtype=np.float64).reshape(HEIGHT, WIDTH)
    disparity[2, 3] = np.inf
    write_pfm(folder / "disp0.pfm", disparity)
    return folder


def claim_png(width: int, height: int) -> bytes:
    """A PNG that is whole, of few bytes, and claims a size."""

    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    header = struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0)
    pixels = zlib.compress(b"\0" * 1000)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", pixels) + chunk(b"IEND", b"")


def photometric_errors(
    first: np.ndarray, second: np.ndarray, flow: np.ndarray, visible: np.ndarray | None = None
) -> tuple[float, float]:
    """Mean absolute difference of grey levels before and after warping by the flow, where it is known."""
    height, width = first.shape
    v, u = np.mgrid[:height, :width]
    ends = flow + np.dstack([u, v])
    with np.errstate(invalid="ignore"):
        used = ((ends >= 0) & (ends <= [width - 1, height - 1])).all(axis=-1)
    if visible is not None:
        used &= visible
    ends = np.nan_to_num(ends).astype(np.float32)
    warped = cv2.remap(second, ends[..., 0], ends[..., 1], cv2.INTER_LINEAR)
    a = first.astype(np.float64)
    return float(np.abs(a - second)[used].mean()), float(np.abs(a - warped)[used].mean())
