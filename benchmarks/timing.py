"""Interleaved timing of two alternatives, so that what else the machine does hits both alike."""

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


def _seconds(work: Callable[[], object]) -> float:
    start = time.perf_counter()
    work()
    return time.perf_counter() - start
