"""Speed: estimation alone against OpenCV and PoseLib on the same points; whole chains in frames a second."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import cv2
import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from calibration_plan import REPORT
from egomotion_variants import (
    RADIUS_PX,
    label,
    residuals_of_flight,
    texture_model,
    translation_error,
    variants,
)
from flights import Runs, rendered
from flowlik.comparison.baselines import Pnp
from flowlik.egomotion import Estimator, KnownDepth, lcmsac, mle, ransac
from flowlik.egomotion import estimator as estimator_module
from flowlik.flow import flow_method
from flowlik.flow.base import DenseFlow
from flowlik.flow.lucas_kanade import detect_corners
from flowlik.likelihood.model_file import load_likelihood
from flowlik.measurement.features import measure_features
from flowlik.odometry.loop import run_odometry
from flowlik.odometry.odometry import Odometry
from flowlik.results.records import Record, protocol
from timing import processor_times

FLIGHT = REPORT["other seed, 6 m/s"]
CAP = 200
INLIER_SHARES = (0.9, 0.7, 0.5)
OUTLIER_PX = 20.0
STAGES = {
    "sample, propose, count": (estimator_module, "consensus"),
    "refine": (estimator_module, "refine"),
    "moments of the score": (estimator_module, "score_moments"),
}

Timed = dict[str, Callable[[], object]]


def estimation(cache: Path, pairs: int, repeats: int) -> Iterator[Record]:
    """Processor time of estimates alone, and their accuracy, where a share of vectors is replaced."""
    rng = np.random.default_rng(0)
    found = residuals_of_flight(FLIGHT, "lucas-kanade", cache)[:pairs]
    rivals = variants("lucas-kanade", cache).rivals
    texture, index = texture_model("lucas-kanade"), load_likelihood("lucas-kanade")
    ours = [ransac(RADIUS_PX), lcmsac(texture), mle(texture)]
    ours += [replace(lcmsac(index), name="lcmsac-index"), replace(mle(index), name="mle-index")]
    ours = [replace(e, most_hypotheses=CAP) for e in ours]
    vectors = np.mean([len(r) for r, _ in found])
    print(f"\nestimation alone, {vectors:.0f} vectors: processor ms (median) and translation error")
    for share in INLIER_SHARES:
        spoilt = [(_spoilt(r, share, rng), T) for r, T in found]
        work = {e.name: _estimates(e, spoilt) for e in ours}
        work["opencv-ransac, no refinement"] = lambda spoilt=spoilt: [_plain_opencv(r) for r, _ in spoilt]
        everyone = {"opencv-ransac": Pnp(), "poselib-truncated": Pnp("poselib-truncated")}
        everyone |= {f"{library}, best ({r.name})": r for library, r in rivals.items()}
        for name, rival in everyone.items():
            capped = replace(rival, iterations=CAP, confidence=0.99)
            work[name] = lambda spoilt=spoilt, capped=capped: [capped(r) for r, _ in spoilt]
        times = processor_times(work, repeats)
        for name, run in work.items():
            errors = 1e3 * np.median([translation_error(m, T) for m, (_, T) in zip(run(), spoilt)])
            ms = float(np.median(times[name])) / len(spoilt)
            ratios = [
                float(np.median(times[name] / times[o])) for o in ("opencv-ransac", "poselib-truncated")
            ]
            print(
                f"{share:4.0%} inliers  {name:<36} {ms:8.2f} ms  {errors:8.3f} mm"
                f"   x opencv {ratios[0]:5.2f}   x poselib {ratios[1]:5.2f}", flush=True,
            )  # fmt: skip
            note = protocol(
                inliers=share, cap=CAP, confidence=0.99, pairs=len(spoilt), time="processor",
                error_mm=f"{errors:.4f}", to_opencv=f"{ratios[0]:.3f}", to_poselib=f"{ratios[1]:.3f}",
            )  # fmt: skip
            yield Record(
                "estimation_ms", ms, "ms", FLIGHT.name, "lucas-kanade", estimator=name, protocol=note
            )
        for estimator in ours:
            yield from _stages(estimator, spoilt, share)


def _estimates(estimator: Estimator, pairs: list) -> Callable[[], object]:
    def run() -> list:
        # a fresh residual: an old one keeps its coordinates
        fresh = [KnownDepth(r.measurements, r.camera, r.rho) for r, _ in pairs]
        return [estimator.estimate(r, 0).T_k_prev for r in fresh]

    return run


def _stages(estimator: Estimator, pairs: list, share: float) -> Iterator[Record]:
    with _clocked() as spent:
        for residual, _ in pairs:
            estimator.estimate(KnownDepth(residual.measurements, residual.camera, residual.rho), 0)
    spent["rest"] = spent.pop("estimate") - sum(spent[s] for s in STAGES)
    ms = {stage: 1e3 * seconds / len(pairs) for stage, seconds in spent.items()}
    print(f"{share:4.0%} inliers  {estimator.name:<16} " + ", ".join(f"{s} {t:.2f}" for s, t in ms.items()))
    for stage, value in ms.items():
        note = protocol(inliers=share, cap=CAP, stage=stage, time="processor")
        yield Record(
            "estimation_stage_ms",
            value,
            "ms",
            FLIGHT.name,
            "lucas-kanade",
            estimator=estimator.name,
            protocol=note,
        )


@contextmanager
def _clocked() -> Iterator[dict[str, float]]:
    """Processor seconds of an estimator's stages while inside."""
    spent = {"estimate": 0.0, **dict.fromkeys(STAGES, 0.0)}
    places = {"estimate": (Estimator, "estimate"), **STAGES}
    originals = {stage: getattr(owner, name) for stage, (owner, name) in places.items()}

    def timed(stage: str, original: Callable) -> Callable:
        def run(*args: object, **keys: object) -> object:
            start = time.process_time()
            try:
                return original(*args, **keys)
            finally:
                spent[stage] += time.process_time() - start

        return run

    for stage, (owner, name) in places.items():
        setattr(owner, name, timed(stage, originals[stage]))
    try:
        yield spent
    finally:
        for stage, (owner, name) in places.items():
            setattr(owner, name, originals[stage])


