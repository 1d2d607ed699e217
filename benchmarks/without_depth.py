"""Motions without depth by the model of both components, by that of errors across lines, and by PoseLib.

    python benchmarks/without_depth.py --part judge --kitti KITTI --cache CACHE --kitti-poses POSES --out RUN

Noise of split halves, which share neither start nor samples, and errors against exact truth on simulated
drives; beside every figure the interval of its ratio to the former default's, over blocks of ten pairs.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import RigidTransform

from flights import Flight, rendered
from flowlik.comparison.baselines import poselib_relative
from flowlik.datasets import open_sequence
from flowlik.egomotion import Epipolar, Estimator, lcmsac, mle
from flowlik.evaluation.motion.split_half import (
    difference_covariance,
    direction_errors_mrad,
    half_coverage,
    half_distances,
    truth_distances,
)
from flowlik.flow import flow_method
from flowlik.geometry.camera import Pinhole
from flowlik.likelihood.model_file import load_likelihood
from flowlik.measurement.features import measure_features
from flowlik.measurement.halves import halves
from flowlik.measurement.measurements import Measurements
from flowlik.report import finish
from flowlik.results.records import Record, protocol
from flowlik.results.runs import RunFolder

DRIVING = "driving"
PARTS = {
    "develop": (
        ("KITTI/03 0-149", "03", range(149)),
        ("along 05", Flight(DRIVING, "05", 0.0, 208, 12, 5, "truthless"), None),
        ("along 10", Flight(DRIVING, "10", 0.0, 20, 7, 3), None),
    ),
    "judge": (
        ("KITTI/03 150-299", "03", range(150, 299)),
        ("along 07", Flight(DRIVING, "07", 0.0, 307, 10, 5, "truthless"), None),
        ("along 04", Flight(DRIVING, "04", 0.0, 14, 7, 3), None),
    ),
    "motorway": (
        ("along 01", Flight(DRIVING, "01", 0.0, 11, 7, 3), None),
        ("KITTI/01 0-50", "01", range(50)),
    ),
}  # fmt: skip
CAUCHY_PX = (0.03, 0.05, 0.1, 0.15)
BASE = ("lcmsac", "both components")
BLOCK, DRAWS = 10, 2000


class Seen(NamedTuple):
    """Corners of one pair, the camera, and the true motion where it is exact."""

    measurements: Measurements
    camera: Pinhole
    truth: RigidTransform | None


class Solved(NamedTuple):
    """Motions of both halves and of all vectors, and the squared distance of the halves where it is told."""

    halves: tuple[RigidTransform, RigidTransform]
    whole: RigidTransform | None
    distance: float
    truth_distance: float


def seen(source: str | Flight, firsts: range | None, options: argparse.Namespace) -> Iterator[Seen]:
    """Pairs of a part."""
    both = load_likelihood(options.model)
    across = load_likelihood(options.across or options.model, "epipolar")
    method = flow_method(both.method or {})
    signals = tuple(sorted({*both.signals, *across.signals}))
    if isinstance(source, Flight):
        folder = next(c for c in options.cache if (c / f"{source.name}.npz").is_file())
        sequence = rendered(source, folder, options.kitti_poses)
        frames = [k for block in sequence.blocks(source.seed) for k in block.firsts]
    else:
        sequence = open_sequence(options.kitti / source)
        frames = list(firsts or ())
    for k in frames:
        images = sequence.image(k), sequence.image(k + 1)
        m = measure_features(*images, method, both.texture, options.seed + k, signals)
        exact = isinstance(source, Flight)
        yield Seen(m, sequence.camera, sequence.T_n_c(k + 1).inv() * sequence.T_n_c(k) if exact else None)


def by_estimator(estimator: Estimator, pair: Seen, seed: int) -> Solved | None:
    """Motions of a pair; None unless both halves are solved."""
    m = pair.measurements
    parts = [Epipolar.of(m.select(half), pair.camera) for half in halves(m.pixels)]
    found = [estimator.estimate(part, seed) for part in parts]
    if not all(motion.solved for motion in found):
        return None
    covariance = difference_covariance(estimator, parts, found)
    distance = float(half_distances(found[:1], found[1:], [covariance])[0])
    T, off = None, np.nan
    if pair.truth is not None:
        whole = estimator.estimate(Epipolar.of(m, pair.camera), seed)
        if whole.solved:
            T, off = whole.T_k_prev, float(truth_distances([whole], [pair.truth])[0])
    return Solved((found[0].T_k_prev, found[1].T_k_prev), T, distance, off)


def by_poselib(cauchy_px: float, pair: Seen) -> Solved | None:
    """Motions of a pair by PoseLib."""
    m = pair.measurements
    parts = [m.select(half) for half in halves(m.pixels)]
    first, second = (poselib_relative(Epipolar.of(p, pair.camera), cauchy_px=cauchy_px) for p in parts)
    if first is None or second is None:
        return None
    whole = None if pair.truth is None else poselib_relative(Epipolar.of(m, pair.camera), cauchy_px=cauchy_px)
    return Solved((first, second), whole, np.nan, np.nan)


def figures(solved: list[Solved], truth: list[RigidTransform | None]) -> dict[str, np.ndarray]:
    """Figures of pairs (K,) or (K, 3) whose medians, over a constant, are the metrics."""
    first, second = (RigidTransform.concatenate([s.halves[i] for s in solved]) for i in (0, 1))
    ways = [np.atleast_2d(T.inv().translation) for T in (first, second)]
    unit = [way / np.linalg.norm(way, axis=1, keepdims=True) for way in ways]
    turn = np.rad2deg((first.rotation * second.rotation.inv()).as_rotvec())
    found = {
        "split_half_direction_mrad": 1000 / (2 * 1.177) * np.linalg.norm((unit[0] - unit[1])[:, :2], axis=1),
        "split_half_rotation_mdeg": 1000 / (2 * 0.6745) * np.abs(turn),
    }
    if all(s.whole is not None and T is not None for s, T in zip(solved, truth)):
        whole = RigidTransform.concatenate([s.whole for s in solved if s.whole is not None])
        true = RigidTransform.concatenate([T for T in truth if T is not None])
        found["direction_error_median_mrad"] = direction_errors_mrad(whole, true)
        off = np.rad2deg((whole.rotation * true.rotation.inv()).as_rotvec())
        found["rotation_error_median_mdeg"] = 1000 * np.linalg.norm(off, axis=1)
    return found


def ratio(ours: np.ndarray, base: np.ndarray, seed: int) -> tuple[float, float]:
    """Bounds of 90 % of the ratio of medians, blocks of neighbouring pairs drawn with both."""
    count = int(np.ceil(len(ours) / BLOCK))
    rng, ratios = np.random.default_rng(seed), []
    for _ in range(DRAWS):
        starts = BLOCK * rng.integers(count, size=count)
        rows = np.concatenate([np.arange(s, min(s + BLOCK, len(ours))) for s in starts])
        ratios.append(np.median(ours[rows]) / np.median(base[rows]))
    low, high = np.quantile(ratios, [0.05, 0.95])
    return float(low), float(high)


def judge(name: str, pairs: list[Seen], options: argparse.Namespace, run: RunFolder) -> None:
    """Figures of one drive."""
    both = load_likelihood(options.model)
    across = load_likelihood(options.across or options.model, "epipolar")
    models = {"both components": both, "across lines": across}
    solved: dict[tuple[str, str], list[Solved | None]] = {}
    for label, model in models.items():
        for estimator in (lcmsac(model), mle(model)):
            solved[estimator.name, label] = [by_estimator(estimator, p, options.seed) for p in pairs]
    for scale in CAUCHY_PX:
        solved[f"poselib-cauchy-{scale:g}", ""] = [by_poselib(scale, p) for p in pairs]
    common = [k for k in range(len(pairs)) if all(rows[k] is not None for rows in solved.values())]
    truth = [pairs[k].truth for k in common]
    kept = {key: [s for k in common if (s := rows[k]) is not None] for key, rows in solved.items()}
    base = figures(kept[BASE], truth)
    for (estimator_name, label), rows in kept.items():
        line = []
        for metric, values in figures(rows, truth).items():
            low, high = ratio(values, base[metric], options.seed)
            note = protocol(
                model=label or None, halves="64 px chessboard", start="none", features="corners",
                ratio_to="lcmsac, both components", ratio_low=f"{low:.3f}", ratio_high=f"{high:.3f}",
            )  # fmt: skip
            unit = "mrad" if metric.endswith("mrad") else "0.001 deg"
            value = float(np.median(values))
            record(run, metric, value, unit, name, options, estimator_name, len(rows), note)
            line.append(f"{value:.3f} ({100 * low - 100:+.0f}..{100 * high - 100:+.0f} %)")
        for kind in ("distance", "truth_distance"):
            d = np.array([getattr(s, kind) for s in rows])
            if np.isfinite(d).all():
                held = {c: half_coverage(d, c / 100) for c in (50, 90, 95)}
                note = protocol(model=label, halves="64 px chessboard" if kind == "distance" else None)
                start = "split_half_coverage" if kind == "distance" else "motion_coverage"
                for c, value in held.items():
                    record(run, f"{start}_{c}", value, "", name, options, estimator_name, len(d), note)
                line.append("/".join(f"{100 * v:.0f}" for v in held.values()))
        print(f"{name:<18} {len(rows):>4} {estimator_name:<20} {label:<16}", "  ".join(line), flush=True)


def record(
    run: RunFolder, metric: str, value: float, unit: str, name: str, options: argparse.Namespace,
    estimator: str, count: int, note: str,
) -> None:  # fmt: skip
    run.records.append(
        Record(metric, value, unit, name, options.model, None, None, estimator, count, options.seed, note)
    )


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--part", nargs="+", choices=PARTS, default=["judge"])
    parser.add_argument("--kitti", type=Path, required=True, help="folder of KITTI's sequences, NN each")
    parser.add_argument("--cache", type=Path, nargs="+", required=True, help="rendered flights")
    parser.add_argument("--kitti-poses", type=Path, required=True, help="folder of NN.txt")
    parser.add_argument("--model", default="lucas-kanade-11", help="shipped model")
    parser.add_argument("--across", help="model of errors across lines, instead of the shipped one")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path, required=True, help="run folder")
    options = parser.parse_args()
    run = RunFolder(
        options.out, "benchmarks/without_depth", {"model": options.model, "parts": options.part}, options.seed
    )
    for part in options.part:
        for name, source, firsts in PARTS[part]:
            judge(name, list(seen(source, firsts, options)), options, run)
    finish(run)


if __name__ == "__main__":
    main()
