"""Where blocks are sketched: in this process, in processes of this machine, or on a Dask cluster.

Each executor is a context manager that gives a `map` for `flowlik.calibration.sketch_blocks`: results come
in the order of the blocks, and only a few blocks are under way at a time, so that memory does not grow with
their number.
"""

from __future__ import annotations

import builtins
import multiprocessing
import os
import signal
import threading
from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import AbstractContextManager, contextmanager
from typing import Any

import cv2

from flowlik.errors import CalibrationError, DataError
from flowlik.support import threads
from flowlik.support.extras import extra
from flowlik.support.versions import versions

Map = Callable[..., Iterator[Any]]

AHEAD = 2
"""Blocks under way for each worker: one that is measured, one that waits."""

ALGEBRA_THREADS = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS", "VECLIB_MAXIMUM_THREADS")
WAIT_S = 30
AGAIN = "run the same command again to go on from the sketches already saved"


def executor(
    name: str = "serial", workers: int | None = None, scheduler: str | None = None
) -> AbstractContextManager[Map]:
    """Executor of a name, a context manager that gives a lazy, ordered `map`.

    Parameters
    ----------
    name : {"serial", "processes", "dask"}
        Where to work.
    workers : int, optional
        Processes on this machine, one a core by default; not for ``serial`` nor a cluster that exists.
    scheduler : str, optional
        Address of a Dask scheduler; without it ``dask`` makes a cluster of local processes.

    Raises
    ------
    DataError
        If the options do not fit together.
    MissingExtraError
        On entering, if Dask is not installed.
    CalibrationError
        On entering, if no scheduler or worker answers. From the map, if a worker dies; Dask repeats its
        blocks first.
    """
    if name not in EXECUTORS:
        raise DataError(f"unknown executor {name!r}: known are {', '.join(EXECUTORS)}")
    if scheduler and name != "dask":
        raise DataError(f"a scheduler's address is for the executor dask, not {name}")
    if workers is not None and (name == "serial" or scheduler):
        raise DataError("a number of workers is for local processes, not for serial or a cluster that exists")
    if workers is not None and workers < 1:
        raise DataError(f"a number of workers must be 1 or more, not {workers}")
    return EXECUTORS[name](workers or threads.THREADS, scheduler)


def _bounded(submit: Callable[..., Any], result: Callable[[Any], Any], most: int) -> Map:
    """Lazy, ordered `map` that keeps at most so many calls under way.

    Parameters
    ----------
    submit : callable
        ``submit(function, *items)`` starts a call and returns its future.
    result : callable
        Waits for a future's result.
    most : int
        Calls submitted whose results have not been taken.
    """

    def ordered(function: Callable[..., Any], *lists: Any) -> Iterator[Any]:
        waiting: deque[Any] = deque()
        try:
            for items in zip(*lists):
                if len(waiting) == most:
                    yield result(waiting.popleft())
                waiting.append(submit(_on_one_thread, function, *items))
            while waiting:
                yield result(waiting.popleft())
        finally:
            for future in waiting:
                future.cancel()

    return ordered


def _on_one_thread(function: Callable[..., Any], *items: Any) -> Any:
    """Call a function in a process that has neighbours, with whom threads of its own would only compete."""
    cv2.setNumThreads(1)
    threads.THREADS = 1
    return function(*items)


@contextmanager
def _serial(workers: int, scheduler: str | None) -> Iterator[Map]:
    yield builtins.map


@contextmanager
def _processes(workers: int, scheduler: str | None) -> Iterator[Map]:
    def result(future: Any) -> Any:
        try:
            return future.result()
        except BrokenProcessPool:
            raise CalibrationError(f"a worker process died (out of memory?); {AGAIN}") from None

    context = multiprocessing.get_context("spawn")
    pool = ProcessPoolExecutor(workers, mp_context=context, initializer=_begin_worker)
    # workers read it as they start: threads of their algebra libraries would spin on their neighbours' cores
    said = {name: "1" for name in ALGEBRA_THREADS if name not in os.environ}
    os.environ.update(said)
    try:
        yield _bounded(pool.submit, result, AHEAD * workers)
    finally:
        for name in said:
            os.environ.pop(name, None)
        pool.shutdown(cancel_futures=True)


def _begin_worker() -> None:
    # the parent is interrupted, and ends its workers
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    """Leave no process behind when the parent is killed: a pool's workers would wait for ever."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


@contextmanager
def _dask(workers: int, scheduler: str | None) -> Iterator[Map]:
    distributed: Any = extra("distributed", "the executor dask")
    cluster: Any = None
    if scheduler is None:
        cluster = distributed.LocalCluster(
            n_workers=workers, threads_per_worker=1, dashboard_address=":0", silence_logs="CRITICAL"
        )
    try:
        client = _client(distributed, cluster or scheduler)
        try:

            def submit(function: Callable[..., Any], *items: Any) -> Any:
                return client.submit(function, *items, pure=False)

            def result(future: Any) -> Any:
                try:
                    return future.result()
                except distributed.KilledWorker:
                    raise CalibrationError(
                        f"workers died again and again over one block (out of memory?); {AGAIN}"
                    ) from None

            yield _bounded(submit, result, AHEAD * sum(client.nthreads().values()))
        finally:
            client.close()
    finally:
        if cluster is not None:
            cluster.close()


def _client(distributed: Any, address: Any) -> Any:
    """Client of a cluster that has workers, of the same versions as this process."""
    try:
        client = distributed.Client(address, timeout=WAIT_S, set_as_default=False)
    except (OSError, ValueError) as error:
        reason = " ".join(str(error).split())
        raise CalibrationError(f"no Dask scheduler answers at {address} ({reason})") from None
    try:
        client.wait_for_workers(1, timeout=WAIT_S)
        mine = versions()
        for worker, theirs in client.run(versions).items():
            differing = [
                f"{name} {theirs.get(name)} not {mine[name]}"
                for name in mine
                if theirs.get(name) != mine[name]
            ]
            if differing:
                raise CalibrationError(f"the Dask worker {worker} has {', '.join(differing)}")
    except (TimeoutError, distributed.TimeoutError):
        client.close()
        raise CalibrationError(f"the Dask scheduler at {address} has no workers") from None
    except ModuleNotFoundError as error:
        client.close()
        raise CalibrationError(f"the Dask workers at {address} lack a package ({error})") from None
    except BaseException:
        client.close()
        raise
    return client


EXECUTORS: dict[str, Callable[[int, str | None], AbstractContextManager[Map]]] = {
    "serial": _serial,
    "processes": _processes,
    "dask": _dask,
}
"""Executors by name, each of a number of local workers and a scheduler's address."""
