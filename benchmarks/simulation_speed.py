"""Speed, set-up time and peak memory, each case in a process of its own: what a user's first run meets."""

from __future__ import annotations

import argparse
import json
import resource
import subprocess
import sys
import time
from pathlib import Path

CASES = ("forest", "driving", "forest-small")


def measured(case: str, frames: int, poses: Path | None) -> dict[str, float]:
    """Run a case in a fresh process; frames per second, set-up time, memory and seconds of each stage."""
    _child(case, 2, poses)  # compiles, once and for all
    return _child(case, frames, poses)


def _child(case: str, frames: int, poses: Path | None) -> dict[str, float]:
    command = [sys.executable, __file__, case, "--frames", str(frames)]
    if poses is not None:
        command += ["--poses", str(poses)]
    return json.loads(subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True).stdout)


def run(case: str, frames: int, poses: Path | None) -> dict[str, float]:
    """Render frames of a case with the default sensor, in runs of neighbouring ones all along the flight."""
    from flowlik.geometry.camera import Pinhole
    from flowlik.simulation import simulate
    from simulation_profile import profile

    start = time.perf_counter()
    if case == "driving":
        sequence = simulate("driving", poses)
    elif case == "forest":
        sequence = simulate("forest", "forest-fig8", frames=1980)
    else:
        sequence = simulate("forest-small", "training", frames=400, camera=Pinhole.from_fov(320, 180, 120.0))
    sequence.image(0)
    setup_s = time.perf_counter() - start
    run_length = min(10, frames)
    firsts = range(0, len(sequence) - run_length - 1, max(1, len(sequence) * run_length // frames))
    seconds, cpu_seconds, count = 0.0, 0.0, 0
    for first in firsts:
        sequence.image(first)  # a jump; what follows are a flight's ordinary frames
        start, cpu_start = time.perf_counter(), time.process_time()
        for k in range(first + 1, first + 1 + run_length):
            sequence.image(k)
        seconds += time.perf_counter() - start
        cpu_seconds += time.process_time() - cpu_start
        count += run_length
    peak_mb = peak_memory_mb()  # before the profile, which is no part of a flight
    return {
        "setup_seconds": setup_s,
        "frames_per_second": count / seconds,
        "cpu_seconds_per_frame": cpu_seconds / count,
        "frames": count,
        "peak_memory_mb": peak_mb,
        **profile(sequence, range(101, 101 + min(8, frames))),
    }


def peak_memory_mb() -> float:
    """Peak resident memory of this process [MB].

    Where there is one, /proc is asked: getrusage of a child on Linux begins with its parent's peak.
    """
    status = Path("/proc/self/status")
    if status.exists():
        line = next(line for line in status.read_text().splitlines() if line.startswith("VmHWM"))
        return int(line.split()[1]) / 1024
    unit = 1 if sys.platform == "darwin" else 1024
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit / 2**20


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("case", choices=CASES)
    parser.add_argument("--frames", type=int, default=40)
    parser.add_argument("--poses", type=Path)
    options = parser.parse_args()
    print(json.dumps(run(options.case, options.frames, options.poses)))
