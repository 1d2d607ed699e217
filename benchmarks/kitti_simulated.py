"""Drives simulated along KITTI's poses, the truth exact: estimators, covariance, wrong intrinsics."""

from __future__ import annotations

import argparse
from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import numpy as np

from flowlik.comparison import BASELINES, OURS, drive_figures, drive_records, run_drive
from flowlik.datasets.base import ImageSequence
from flowlik.flow import flow_method
from flowlik.geometry.camera import Distortion, Pinhole
from flowlik.likelihood.likelihood import FlowLikelihood
from flowlik.likelihood.model_file import load_likelihood
from flowlik.measurement.features import measure_features
from flowlik.measurement.measurements import Measurements
from flowlik.report import finish
from flowlik.results.records import Record, protocol, select
from flowlik.results.runs import RunFolder
from flowlik.simulation import SimulatedSequence, simulate
from flowlik.support.progress import terminal_progress
from pair_cache import PairCache

WRONG_CX_PX, WRONG_K1 = -4.0, -0.015
SHOWN = (
    "t_err_percent", "t_err_percent_low", "t_err_percent_high", "direction_error_median_mrad",
    "direction_error_worst_mrad", "rotation_error_median_mdeg", "split_half_direction_mrad",
)  # fmt: skip


class Rendered:
    """A simulated sequence whose last pictures are kept: every frame is asked for twice."""

    def __init__(self, sequence: ImageSequence, name: str) -> None:
        self.name, self._sequence = name, sequence
        self.image = lru_cache(2)(sequence.image)

    def __len__(self) -> int:
        return len(self._sequence)

    def __getattr__(self, name: str) -> object:
        return getattr(self._sequence, name)


def seen_by(m: Measurements, camera: Pinhole) -> Measurements:
    """Measurements as a camera with other intrinsics than `camera` would have made them."""
    other, distortion = replace(camera, cx=camera.cx + WRONG_CX_PX), Distortion(WRONG_K1)

    def seen(pixels: np.ndarray) -> np.ndarray:
        rays = camera.rays(pixels)
        rays[:, :2] = distortion.distort(rays[:, :2])
        return other.v2p(rays)

    begin, end = seen(m.pixels), seen(m.pixels + m.flow)
    return replace(m, pixels=begin, flow=end - begin)


def measured(
    sequence: ImageSequence, likelihood: FlowLikelihood, seed: int, cache: PairCache | None
) -> list[Measurements]:
    """Measurements of every pair, made once for both runs."""
    method, signals = flow_method(likelihood.method or {}), likelihood.schedule.index.signals

    def make(k: int) -> Measurements:
        images = sequence.image(k - 1), sequence.image(k)
        return measure_features(*images, method, likelihood.texture, seed + k, signals)

    pairs = terminal_progress(iter(range(1, len(sequence))), sequence.name, len(sequence) - 1)
    return [make(k) if cache is None else cache.get(k, lambda k=k: make(k)) for k in pairs]


