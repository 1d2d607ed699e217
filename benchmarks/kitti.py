"""The paper's Table III on KITTI odometry: flowlik, OpenCV and PoseLib on the same tracks, same scale."""

from __future__ import annotations

import argparse
from pathlib import Path

from flowlik.commands import find_table_sequences, kitti_table
from flowlik.commands.options import KittiOptions
from flowlik.results.records import Record, select
from flowlik.support.progress import terminal_progress

COLUMNS = {
    "t_err_percent": "t_err %", "t_err_percent_low": "from", "t_err_percent_high": "to",
    "t_err_offset_removed_percent": "offset removed", "r_err_deg_per_100m": "r_err",
    "direction_error_median_mrad": "dir. mrad", "direction_error_worst_mrad": "worst mrad",
    "rotation_error_median_mdeg": "rot. mdeg", "split_half_direction_mrad": "split mrad",
    "split_half_rotation_mdeg": "split mdeg",
    "estimation_ms": "ms",
}  # fmt: skip
QUICK_FRAMES = 60


def cell(records: list[Record]) -> str:
    value = records[0].value if records else None
    return "–" if value is None else f"{value:.3f}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--data", type=Path, required=True, help="root of KITTI odometry, or of clips of it")
    parser.add_argument("--model", type=Path, required=True, help="model calibrated in simulation")
    parser.add_argument("--sequences", nargs="*", help="names; by default all that are there")
    parser.add_argument("--start", type=int, default=0, help="first frame: a cold start there")
    parser.add_argument("--frames", type=int, help="only so many frames")
    parser.add_argument("--out", type=Path, required=True, help="run folder")
    parser.add_argument("--quick", action="store_true", help=f"only the first {QUICK_FRAMES} frames")
    options = parser.parse_args()

    names = tuple(options.sequences or find_table_sequences(options.data))
    frames = QUICK_FRAMES if options.quick else options.frames
    run = kitti_table(
        options.data, options.model, options.out,
        KittiOptions(sequences=names, frames=frames, start=options.start),
        command="flowlik reproduce --kitti", progress=terminal_progress,
    )  # fmt: skip
    for dataset in dict.fromkeys(r.dataset for r in run.records):
        rows = select(run.records, dataset=dataset)
        print(f"\n{dataset}, scale truth-norm, no alignment")
        print(f"{'estimator':<22}" + "".join(f"{title:>15}" for title in COLUMNS.values()))
        for name in dict.fromkeys(r.estimator for r in rows if r.estimator):
            cells = [cell(select(rows, estimator=name, metric=metric)) for metric in COLUMNS]
            print(f"{name:<22}" + "".join(f"{text:>15}" for text in cells))
        for r in rows:
            if "_coverage_" in r.metric or r.metric == "measuring_ms":
                print(f"{r.estimator or 'all'} {r.metric} {r.value:.3f}")


if __name__ == "__main__":
    main()
