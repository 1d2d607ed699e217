"""Ego-motion with known depth: speed, consistency, the paper's Table II and Figure 7, hovering, real depth.

    python benchmarks/egomotion.py --out RUN --cache CACHE [--data DATA] [--quick] [--only speed table ...]

Models are those that ship; rivals are at their best on calibration flights. CACHE keeps rendered flights and
the rivals' settings. A whole run renders 3 x 298 m of forest, hours of one core; `--frames`, `--worlds` and
`--sensors` make less of it.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from chain_speed import chain_over_flow, latency
from egomotion_consistency import consistency_part
from egomotion_flights import FRAMES, WORLD_SEEDS
from egomotion_hover import hover
from egomotion_real import real_part
from egomotion_speed import chains, estimation, loop
from egomotion_table import table
from egomotion_variants import METHODS
from flowlik.report import finish
from flowlik.results.runs import RunFolder
from flowlik.support.progress import terminal_progress

PARTS = ("speed", "consistency", "table", "hover", "real")


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--out", type=Path, required=True, help="run folder with its report")
    parser.add_argument("--cache", type=Path, required=True)
    parser.add_argument("--data", type=Path, help="KITTI's poses, TartanAir and 7-Scenes")
    parser.add_argument("--only", nargs="+", choices=PARTS, default=PARTS)
    parser.add_argument("--methods", nargs="+", choices=METHODS, default=METHODS)
    parser.add_argument("--trajectories", nargs="+", choices=tuple(FRAMES), default=tuple(FRAMES))
    parser.add_argument("--frames", type=int, help="only the first so many frames of each table flight")
    parser.add_argument("--worlds", type=int, default=len(WORLD_SEEDS), help="world seeds of the table")
    parser.add_argument("--sensors", type=int, default=3, help="sensor and estimator seeds of the table")
    parser.add_argument("--quick", action="store_true", help="60 frames, one world, one sensor, few repeats")
    options = parser.parse_args()
    quick, methods = options.quick, tuple(options.methods)
    frames, worlds, sensors = (60, 1, 1) if quick else (options.frames, options.worlds, options.sensors)

    config = {"only": list(options.only), "methods": list(methods), "frames": frames, "worlds": worlds,
              "sensors": sensors, "quick": quick}  # fmt: skip
    command = " ".join(["benchmarks/egomotion.py", "--out RUN", *(["--quick"] if quick else [])])
    run = RunFolder(options.out, command, config, WORLD_SEEDS[0])
    if "speed" in options.only:
        run.records += list(estimation(options.cache, 4 if quick else 10, 5 if quick else 20))
        run.records += list(chains(options.cache, 2 if quick else 6))
        run.records += list(loop(options.cache, 2 if quick else 5))
        run.records += list(chain_over_flow(options.cache, 3 if quick else 10))
        run.records += list(latency(options.cache, 60 if quick else 600))
    if "consistency" in options.only:
        poses = None if options.data is None else options.data / "kitti_poses"
        run.records += consistency_part(methods, options.cache, poses, quick, terminal_progress)
    if "table" in options.only:
        table(
            run, options.cache, methods, frames, worlds, sensors, terminal_progress,
            tuple(options.trajectories),
        )  # fmt: skip
    if "hover" in options.only:
        hover(run, options.cache, methods, 30 if quick else 120, terminal_progress)
    if "real" in options.only and options.data is not None:
        run.records += real_part(options.data, options.cache, methods, terminal_progress)
    print(f"\nreport: {finish(run)}", file=sys.stderr)


if __name__ == "__main__":
    main()
