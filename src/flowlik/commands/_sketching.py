"""Sketching for a run: on an executor, resumable, with its throughput on record."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from typing import Any

from flowlik.calibration import Block, ErrorSketch, SketchCache, Task, executor, sketch_blocks
from flowlik.calibration.cache import first_sketches
from flowlik.commands._shared_options import Execution
from flowlik.results.records import Record, protocol
from flowlik.results.runs import RunFolder
from flowlik.support.progress import Progress
from flowlik.support.resources import peak_memory_mb


def sketch_for_run(
    run: RunFolder,
    blocks: Sequence[Block],
    tasks: Sequence[Task],
    what: str,
    execution: Execution,
    progress: Progress,
    folder: str = "sketches",
    **keys: Any,
) -> Iterator[list[ErrorSketch]]:
    """Sketches of blocks, saved in the run's folder as they come; the run's records tell the throughput.

    Parameters
    ----------
    run : RunFolder
        The run. When it is finished the saved sketches are deleted, unless they shall be kept.
    blocks, tasks : sequence
        What to sketch.
    what : str
        Name of the work, for progress.
    execution : Execution
        Where to measure.
    progress : Progress
        Told how far it is.
    folder : str
        Where in the run's folder to save; a run of several populations needs one each.
    **keys
        Fields of the records, such as the dataset.

    Raises
    ------
    DataError
        If the options of the execution do not fit together.
    """
    cache = SketchCache(run.path / folder, run.begin)
    pairs = components = 0
    # the sketches of a task are of the same components
    firsts = first_sketches(tasks)
    with executor(execution.executor, execution.workers, execution.scheduler) as block_map:
        start = time.monotonic()
        for found in progress(sketch_blocks(blocks, tasks, block_map, cache), what, len(blocks)):
            pairs += found[0].pairs
            components += sum(found[i].total for i in firsts)
            yield found
        seconds = time.monotonic() - start
    for warning in cache.warnings:
        run.warn(warning)
    if not execution.keep_sketches:
        run.at_end(cache.remove)
    note = protocol(executor=execution.executor, workers=execution.workers, resumed=cache.resumed["blocks"])
    for name, done in (("pairs", pairs), ("components", components)):
        if count := done - cache.resumed[name]:
            rate = count / seconds
            run.records.append(Record(f"{name}_per_second", rate, "1/s", **keys, count=count, protocol=note))
    note += "; of=the largest process"
    run.records.append(Record("peak_memory_mb", peak_memory_mb(), "MB", **keys, protocol=note))
