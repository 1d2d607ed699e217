"""Motions from LiDAR as depth on ten real frames: cars at a crossing, a lorry that passes on the right.

    python benchmarks/lidar_depth.py --data DATA/fusion/kitti_velodyne --out RUN [--models dis lucas-kanade]

There is no truth; but the car rolls at one speed, so that steps must be alike, and ahead. Beside it OpenCV's
PnP (RANSAC, 0.5 px) on the same vectors and depths. A step is *another's* where it is told without doubt
(solved) and goes backwards: it is the lorry's.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from flowlik.comparison.baselines import opencv_pnp
from flowlik.datasets import read_grey, read_kitti_lidar_place, read_velodyne
from flowlik.egomotion import EgoMotion, Status, lcmsac
from flowlik.flow import flow_method
from flowlik.fusion import LidarNoise, lidar_motion, lidar_residual, sparse_depth
from flowlik.geometry.camera import Pinhole
from flowlik.likelihood.model_file import load_likelihood
from flowlik.results.records import Record, protocol, write_records

# of P_rect_02
CAMERA = Pinhole(1242, 375, 721.5377, 721.5377, 609.5593, 172.854)
NOISE = LidarNoise(0.02, 1.0)
FRAMES = 10


def told(motion: EgoMotion) -> str:
    text = f"{motion.status.value} {-motion.T_k_prev.translation[2]:+.3f} m"
    if motion.alternative is not None:
        text += f" or {-motion.alternative.T_k_prev.translation[2]:+.3f} m"
    return text


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--data", type=Path, required=True)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--models", nargs="+", default=("dis", "lucas-kanade"))
    options = parser.parse_args()
    T_c_l = read_kitti_lidar_place(options.data)
    images = [read_grey(options.data / "image_02" / f"{k:010d}.png") for k in range(FRAMES)]
    sweeps = [read_velodyne(options.data / "velodyne_points" / f"{k:010d}.bin") for k in range(FRAMES - 1)]
    depths = [sparse_depth(points, T_c_l, CAMERA, NOISE) for points in sweeps]
    records: list[Record] = []
    for name in options.models:
        model = load_likelihood(name)
        estimator, method = lcmsac(model), flow_method(model.method or {})
        steps: dict[str, list[float]] = {"pnp": [], "exact depth": [], "depth that errs": []}
        sigma = []
        for k, depth in enumerate(depths):
            pair = images[k], images[k + 1]
            residual, _ = lidar_residual(*pair, depth, CAMERA, method, model)
            pnp = opencv_pnp(residual)
            exact = estimator.estimate(residual)
            wide = lidar_motion(*pair, depth, CAMERA, method, estimator)
            steps["pnp"].append(np.nan if pnp is None else -pnp.translation[2])
            for way, motion in (("exact depth", exact), ("depth that errs", wide)):
                if motion.status is Status.SOLVED:
                    steps[way].append(-motion.T_k_prev.translation[2])
            if wide.status is Status.SOLVED:
                sigma.append(np.sqrt(wide.covariance[5, 5]))
            texts = (
                f"PnP {steps['pnp'][-1]:+.3f} m; exact depth: {told(exact)}; depth that errs: {told(wide)}"
            )
            print(f"{name:13} {k}: {len(residual)} vectors, {texts}", flush=True)
        for way, values in steps.items():
            forward = [v for v in values if v > 0]
            wrong = sum(v < 0 for v in values)
            scatter = np.std(np.diff(forward)) / np.sqrt(2) if len(forward) > 2 else np.nan
            note = protocol(
                depth="velodyne", way=way, range_m=NOISE.range_m, misregistration_px=NOISE.misregistration_px
            )
            keys = (
                "kitti-velodyne",
                name,
                model.family.name,
                model.schedule.name,
                "lcmsac",
                FRAMES - 1,
                0,
                note,
            )
            for metric, value, unit in (
                ("solved_fraction", len(values) / (FRAMES - 1), ""),
                ("anothers_motion_fraction", wrong / (FRAMES - 1), ""),
                ("step_scatter_m", scatter, "m"),
            ):
                records.append(Record(metric, value, unit, *keys))
            counts = f"told {len(values)} of {FRAMES - 1}, another's {wrong}"
            print(f"{name:13} {way:15}: {counts}, steps scatter by {1e3 * scatter:.1f} mm")
        print(f"{name:13} stated sigma of a step {1e3 * np.median(sigma):.1f} mm")
    options.out.mkdir(parents=True, exist_ok=True)
    write_records(options.out / "metrics.json", records)


if __name__ == "__main__":
    main()
