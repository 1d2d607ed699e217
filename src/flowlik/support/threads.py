"""Python threads over bands of rows, and ahead of a loop, for work that releases the interpreter's lock.

Numba's own threads are not used: they spin while they wait, which on a busy machine costs a hundred times
the work itself, and a process forked after they have run is killed.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from functools import lru_cache
from typing import Any

THREADS = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def in_bands(work: Callable[[int, int], object], rows: int, band: int) -> None:
    """Call ``work(first, last)`` on bands that cover all rows, side by side.

    Parameters
    ----------
    work : callable
        Writes its rows, and only these, so that the result does not depend on the number of threads.
    rows : int
        Number of rows.
    band : int
        Rows a band; so many that a call outweighs the handful of microseconds that handing it over costs.
    """
    bands = [(first, min(first + band, rows)) for first in range(0, rows, band)]
    if len(bands) < 2 or THREADS < 2:
        for first, last in bands:
            work(first, last)
        return
    list(_pool().map(lambda limits: work(*limits), bands))


def map_ahead(work: Callable[[Any], Any], items: Iterable[Any]) -> Iterator[Any]:
    """Lazy, ordered `map` that works on the next item, on a thread, while the last result is used.

    Items are taken on the thread of the caller, one ahead.
    """
    with ThreadPoolExecutor(1, thread_name_prefix="flowlik-ahead") as ahead:
        waiting: Future[Any] | None = None
        for item in items:
            following = ahead.submit(work, item)
            if waiting is not None:
                yield waiting.result()
            waiting = following
        if waiting is not None:
            yield waiting.result()


@lru_cache(maxsize=1)
def _pool() -> ThreadPoolExecutor:
    return ThreadPoolExecutor(THREADS, thread_name_prefix="flowlik")


# threads do not survive a fork: the child makes its own
if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_pool.cache_clear)
