"""The gauntlet: situations in which a motion is confidently mistaken, and who is.

    python benchmarks/gauntlet.py --out RUN [--quick] [--cache CACHE] [--only SCENARIO ...] [--seed SEED]

Every scenario is flown with three flow methods, with known depth and without, over at least 300 motions of
exact truth. CACHE keeps flights and measurements, but nothing of the estimators: a changed one is judged
again without measuring again.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

from flowlik.report import finish
from flowlik.results.runs import RunFolder
from flowlik.support.progress import terminal_progress
from gauntlet_judge import Verdict
from gauntlet_run import FLOWS, OURS, RIVALS, Cell, Task, run
from gauntlet_scenarios import SCENARIOS
from gauntlet_table import records_of, table

SEEDS, PAIRS = 5, 64
QUICK_PAIRS = 32


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--out", type=Path, required=True, help="run folder with its report")
    parser.add_argument("--cache", type=Path, help="flights and measurements, kept; by default not")
    parser.add_argument(
        "--only", nargs="+", choices=tuple(SCENARIOS), default=tuple(SCENARIOS), metavar="SCENARIO"
    )
    parser.add_argument("--flows", nargs="+", choices=FLOWS, default=FLOWS)
    parser.add_argument("--estimators", nargs="+", choices=(*OURS, *RIVALS), default=(*OURS, *RIVALS))
    parser.add_argument("--seed", type=int, default=0, help="first of five; 0 to tune on, 100 to report")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--quick", action="store_true", help="32 motions a cell, one seed")
    options = parser.parse_args()

    seeds = range(options.seed, options.seed + (1 if options.quick else SEEDS))
    config = {"only": list(options.only), "flows": list(options.flows), "quick": options.quick}
    command = " ".join(
        [
            "benchmarks/gauntlet.py",
            "--out RUN",
            f"--seed {options.seed}",
            *(["--quick"] if options.quick else []),
        ]
    )
    folder = RunFolder(options.out, command, config, options.seed)
    with tempfile.TemporaryDirectory() as scratch:
        cache = options.cache or Path(scratch)
        tasks = [
            Task(name, seed, QUICK_PAIRS if options.quick else PAIRS, tuple(options.flows),
                 tuple(options.estimators), cache)
            for seed in seeds
            for name in options.only
        ]  # fmt: skip
        found: dict[Cell, list[Verdict]] = {}
        with ProcessPoolExecutor(options.workers) as pool:
            for verdicts in terminal_progress(pool.map(run, tasks), "clips", len(tasks)):
                for cell, of_clip in verdicts.items():
                    found.setdefault(cell, []).extend(of_clip)
    folder.records += records_of(found, options.seed)
    print(table(folder.records))
    print(f"\nreport: {finish(folder)}", file=sys.stderr)


if __name__ == "__main__":
    main()