def pair_cache(folder: Path, likelihood: FlowLikelihood, flight: SimulatedSequence, seed: int) -> PairCache:
    """Kept measurements of a flight."""
    plan = {
        "flight": flight.name, "begin_s": float(flight.times_s[0]), "world": flight.configuration_hash,
        "method": likelihood.method, "seed": seed,
        "texture": likelihood.texture.describe(), "signals": list(likelihood.signals),
    }  # fmt: skip
    return PairCache(folder, plan)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--kitti-poses", type=Path, required=True, help="folder of NN.txt")
    parser.add_argument("--model", type=Path, required=True, help="model calibrated in simulation")
    parser.add_argument("--sequences", nargs="+", default=["01", "04", "07"])
    parser.add_argument("--start", type=int, default=0, help="frames left out at the beginning")
    parser.add_argument("--frames", type=int, help="only the first so many")
    parser.add_argument("--traffic", type=int, default=20, help="moving vehicles")
    parser.add_argument("--seed", type=int, default=300, help="of world, traffic, sensor and samples")
    parser.add_argument("--ours-only", action="store_true", help="without the rivals")
    parser.add_argument("--cache", type=Path, help="folder that keeps the measurements of every pair")
    parser.add_argument("--measure-only", action="store_true", help="fill the cache, no estimator")
    parser.add_argument("--out", type=Path, required=True, help="run folder")
    options = parser.parse_args()

    likelihood = load_likelihood(options.model)
    config = {k: v.name if isinstance(v, Path) else v for k, v in vars(options).items()}
    run = RunFolder(options.out, "benchmarks/kitti_simulated", config, options.seed)
    for name in options.sequences:
        flight = simulate(
            "driving", options.kitti_poses / f"{name}.txt", options.frames, seed=options.seed,
            start=options.start, traffic=options.traffic,
        )  # fmt: skip
        sequence: ImageSequence = Rendered(flight, f"simulated/{name}")  # type: ignore[assignment]
        cache = options.cache and pair_cache(options.cache / name, likelihood, flight, options.seed)
        pairs = measured(sequence, likelihood, options.seed, cache)
        if options.measure_only:
            continue
        rows = tuple(OURS) if options.ours_only else (*OURS, *BASELINES)
        drive = run_drive(sequence, likelihood, seed=options.seed, names=rows, measured=pairs)
        run.records += drive_records(drive, exact=True)
        for kind, arrays in drive_figures(drive).items():
            run.save(kind, f"simulated-{name}", arrays)
        displaced = [seen_by(m, sequence.camera) for m in pairs]
        wrong = run_drive(sequence, likelihood, seed=options.seed, names=("nominal", "self-calibrated"),
                          measured=displaced)  # fmt: skip
        wrong.sequence = f"simulated/{name}-wrong-intrinsics"
        run.records += drive_records(wrong, exact=True)
        for kind, arrays in drive_figures(wrong).items():
            run.save(kind, f"simulated-{name}-wrong-intrinsics", arrays)
        run.records.append(recovered(run.records, sequence.name))
    if options.measure_only:
        return
    finish(run)
    for dataset in dict.fromkeys(r.dataset for r in run.records):
        rows_ = select(run.records, dataset=dataset)
        print(f"\n{dataset}")
        for estimator in dict.fromkeys(r.estimator for r in rows_):
            values = {m: select(rows_, estimator=estimator, metric=m) for m in SHOWN}
            cells = ["–" if not v or v[0].value is None else f"{v[0].value:.3f}" for v in values.values()]
            print(f"{estimator or '':<22}" + "".join(f"{cell:>10}" for cell in cells))
        for r in rows_:
            if "_coverage_" in r.metric or r.metric == "recovered_share":
                print(f"{r.estimator} {r.metric} {'–' if r.value is None else format(r.value, '.3f')}")


def recovered(records: list[Record], dataset: str) -> Record:
    """Share of what wrong intrinsics cost in `t_err_percent` that self-calibration gets back."""

    def t_err(dataset: str, estimator: str) -> float:
        (found,) = select(records, dataset=dataset, estimator=estimator, metric="t_err_percent")
        return np.nan if found.value is None else found.value

    right = t_err(dataset, "lcmsac-nominal")
    wrong, mended = (
        t_err(f"{dataset}-wrong-intrinsics", f"lcmsac-{row}") for row in ("nominal", "self-calibrated")
    )
    share = (wrong - mended) / (wrong - right)
    note = protocol(cx_px=WRONG_CX_PX, k1=WRONG_K1)
    value = float(share) if np.isfinite(share) else None
    return Record(
        "recovered_share", value, "", f"{dataset}-wrong-intrinsics", estimator="lcmsac-self-calibrated",
        protocol=note,
    )  # fmt: skip


if __name__ == "__main__":
    main()
