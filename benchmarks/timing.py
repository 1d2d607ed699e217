"""Interleaved timing of alternatives, so that what else the machine does hits all alike."""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np


def ratio(
    ours: Callable[[], object], theirs: Callable[[], object], repeats: int = 60
) -> tuple[float, float, float]:
    """Median times [ms] of both and the median of the ratios of neighbouring runs."""
    for _ in range(3):
        ours(), theirs()
    times = np.array([(_seconds(ours), _seconds(theirs)) for _ in range(repeats)])
    return (*(1e3 * np.median(times, axis=0)), float(np.median(times[:, 0] / times[:, 1])))


def processor_times(work: dict[str, Callable[[], object]], repeats: int) -> dict[str, np.ndarray]:
    """Processor times [ms] (repeats,) of alternatives run in turns, on all threads of this process.

    Other processes can lengthen them by what they take of caches and of a core's other half, but not by
    waiting.
    """
    for run in work.values():
        run()
    times: dict[str, list[float]] = {name: [] for name in work}
    for _ in range(repeats):
        for name, run in work.items():
            start = time.process_time()
            run()
            times[name].append(1e3 * (time.process_time() - start))
    return {name: np.array(values) for name, values in times.items()}


def _seconds(work: Callable[[], object]) -> float:
    start = time.perf_counter()
    work()
    return time.perf_counter() - start