def _spoilt(residual: KnownDepth, share: float, rng: np.random.Generator) -> KnownDepth:
    """All but a share of the vectors replaced by ones up to 20 px away; their signals do not know it."""
    m = residual.measurements
    wrong = rng.random(len(m)) >= share
    flow = m.flow + np.where(wrong[:, None], rng.uniform(-OUTLIER_PX, OUTLIER_PX, m.flow.shape), 0.0)
    return KnownDepth(replace(m, flow=flow), residual.camera, residual.rho)


def _plain_opencv(residual: KnownDepth) -> RigidTransform | None:
    m = residual.measurements
    points = residual.camera.p2v(m.pixels) / residual.rho[:, None]
    found, rotation, translation, _ = cv2.solvePnPRansac(
        points, m.pixels + m.flow, residual.camera.K, None, iterationsCount=CAP, reprojectionError=RADIUS_PX,
        confidence=0.99,
    )  # fmt: skip
    if not found:
        return None
    return RigidTransform.from_components(translation.ravel(), Rotation.from_rotvec(rotation.ravel()))


def chains(cache: Path, repeats: int) -> Iterator[Record]:
    """Frames a second from decoded images to a motion with covariance, and what takes the time."""
    runs = rendered(FLIGHT, cache, None)
    firsts = [k for block in runs.blocks(0) for k in block.firsts][:10]
    print(f"\nwhole chains at {runs.camera.width}x{runs.camera.height}: ms a frame (median), shares")
    for method, models in (
        ("lucas-kanade", ("lucas-kanade-lcm", "lucas-kanade")),
        ("farneback", ("farneback-lcm", "farneback")),
        ("dis", ("dis-lcm", "dis")),
    ):
        for model in models:
            yield from _chain(runs, firsts, method, model, repeats)


