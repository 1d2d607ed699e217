"""Sketches of the standard flights that several benchmarks share, kept in a cache folder beside them."""

from __future__ import annotations

import zlib
from pathlib import Path

from flowlik.calibration import ErrorSketch, Task, gather, load_sketch, save_sketch, sketch_blocks
from flowlik.commands.standard_flights import rendered
from flowlik.commands.standard_plan import StandardFlight as Flight
from flowlik.commands.standard_runs import FRAMES_PER_SECOND, Runs

__all__ = ["FRAMES_PER_SECOND", "Flight", "Runs", "errors_of", "rendered"]

BLOCKS_A_FLIGHT = 4


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
