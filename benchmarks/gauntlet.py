"""The gauntlet: situations in which a motion is confidently mistaken, and who is.

    python benchmarks/gauntlet.py --out RUN [--quick] [--cache CACHE] [--only SCENARIO ...] [--seed SEED]

Every scenario is flown with three flow methods, with known depth and without, over at least 300 motions of
exact truth. CACHE keeps flights and measurements, but nothing of the estimators: a changed one is judged
again without measuring again.
"""

from __future__ import annotations

import argparse
import shutil
import sys
import tempfile
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import numpy as np

from flowlik.report import finish
from flowlik.results.runs import RunFolder
from flowlik.support.files import atomic_write
from flowlik.support.progress import terminal_progress
from gauntlet_judge import Verdict
from gauntlet_page import heat_map, write_docs
from gauntlet_run import FLOWS, OURS, RIVALS, Cell, Task, run
from gauntlet_scenarios import SCENARIOS
from gauntlet_table import records_of, table

SEEDS, PAIRS = 5, 60
QUICK_PAIRS = 24


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
    parser.add_argument("--seed", type=int, default=0, help="the first; 0 to tune on, 100 to report")
    parser.add_argument("--seeds", type=int, default=SEEDS, help="how many")
    parser.add_argument("--docs", type=Path, help="page between whose marks the tables are put")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--quick", action="store_true", help="24 motions a cell, one seed")
    options = parser.parse_args()

    count, pairs = (1, QUICK_PAIRS) if options.quick else (options.seeds, PAIRS)
    words = [f"--seed {options.seed}", *(["--quick"] if options.quick else [])]
    config = {
        "only": list(options.only),
        "flows": list(options.flows),
        "quick": options.quick,
        "seeds": count,
    }
    command = " ".join(["benchmarks/gauntlet.py", "--out RUN", *words])
    folder = RunFolder(options.out, command, config, options.seed)
    with tempfile.TemporaryDirectory() as scratch:
        who = tuple(options.flows), tuple(options.estimators), options.cache or Path(scratch)
        seeds = range(options.seed, options.seed + count)
        tasks = [Task(name, seed, pairs, *who) for seed in seeds for name in options.only]
        found = verdicts_of(tasks, folder, options.workers)
    folder.records += records_of(found, options.seed)
    print(table(folder.records))
    folder.save("gauntlet", "all", heat_map(folder.records))
    if options.docs is not None:
        write_docs(options.docs, folder.records)
    print(f"\nreport: {finish(folder)}", file=sys.stderr)


def verdicts_of(tasks: list[Task], folder: RunFolder, workers: int) -> dict[Cell, list[Verdict]]:
    """Verdicts by cell. Each clip's are kept until the run is finished: an interrupted one goes on."""
    kept = folder.begin() / "clips"
    kept.mkdir(exist_ok=True)
    folder.at_end(lambda: shutil.rmtree(kept))
    paths = {task: kept / f"{task.scenario}-{task.seed}.npz" for task in tasks}
    todo = [task for task in tasks if not paths[task].is_file()]
    with ProcessPoolExecutor(workers) as pool:
        done = zip(todo, pool.map(run, todo))
        for task, cells in terminal_progress(done, "clips", len(todo)):
            with atomic_write(paths[task], "wb") as file:
                np.savez(file, **{"|".join(cell): np.array(of_cell) for cell, of_cell in cells.items()})
    found: dict[Cell, list[Verdict]] = {}
    for task in tasks:
        with np.load(paths[task]) as data:
            for name in data.files:
                scenario, flow, residual, estimator = name.split("|")
                rows = found.setdefault((scenario, flow, residual, estimator), [])
                rows += [Verdict(*row) for row in data[name]]
    return found


if __name__ == "__main__":
    main()