def _chain(runs: Runs, firsts: list[int], method: str, model: str, repeats: int) -> Iterator[Record]:
    likelihood = load_likelihood(model)
    flow = flow_method(likelihood.method or {})
    estimator = lcmsac(likelihood)
    images = {k: runs.image(k) for first in firsts for k in (first, first + 1)}
    depths = {k: runs.depth(k) for k in firsts}
    wall = {name: [] for name in ("detection", "flow", "measure", "estimate", "whole")}
    cpu = {name: [] for name in wall}
    for repeat in range(repeats + 1):
        for k in firsts:
            pair = images[k], images[k + 1]
            marks = [_now()]
            if not isinstance(flow, DenseFlow):
                detect_corners(pair[0])
            marks.append(_now())
            flow.dense(*pair) if isinstance(flow, DenseFlow) else flow.measure(*pair)
            marks.append(_now())
            m = measure_features(*pair, flow, likelihood.texture, k, likelihood.signals)
            marks.append(_now())
            estimator.estimate(KnownDepth.of(m, runs.camera, depths[k]), k)
            marks.append(_now())
            if repeat:  # the first round warms up
                for times, of in ((wall, 0), (cpu, 1)):
                    d, f, a, e = (b[of] - a[of] for a, b in pairwise(marks))
                    for name, value in zip(times, (d, f - d, a, e, a + e)):
                        times[name].append(1e3 * value)
    ms = {name: float(np.median(values)) for name, values in wall.items()}
    busy = {name: float(np.median(values)) for name, values in cpu.items()}
    for times in (ms, busy):
        times["texture and signals"] = times["measure"] - times["detection"] - times["flow"]
    share = (busy["detection"] + busy["flow"]) / busy["whole"]
    parts = ("detection", "flow", "texture and signals", "estimate")
    print(
        f"{model:<18} {ms['whole']:7.2f} ms = {1e3 / ms['whole']:6.1f} frames/s; "
        f"processor {busy['whole']:6.2f} ms: " + ", ".join(f"{part} {busy[part]:.2f}" for part in parts)
        + f"; flow's share {share:.0%}", flush=True,
    )  # fmt: skip
    note = protocol(
        model=model, estimator="lcmsac", threads=cv2.getNumThreads(), images="decoded",
        flow_share=f"{share:.3f}",
        **{f"processor_{n.replace(' ', '_')}_ms": f"{v:.2f}" for n, v in busy.items()},
    )  # fmt: skip
    yield Record(
        "frames_per_second", 1e3 / ms["whole"], "1/s", FLIGHT.name, label(method), likelihood.family.name,
        likelihood.schedule.name, "lcmsac", len(firsts) * repeats, 0, note,
    )  # fmt: skip


class ToAndFro:
    """Decoded frames of one run, played to and fro: neighbours stay neighbours, for as long as wanted."""

    def __init__(self, runs: Runs, frames: int) -> None:
        self.name, self.camera, self._frames = runs.name, runs.camera, frames
        self._images = [runs.image(k) for k in range(runs.run)]
        self._depths = [runs.depth(k) for k in range(runs.run)]

    def __len__(self) -> int:
        return self._frames

    def _k(self, k: int) -> int:
        last = len(self._images) - 1
        return last - abs(k % (2 * last) - last)

    def image(self, k: int) -> np.ndarray:
        return self._images[self._k(k)]

    def depth(self, k: int) -> np.ndarray:
        return self._depths[self._k(k)]

    def timestamp(self, k: int) -> float:
        return k / 60


def loop(cache: Path, repeats: int) -> Iterator[Record]:
    """Frames a second of `run_odometry`, which measures one pair while it estimates the last."""
    flight = ToAndFro(rendered(FLIGHT, cache, None), 60)
    print("\nloop over decoded images, the next pair's flow beside the last one's estimate")
    for model in ("lucas-kanade-lcm", "lucas-kanade", "dis-lcm", "dis", "farneback-lcm", "farneback"):
        likelihood = load_likelihood(model)
        method = flow_method(likelihood.method or {})
        rates = []
        for _ in range(repeats + 1):
            robot = Odometry(flight.camera, method, lcmsac(likelihood))
            start = time.perf_counter()
            solved = sum(motion.solved for motion in run_odometry(flight, robot, "depth"))
            rates.append((len(flight) - 1) / (time.perf_counter() - start))
            assert solved == len(flight) - 1
        rate = float(np.median(rates[1:]))
        print(f"{model:<18} {rate:6.1f} frames/s", flush=True)
        yield Record(
            "loop_frames_per_second", rate, "1/s", FLIGHT.name, label(method.name), likelihood.family.name,
            likelihood.schedule.name, "lcmsac", len(flight) * repeats, 0,
            protocol(model=model, threads=cv2.getNumThreads(), images="decoded"),
        )  # fmt: skip


def _now() -> tuple[float, float]:
    return time.perf_counter(), time.process_time()
