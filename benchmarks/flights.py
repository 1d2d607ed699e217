"""Simulated flights that several benchmarks share, rendered once and kept in a cache folder."""

from __future__ import annotations

import time
import zlib
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial.transform import RigidTransform

from flowlik.calibration import Block, ErrorSketch, Task, gather, load_sketch, save_sketch, sketch_blocks
from flowlik.datasets.base import frame_index
from flowlik.geometry.camera import Pinhole
from flowlik.support.files import atomic_write

FRAMES_PER_SECOND = 60
BLOCKS_A_FLIGHT = 4


@dataclass(frozen=True)
class Flight:
    """Short runs of frames at places all along a flight: world, path, speed [m/s], seed."""

    world: str
    trajectory: str
    speed_mps: float
    seed: int
    places: int = 5
    run: int = 3
    use: str = "cal"
    sensor: str = "default"

    @property
    def name(self) -> str:
        kind = {"driving": f"drive-{self.trajectory}"}.get(self.world, f"{self.world}-{self.speed_mps:g}")
        path = {"forest-fig8": "-fig8", "curve": "-curve"}.get(self.trajectory, "")
        sensor = "" if self.sensor == "default" else f"-{self.sensor}"
        return f"{self.use}-{kind}{path}-{self.seed}{sensor}"


class Runs:
    """Frames of a flight from the cache: runs of neighbouring frames with their true flow, depth and poses.

    Frames k and k + 1 belong together only within a run, as `blocks` has them.
    """

    def __init__(self, path: Path) -> None:
        self.name = path.stem
        with np.load(path) as data:
            self._images, self._flow, self._depth = data["images"], data["flow"], data["depth"]
            self.run = int(data["run"])
            self._poses = RigidTransform.from_matrix(data["pose"])
            width, height, *intrinsics = data["cam"]
            self.camera = Pinhole(int(width), int(height), *map(float, intrinsics))

    def blocks(self, seed: int) -> list[Block]:
        """One block a run, so that no pair spans two places."""
        return [Block(self, range(k, k + self.run - 1), seed + k) for k in range(0, len(self), self.run)]

    def __len__(self) -> int:
        return len(self._images)

    def image(self, k: int) -> np.ndarray:
        return self._images[frame_index(self, k)]

    def flow(self, k: int) -> np.ndarray:
        return self._flow[frame_index(self, k)].astype(np.float64)

    def depth(self, k: int) -> np.ndarray:
        return self._depth[frame_index(self, k)].astype(np.float64)

    def T_n_c(self, k: int) -> RigidTransform:
        return self._poses[frame_index(self, k)]

    def timestamp(self, k: int) -> float:
        return k / FRAMES_PER_SECOND


def rendered(flight: Flight, cache: Path, kitti_poses: Path | None) -> Runs:
    """Runs of a flight, rendered with the default sensor unless the cache has them."""
    path = cache / f"{flight.name}.npz"
    if not path.is_file():
        _render(flight, path, kitti_poses)
    return Runs(path)


def _render(flight: Flight, path: Path, kitti_poses: Path | None) -> None:
    from flowlik.simulation import IDEAL_SENSOR, Sensor, simulate

    # another camera's noise and sharpness: images scaled down from larger ones, and a phone's in the dark
    poor = Sensor(full_well_e=2_500.0, read_noise_e=12.0, psf_sigma_px=0.9)
    sensor = {"default": Sensor(), "clean": IDEAL_SENSOR, "poor": poor}[flight.sensor]
    start = time.perf_counter()
    if flight.world == "driving":
        assert kitti_poses is not None
        poses = kitti_poses / f"{flight.trajectory}.txt"
        sequence = simulate("driving", poses, seed=flight.seed, traffic=6, sensor=sensor)
    else:
        length_m = 100.0 if flight.trajectory in ("straight", "curve") else 200.0
        frames = int(length_m * FRAMES_PER_SECOND / flight.speed_mps)
        sequence = simulate(
            flight.world, flight.trajectory, frames, flight.speed_mps, flight.seed, sensor=sensor
        )
    firsts = np.linspace(3, len(sequence) - flight.run - 1, flight.places).astype(int)
    images, depth, flow, pose = [], [], [], []
    for first in firsts:
        for k in range(first, first + flight.run):
            images.append(sequence.image(k))
            depth.append(sequence.depth(k).astype(np.float32))
            last = k == first + flight.run - 1
            flow.append(np.full((*depth[-1].shape, 2), np.nan) if last else sequence.flow(k))
            pose.append(sequence.T_n_c(k).as_matrix())
    c = sequence.camera
    with atomic_write(path, "wb") as file:
        np.savez(
            file, images=np.array(images), depth=np.array(depth), flow=np.array(flow, dtype=np.float32),
            pose=np.array(pose), run=flight.run, cam=[c.width, c.height, c.fx, c.fy, c.cx, c.cy],
        )  # fmt: skip
    print(f"rendered {flight.name}: {len(images)} frames in {time.perf_counter() - start:.0f} s", flush=True)


def errors_of(flight: Flight, task: Task, cache: Path, kitti_poses: Path | None) -> list[list[ErrorSketch]]:
    """Blocks of sketches of a flight's errors, a list for each index of the task; kept in the cache."""
    folder = cache / "sketches" / f"{task.method.name}-{zlib.crc32(repr(task).encode()):x}--{flight.name}"
    paths = [sorted(folder.glob(f"{kind}-*.npz")) for kind in range(len(task.indices))]
    if not all(paths):
        blocks = rendered(flight, cache, kitti_poses).blocks(flight.seed)
        kinds = gather(sketch_blocks(blocks, [task]), len(blocks), BLOCKS_A_FLIGHT)
        for kind, sketches in enumerate(kinds):
            for i, sketch in enumerate(sketches):
                save_sketch(sketch, folder / f"{kind}-{i}.npz")
        return kinds
    return [[load_sketch(path) for path in of_kind] for of_kind in paths]
