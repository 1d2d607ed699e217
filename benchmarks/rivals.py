"""Every related system's error model, calibrated on the same errors and scored on the same real pairs.

    python benchmarks/rivals_rows.py --cache FLIGHTS --rows ROWS --data DATA --methods lucas-kanade-11 dis ...
    python benchmarks/rivals.py --rows ROWS --out RUN [--methods lucas-kanade-11 dis farneback]

All learn from vectors of the standard flights and are tried on real pairs. `docs/rivals.md` says how each row
is realised. Scores are a vector's: densities of both components, which do not depend on the axes.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path

import numpy as np

from calibration_plan import CALIBRATION
from flowlik.results.records import Record, protocol, write_records
from rivals_models import RIVALS, Rival
from rivals_rows import REAL, Rows

CONFIDENCES = (0.5, 0.9)
REPLICATES = 200
VECTORS = 1200
"""Vectors of a flight that are learned from; flights count alike."""

LEVELS = np.logspace(-2, 5, 29)
LEAST = 200
GRID_PX = np.logspace(-3, 2.5, 45)


def figures(rival: Rival, rows: Rows) -> dict[str, float]:
    """Figures of an error model on one source."""
    found = rival.predict(rows)
    magnitude = np.abs(found.errors)
    result = {
        "nll_joint": -float(found.log_prob.mean()),
        "nll": -float(found.log_prob.mean()) / 2,
    }
    for confidence in CONFIDENCES:
        inside = found.cdf(magnitude) <= confidence
        result[f"coverage_{100 * confidence:.0f}"] = float(inside.mean())
    result["ks_median"] = _ks_median(found.cdf, found.errors, found.texture)
    result["ause_relative"] = _ause(magnitude, found.spread)
    return result


def interval(rival: Rival, rows: Rows, rng: np.random.Generator) -> tuple[float, float]:
    """Central 95 % of the score under a bootstrap over blocks of an image: pairs, or its parts where few."""
    score = -rival.predict(rows).log_prob / 2
    blocks = np.array_split(score, 20)
    sums, sizes = np.array([b.sum() for b in blocks]), np.array([len(b) for b in blocks])
    chosen = rng.integers(len(blocks), size=(REPLICATES, len(blocks)))
    means = sums[chosen].sum(axis=1) / sizes[chosen].sum(axis=1)
    low, high = np.quantile(means, [0.025, 0.975])
    return float(low), float(high)


def _ks_median(cdf: Callable[[np.ndarray], np.ndarray], errors: np.ndarray, texture: np.ndarray) -> float:
    """Median over texture levels of the distance between found and predicted distributions of abs(z)."""
    level = np.digitize(texture, LEVELS)
    predicted = np.stack([cdf(np.full(errors.shape, m)) for m in GRID_PX])
    found = np.abs(errors)[None] <= GRID_PX[:, None, None]
    distances = []
    for one in np.unique(level):
        inside = level == one
        if inside.sum() >= LEAST:
            distances.append(
                np.abs((found[:, inside]).mean(axis=1) - predicted[:, inside].mean(axis=1)).max()
            )
    return float(np.median(distances)) if distances else float("nan")


def _ause(magnitude: np.ndarray, spread: np.ndarray) -> float:
    """Area between sparsification by a model's spread and by the error, over that between none and this."""
    error, wide = np.linalg.norm(magnitude, axis=1), np.linalg.norm(spread, axis=1)
    left = np.arange(len(error), 0, -1)

    def curve(order: np.ndarray) -> np.ndarray:
        return np.cumsum(error[order])[::-1] / left

    # what a model does not tell apart is in random order
    order = np.lexsort((np.random.default_rng(0).random(len(wide)), wide))
    oracle, own = curve(np.argsort(error)), curve(order)
    return float((own - oracle).sum() / (error.mean() - oracle).sum())


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--rows", type=Path, required=True, help="what rivals_rows.py wrote")
    parser.add_argument("--out", type=Path, help="folder for metrics.json")
    parser.add_argument("--methods", nargs="+", default=["lucas-kanade-11", "dis", "farneback"])
    options = parser.parse_args()
    records = []
    for method in options.methods:
        folder = options.rows / method
        flights = [f.name for f in CALIBRATION if (folder / f"{f.name}.npz").is_file()]
        learned = {name: Rows.load(folder / f"{name}.npz").finite().some(VECTORS) for name in flights}
        print(f"{method}: {len(flights)} flights, {sum(len(r.flow) for r in learned.values())} vectors")
        real = {n: Rows.load(folder / f"{n}.npz").finite() for n in REAL if (folder / f"{n}.npz").is_file()}
        for name, make in RIVALS.items():
            rival = make(learned, method)
            if rival is None:
                continue
            for source, rows in real.items():
                low, high = interval(rival, rows, np.random.default_rng(0))
                note = protocol(
                    row=name, split="other data", flights=len(flights), vectors=len(rows.flow),
                    nll_interval_95=f"{low:.3f} … {high:.3f}",
                )  # fmt: skip
                found = figures(rival, rows)
                for metric, value in found.items():
                    unit = "nat" if metric.startswith("nll") else ""
                    records.append(
                        Record(metric, value, unit, source, method, rival.family, rival.schedule, None,
                               len(rows.flow), 0, note)
                    )  # fmt: skip
                shown = "  ".join(f"{metric} {value:.3f}" for metric, value in found.items())
                print(f"{method:<16} {source:<22} {name:<34} {shown}", flush=True)
    if options.out:
        options.out.mkdir(parents=True, exist_ok=True)
        write_records(options.out / "metrics.json", records)


if __name__ == "__main__":
    main()
