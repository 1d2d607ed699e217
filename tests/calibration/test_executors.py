"""Executors give the same counts whatever happens to their workers."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from flowlik.calibration import Task, merge_all, sketch_blocks, split_blocks
from flowlik.calibration.executors import AHEAD, _bounded, executor
from flowlik.errors import CalibrationError, DataError, MissingExtraError
from flowlik.flow import Farneback, LucasKanade
from flowlik.geometry.camera import Pinhole
from flowlik.simulation import simulate

PATH = os.pathsep.join(sys.path)
TASKS = (Task(Farneback()), Task(LucasKanade()))


class Deadly:
    """A sequence whose frame kills the process that reads it: once, or each time."""

    def __init__(self, sequence, frame: int, once: Path | None):
        self.sequence, self.frame, self.once = sequence, frame, once
        self.camera, self.name = sequence.camera, "deadly"

    def __len__(self):
        return len(self.sequence)

    def image(self, k):
        if k == self.frame and (self.once is None or not self.once.exists()):
            if self.once is not None:
                self.once.touch()
            os.kill(os.getpid(), signal.SIGKILL)
        return self.sequence.image(k)

    def flow(self, k):
        return self.sequence.flow(k)


def flight():
    camera = Pinhole.from_fov(64, 48, 120.0)
    return simulate("planes", "training", frames=9, speed_mps=12.0, seed=1, camera=camera)


@pytest.fixture
def sequence():
    """A flight that has not been drawn yet, small to send."""
    return flight()


@pytest.fixture(scope="module")
def serial():
    with executor() as serial_map:
        return list(sketch_blocks(split_blocks(flight(), 0, 2), TASKS, serial_map))


def assert_equal(found, expected):
    assert len(found) == len(expected)
    for mine, theirs in zip(found, expected):
        for a, b in zip(mine, theirs, strict=True):
            for name in ("counts", "by_level", "errors", "frames", "keys"):
                np.testing.assert_array_equal(getattr(a, name), getattr(b, name))
            # a pickled pose may differ in its last bit, and so may the reservoir's errors
            np.testing.assert_allclose(a.rows, b.rows, rtol=0, atol=1e-9)
            assert (a.pairs, a.excluded) == (b.pairs, b.excluded)


def test_processes_give_the_same_sketches(sequence, serial):
    with executor("processes", 2) as process_map:
        found = list(sketch_blocks(split_blocks(sequence, 0, 2), TASKS, process_map))
    assert_equal(found, serial)


def test_the_death_of_a_process_is_one_clear_error(sequence):
    blocks = split_blocks(Deadly(sequence, 3, None), 0, 2)
    with executor("processes", 1) as process_map, pytest.raises(CalibrationError, match="again to go on"):
        list(sketch_blocks(blocks, TASKS, process_map))


def test_no_process_outlives_its_parent():
    program = """
from flowlik.calibration.executors import executor
with executor("processes", 1) as process_map:
    for pid in process_map(eval, ["__import__('os').getpid()", "__import__('time').sleep(60)"]):
        print(pid, flush=True)
"""
    words = [sys.executable, "-c", program]
    environment = {**os.environ, "PYTHONPATH": PATH}
    with subprocess.Popen(words, stdout=subprocess.PIPE, text=True, env=environment) as parent:
        worker = int(parent.stdout.readline())
        parent.kill()
        try:
            # the worker holds the other end of this pipe as long as it lives
            parent.communicate(timeout=30)
        except subprocess.TimeoutExpired:
            os.kill(worker, signal.SIGKILL)
            pytest.fail("the worker still lives")


def test_bad_data_is_the_same_error_from_a_process(sequence):
    broken = split_blocks(sequence, 0, 2)[0]
    broken = type(broken)(sequence, range(len(sequence)), 0)
    with executor("processes", 1) as process_map, pytest.raises(DataError, match="no frame 9"):
        list(sketch_blocks([broken], TASKS[:1], process_map))


@pytest.fixture(scope="module")
def dask_map():
    pytest.importorskip("distributed")
    with executor("dask", 2) as given:
        yield given


def test_dask_gives_the_same_sketches_though_a_worker_dies(sequence, serial, dask_map, tmp_path):
    deadly = Deadly(sequence, 3, tmp_path / "died")
    found = list(sketch_blocks(split_blocks(deadly, 0, 2), TASKS, dask_map))
    assert deadly.once.exists()
    assert_equal(found, serial)


def test_a_cluster_that_exists_is_used_by_its_address(sequence, serial, monkeypatch):
    distributed = pytest.importorskip("distributed")
    # a worker within this process, which keeps its threads
    monkeypatch.setattr(
        "flowlik.calibration.executors._on_one_thread", lambda function, *items: function(*items)
    )
    with (
        distributed.LocalCluster(1, threads_per_worker=1, processes=False, dashboard_address=":0") as cluster,
        executor("dask", scheduler=cluster.scheduler_address) as dask_map,
    ):
        assert_equal(list(sketch_blocks(split_blocks(sequence, 0, 2)[:2], TASKS, dask_map)), serial[:2])


def test_no_scheduler_is_one_clear_error(monkeypatch):
    pytest.importorskip("distributed")
    monkeypatch.setattr("flowlik.calibration.executors.WAIT_S", 0.3)
    with pytest.raises(CalibrationError, match=r"no Dask scheduler answers at tcp://127\.0\.0\.1:9"):
        executor("dask", scheduler="tcp://127.0.0.1:9").__enter__()


def test_without_the_extra_its_name_is_told(monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(MissingExtraError, match=r"flowlik\[cluster\]"):
        executor("dask").__enter__()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"name": "threads"}, "known are serial, processes, dask"),
        ({"name": "processes", "scheduler": "tcp://a:1"}, "for the executor dask"),
        ({"name": "serial", "workers": 2}, "for local processes"),
        ({"name": "dask", "workers": 2, "scheduler": "tcp://a:1"}, "for local processes"),
        ({"name": "processes", "workers": 0}, "1 or more"),
    ],
)
def test_options_that_do_not_fit_together(options, message):
    with pytest.raises(DataError, match=message):
        executor(**options)


class Future:
    """A call that is made when its result is taken."""

    under_way, most = 0, 0

    def __init__(self, function, *items):
        self.call = lambda: function(*items)
        Future.under_way += 1
        Future.most = max(Future.most, Future.under_way)

    def result(self):
        Future.under_way -= 1
        return self.call()

    def cancel(self):
        Future.under_way -= 1


def test_few_blocks_are_under_way_however_many_there_are(monkeypatch):
    monkeypatch.setattr(
        "flowlik.calibration.executors._on_one_thread", lambda function, *items: function(*items)
    )
    taken = []

    def blocks():
        for i in range(1000):
            taken.append(i)
            yield i

    ordered = _bounded(Future, Future.result, AHEAD * 2)
    results = ordered(lambda i: -i, blocks())
    assert not taken
    assert next(results) == 0
    assert len(taken) <= AHEAD * 2 + 1
    assert list(results) == [-i for i in range(1, 1000)]
    assert Future.most == AHEAD * 2
    half = ordered(lambda i: -i, range(100))
    next(half)
    half.close()
    assert Future.under_way == 0


def test_any_order_of_merging_gives_the_same(serial):
    column = [found[0] for found in serial]
    assert_equal([[merge_all(column[::-1])]], [[merge_all(column)]])
