"""Monocular ego-motion on a KITTI odometry clip: flowlik, OpenCV and PoseLib on the same tracks."""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
from scipy.spatial.transform import RigidTransform

from flowlik.datasets import open_sequence
from flowlik.egomotion import Epipolar, lcmsac, mle, ransac
from flowlik.evaluation.baselines import opencv_essential, poselib_relative
from flowlik.evaluation.motion_records import trajectory_records, true_trajectory
from flowlik.flow import flow_method
from flowlik.model_file import load_likelihood
from flowlik.odometry import features_of, measure_features, scaled
from flowlik.records import Record, select, write_records
from flowlik.scale import true_distance
from flowlik.trajectory import Trajectory, chain

SHOWN = ("t_err_percent", "t_err_offset_removed_percent", "r_err_deg_per_100m")
Solver = Callable[[Epipolar, int], RigidTransform | None]


def shuffled(residual: Epipolar, order: int) -> Epipolar:
    """The same matches in another order: OpenCV's sampling depends on it and on nothing else."""
    permutation = np.random.default_rng(order).permutation(len(residual))
    return Epipolar.of(residual.measurements.select(permutation), residual.camera)


def solvers(model: Path, orders: int) -> dict[str, Solver]:
    likelihood = load_likelihood(model)
    found: dict[str, Solver] = {}
    for estimator in (ransac(), lcmsac(likelihood), mle(likelihood)):
        found[estimator.name] = lambda r, k, e=estimator: e.estimate(r, seed=k).T_k_prev
    found["opencv-ransac"] = lambda r, k: opencv_essential(r)
    for order in range(1, orders):
        found[f"opencv-ransac-order{order}"] = lambda r, k, o=order: opencv_essential(shuffled(r, o))
    found["opencv-magsac"] = lambda r, k: opencv_essential(r, flag=cv2.USAC_MAGSAC)
    found["poselib"] = lambda r, k: poselib_relative(r)
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--data", type=Path, required=True, help="folder of a KITTI odometry sequence")
    parser.add_argument("--model", type=Path, required=True, help="model calibrated in simulation")
    parser.add_argument("--frames", type=int, help="only the first so many")
    parser.add_argument("--orders", type=int, default=9, help="orders of the matches given to OpenCV")
    parser.add_argument("--out", type=Path, help="folder for metrics.json")
    options = parser.parse_args()

    sequence = open_sequence(options.data, "kitti")
    count = min(options.frames or len(sequence), len(sequence))
    truth = true_trajectory(sequence, count)
    assert truth is not None
    likelihood = load_likelihood(options.model)
    method = flow_method(likelihood.method or {})
    found = solvers(options.model, options.orders)
    steps: dict[str, list[RigidTransform]] = {name: [] for name in found}
    seconds = dict.fromkeys(found, 0.0)
    for k in range(1, count):
        m = measure_features(sequence.image(k - 1), sequence.image(k), method, likelihood.texture)
        residual = Epipolar.of(m, sequence.camera)
        for name, solve in found.items():
            start = time.perf_counter()
            motion = solve(residual, k)
            seconds[name] += time.perf_counter() - start
            steps[name].append(
                RigidTransform.identity() if motion is None else scaled(motion, true_distance(sequence, k))
            )

    records: list[Record] = []
    keys = {
        "residual": "epipolar",
        "scale": "truth-norm",
        "boresight": "none",
        "features": features_of(method),
    }
    print(f"{sequence.name}, {count} frames, {truth.length:.1f} m, scale truth-norm, no alignment")
    print(
        f"{'estimator':<24} {'t_err %':>8} {'offset removed %':>17} {'r_err deg/100 m':>16} {'ms/frame':>9}"
    )
    for name, moves in steps.items():
        estimated = Trajectory(truth.timestamps, chain(moves))
        rows = trajectory_records(estimated, truth, sequence.name, method.name, estimator=name, **keys)
        records += rows
        values = [select(rows, metric=metric)[0].value for metric in SHOWN]
        cells = ["–" if value is None else f"{value:.3f}" for value in values]
        print(f"{name:<24} {cells[0]:>8} {cells[1]:>17} {cells[2]:>16} {1e3 * seconds[name] / count:9.1f}")
    for metric in SHOWN[:2]:
        values = [r.value for r in select(records, metric=metric) if r.estimator.startswith("opencv-ransac")]
        if None not in values:
            low, middle, high = np.percentile(values, [0, 50, 100])
            print(f"opencv-ransac over {len(values)} orders, {metric}: {low:.3f} … {middle:.3f} … {high:.3f}")
    if options.out:
        write_records(options.out / "metrics.json", records)


if __name__ == "__main__":
    main()
