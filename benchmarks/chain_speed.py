"""The chain beside its flow: processor time from decoded images to a motion with covariance, and latency.

F is `cv2.calcOpticalFlowPyrLK` as the paper has it, 21 x 21 px, from the strongest 2000 corners, one way.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import cv2
import numpy as np

from calibration_plan import REPORT
from egomotion_speed import ToAndFro
from egomotion_variants import label
from flights import rendered
from flowlik.egomotion import KnownDepth, lcmsac
from flowlik.flow import flow_method
from flowlik.flow.base import DenseFlow
from flowlik.flow.lucas_kanade import LucasKanade, detect_corners
from flowlik.likelihood.model_file import load_likelihood
from flowlik.measurement.features import measure_features
from flowlik.odometry.loop import run_odometry
from flowlik.odometry.odometry import Odometry
from flowlik.results.records import Record, protocol
from flowlik.support import threads

FLIGHT = REPORT["other seed, 6 m/s"]
MODELS = ("lucas-kanade", "lucas-kanade-11", "lucas-kanade-lcm", "dis", "dis-lcm", "farneback")
PAIRS, CORNERS = 10, 2000
CORES = (1, 2)


@contextmanager
def on_cores(count: int) -> Iterator[None]:
    """Work on so many threads at most, OpenCV's and our own."""
    before = threads.THREADS, cv2.getNumThreads()
    threads.THREADS = count
    cv2.setNumThreads(count)
    try:
        yield
    finally:
        threads.THREADS = before[0]
        cv2.setNumThreads(before[1])


def _milliseconds(work: Callable[[], object]) -> float:
    start = time.process_time()
    work()
    return 1e3 * (time.process_time() - start)


def chain_over_flow(cache: Path, repeats: int) -> Iterator[Record]:
    """Processor time of chains over F, and of dense ones over their own flow, in turns on one thread.

    Of every image pair the least time of each counts: what else the machine does can only lengthen it.
    """
    runs = rendered(FLIGHT, cache, None)
    firsts = [k for block in runs.blocks(0) for k in block.firsts][:PAIRS]
    pairs = {k: (runs.image(k), runs.image(k + 1), runs.depth(k)) for k in firsts}
    paper = LucasKanade(solver="opencv")
    models = {name: load_likelihood(name) for name in MODELS}
    flows = {name: flow_method(model.method or {}) for name, model in models.items()}
    corners = {k: detect_corners(pairs[k][0])[:CORNERS] for k in firsts}

    def chain(name: str, k: int) -> None:
        previous, current, depth = pairs[k]
        model = models[name]
        m = measure_features(previous, current, flows[name], model.texture, k, model.signals)
        lcmsac(model).estimate(KnownDepth.of(m, runs.camera, depth), k)

    def flow(name: str, k: int) -> None:
        method = flows[name]
        if isinstance(method, DenseFlow):
            method.dense(*pairs[k][:2])
        else:
            paper.measure_at(*pairs[k][:2], corners[k])

    with on_cores(1):
        times = np.full((2, len(MODELS), len(firsts), repeats + 1), np.inf)
        for r in range(repeats + 1):
            for i, k in enumerate(firsts):
                for j, name in enumerate(MODELS):
                    times[0, j, i, r] = _milliseconds(lambda name=name, k=k: flow(name, k))
                    times[1, j, i, r] = _milliseconds(lambda name=name, k=k: chain(name, k))
    own, whole = times[..., 1:].min(axis=-1).mean(axis=-1)  # the first round compiles
    F = own[MODELS.index("lucas-kanade")]
    print(f"\nchains over F = {F:.2f} ms of processor time, {CORNERS} corners at most, one thread")
    for name, ms, forward in zip(MODELS, whole, own):
        print(
            f"{name:<18} {ms:7.2f} ms = {ms / F:5.2f} F = {ms / forward:5.2f} of {forward:.2f} ms", flush=True
        )
        note = protocol(
            model=name, estimator="lcmsac", threads=1, time="processor", statistic="least of each pair",
            chain_ms=f"{ms:.3f}", F_ms=f"{F:.3f}", own_flow_ms=f"{forward:.3f}",
        )  # fmt: skip
        keys = (FLIGHT.name, label(name.removesuffix("-lcm")), models[name].family.name)
        yield Record("chain_over_flow", ms / F, "", *keys, estimator="lcmsac", count=PAIRS, protocol=note)
        yield Record(
            "chain_over_own_flow", ms / forward, "", *keys, estimator="lcmsac", count=PAIRS, protocol=note
        )


def latency(cache: Path, frames: int) -> Iterator[Record]:
    """Time from a decoded image to its motion, a frame at a time, and frames a second of the loop."""
    flight = ToAndFro(rendered(FLIGHT, cache, None), frames)
    print(f"\nlatency of {frames} frames, and frames a second of the loop that measures ahead")
    for name in ("lucas-kanade", "lucas-kanade-11", "dis"):
        model = load_likelihood(name)
        for cores in CORES:
            with on_cores(cores):
                # what must be compiled is
                list(run_odometry(flight, _robot(flight, name), "depth", frames=8))
                robot, seconds = _robot(flight, name), []
                for k in range(frames):
                    image, depth = flight.image(k), flight.depth(k)
                    start = time.perf_counter()
                    robot.step(image, flight.timestamp(k), depth)
                    seconds.append(time.perf_counter() - start)
                start = time.perf_counter()
                solved = sum(motion.solved for motion in run_odometry(flight, _robot(flight, name), "depth"))
                rate = solved / (time.perf_counter() - start)
            median, most = 1e3 * np.quantile(seconds[1:], [0.5, 0.99])
            print(
                f"{name:<18} {cores} cores: {median:6.1f} ms, 99 %: {most:6.1f} ms; {rate:5.1f} frames/s",
                flush=True,
            )
            note = protocol(model=name, estimator="lcmsac", threads=cores, images="decoded")
            keys = (FLIGHT.name, label(name), model.family.name, model.schedule.name, "lcmsac", frames - 1, 0)
            yield Record("latency_ms", float(median), "ms", *keys, f"{note}; quantile=0.5")
            yield Record("latency_ms", float(most), "ms", *keys, f"{note}; quantile=0.99")
            yield Record("frames_per_second", rate, "1/s", *keys, f"{note}; of=the loop")


def _robot(flight: ToAndFro, name: str) -> Odometry:
    model = load_likelihood(name)
    return Odometry(flight.camera, flow_method(model.method or {}), lcmsac(model))
