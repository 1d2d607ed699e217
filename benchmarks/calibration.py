"""Calibration, measured: in sample, held out, on real images; every family x schedule x flow in one table.

    python benchmarks/calibration.py --out RUN --cache CACHE [--data DATA] [--methods ...] [--quick]

CACHE keeps rendered flights and sketches (`benchmarks/calibration_plan.py` says which). Real images come from
DATA (layouts as `docs/datasets.md` has them); models are calibrated in simulation alone.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from calibration_plan import CALIBRATION, REPORT, strict
from flights import Flight, errors_of
from flowlik.calibration import (
    FLOW_INDEX,
    ErrorSketch,
    Task,
    fit_likelihood,
    index_form,
    merge_all,
    schedule_index,
    sketch_blocks,
    split_blocks,
)
from flowlik.datasets import open_sequence
from flowlik.datasets.base import ImageSequence
from flowlik.evaluation.likelihood import (
    CONFIDENCES,
    Counting,
    coverage,
    held_out_floor,
    kolmogorov_smirnov,
    levels,
    negative_log_likelihood,
    nll_interval,
    outside_range,
)
from flowlik.flow import flow_method
from flowlik.likelihood.families import FAMILIES
from flowlik.likelihood.likelihood import FlowLikelihood
from flowlik.likelihood.schedule import Index
from flowlik.results.records import Record, protocol, write_records
from ship_models import DENSE_PIXELS, METHODS

REAL = {
    "Sintel alley_1 clean": "flow/sintel/training/clean/alley_1",
    "Sintel alley_1 final": "flow/sintel/training/final/alley_1",
    "Sintel alley_2 clean": "flow/sintel/training/clean/alley_2",
    "Sintel cave_2 final": "flow/sintel/training/final/cave_2",
    "KITTI 2012": "flow/kitti2012/training",
    "RubberWhale": "flow/middlebury/RubberWhale",
    "FlyingChairs": "flow/flyingchairs",
    "Motorcycle": "stereo/motorcycle",
    "TartanAir": "tartanair_v2/abs_P000",
    "7-Scenes (soft truth)": "sevenscenes",
}
SHOWN = (("index", "glc"), ("texture", "lcm"), ("flow", "lcm"), ("texture", "gaussian"))
COUNTING = Counting(10_000, 20)


@dataclass(frozen=True)
class Options:
    """Folders, and whether to do less."""

    cache: Path
    data: Path | None
    quick: bool

    @property
    def kitti_poses(self) -> Path | None:
        return None if self.data is None else self.data / "kitti_poses"


def task_of(method: str, indices: tuple[Index, ...] = (Index(), FLOW_INDEX)) -> Task:
    flow = flow_method(method)
    return Task(flow, indices, index_form(flow).covariates, pixels=DENSE_PIXELS)


def models_of(
    method: str, flights: tuple[Flight, ...], wanted: list[tuple[str, str]], options: Options
) -> tuple[dict[tuple[str, str], FlowLikelihood], dict[str, list[ErrorSketch]]]:
    """Likelihoods by (schedule, family) from flights, and the sketches they were fitted to by schedule."""
    found = [errors_of(f, task_of(method), options.cache, options.kitti_poses) for f in flights]
    flow = flow_method(method)
    blocks = {"texture": [b for f in found for b in f[0]], "flow": [b for f in found for b in f[1]]}
    blocks["constant"] = blocks["texture"]
    index = schedule_index("index", [f[0] for f in found], index_form(flow))
    blocks["index"] = [b.over(index) for b in blocks["texture"]]
    models = {
        (s, f): fit_likelihood(blocks[s], FAMILIES[f], flow, constant=s == "constant") for s, f in wanted
    }
    return models, blocks


def sketches_of(
    method: str,
    models: dict[tuple[str, str], FlowLikelihood],
    source: Flight | ImageSequence,
    options: Options,
) -> dict[Index, list[ErrorSketch]]:
    """Blocks of errors over the index of every model, all of the same measurements."""
    indices = tuple(dict.fromkeys(m.schedule.index for m in models.values()))
    task = task_of(method, indices)
    if isinstance(source, Flight):
        found = errors_of(source, task, options.cache, options.kitti_poses)
    else:
        each = list(sketch_blocks(split_blocks(source, 0, 1), [task]))
        found = [[sketches[kind] for sketches in each] for kind in range(len(indices))]
    return dict(zip(indices, found))


def records_of(
    method: str,
    dataset: str,
    models: dict[tuple[str, str], FlowLikelihood],
    sketches: dict[Index, list[ErrorSketch]],
    **keys: object,
) -> Iterator[Record]:
    """Figures of every model on one population, printed as they come."""
    for (schedule, family), model in models.items():
        blocks = [b for b in sketches[model.schedule.index] if b.total]
        merged = merge_all(blocks)
        counting = COUNTING if len(blocks) > 1 else replace(COUNTING, least_frames=1)
        ks = kolmogorov_smirnov(merged, model, counting)
        found = levels(blocks, model, counting)
        by_level = found.coverage[found.counted]
        low, high = nll_interval(blocks, model, np.random.default_rng(0))
        figures = {
            "nll": negative_log_likelihood(merged, model),
            "ks_median": ks.median,
            "ks_max": ks.maximum,
            **{f"coverage_{c * 100:.0f}": coverage(merged, model, c) for c in CONFIDENCES},
            "coverage_90_lowest_level": float(by_level.min()) if by_level.size else None,
            "coverage_90_highest_level": float(by_level.max()) if by_level.size else None,
            "outside_fraction": outside_range(merged, model),
        }
        note = protocol(
            **keys, pairs=merged.pairs, levels=f"≥{COUNTING.least_components} components",
            nll_interval_95=f"{low:.3f} … {high:.3f}",
            counted_share=f"{ks.counted_share:.3f}",
        )  # fmt: skip
        units = {"nll": "nat"}
        for metric, value in figures.items():
            yield Record(
                metric,
                value,
                units.get(metric, ""),
                dataset,
                method,
                family,
                schedule,
                None,
                merged.total,
                0,
                note,
            )
        counted = (
            f"({by_level.min():.3f} … {by_level.max():.3f})  K-S {ks.median:.3f} max {ks.maximum:.3f}"
            if by_level.size
            else "(no level has enough components)"
        )
        print(
            f"{method:<16} {dataset:<24} {schedule:<9} {family:<12} nll {figures['nll']:7.3f}  "
            f"90 %: {figures['coverage_90']:.3f} {counted}",
            flush=True,
        )


def in_sample(method: str, options: Options) -> Iterator[Record]:
    """Every family over texture, and the best over every schedule, on the calibration flights."""
    wanted = [("texture", family) for family in FAMILIES]
    wanted += [(s, f) for s in ("constant", "flow", "index") for f in ("lcm", "glc")]
    models, blocks = models_of(method, CALIBRATION, wanted, options)
    sketches = {models[s, "lcm"].schedule.index: blocks[s] for s in ("texture", "flow", "index")}
    yield from records_of(method, "calibration flights", models, sketches, split="in sample")


def held_out(method: str, options: Options) -> Iterator[Record]:
    """Models that have seen neither the seeds, nor the speeds, nor the world kind, nor the path."""
    models, _ = models_of(method, strict(), list(SHOWN), options)
    merged = {}
    for name, flight in REPORT.items():
        sketches = sketches_of(method, models, flight, options)
        yield from records_of(method, name, models, sketches, split="held out")
        merged[name] = merge_all(sketches[Index()])
    first, *others = merged
    for name in others:
        value = held_out_floor(merged[first], merged[name], COUNTING).median
        print(
            f"{method:<16} {name:<24} K-S between its errors and those of '{first}': {value:.3f}", flush=True
        )
        yield Record("ks_between_populations", value, "", name, method, protocol=protocol(other=first))


def real(method: str, options: Options) -> Iterator[Record]:
    """Real and other people's images, with models that saw only our simulation."""
    assert options.data is not None
    models, _ = models_of(method, CALIBRATION, list(SHOWN), options)
    errors: dict[str, list[ErrorSketch]] = {}
    for name, path in REAL.items():
        if not (options.data / path).exists():
            print(f"no {name} at {path}: left out")
            continue
        sketches = sketches_of(method, models, open_sequence(options.data / path), options)
        yield from records_of(method, name, models, sketches, split="other data")
        errors[name] = sketches[Index()]
    print("calibrated on the other real sets instead:")
    flow = flow_method(method)
    for name, blocks in errors.items():
        others = [e for other, e in errors.items() if _counts_for(name, other)]
        index = schedule_index("index", others, index_form(flow))
        model = fit_likelihood([b.over(index) for e in others for b in e], FAMILIES["glc"], flow)
        sketches = {index: [b.over(index) for b in blocks]}
        yield from records_of(method, name, {("index", "glc"): model}, sketches, split="other real sets")


def _counts_for(name: str, other: str) -> bool:
    """Whether a model for one real set may learn from another: of another source, with hard truth."""
    return name.split()[0] != other.split()[0] and "soft" not in other


PARTS = {"in-sample": in_sample, "held-out": held_out, "real": real}


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--out", type=Path, help="folder for metrics.json")
    parser.add_argument("--cache", type=Path, required=True)
    parser.add_argument("--data", type=Path)
    parser.add_argument("--methods", nargs="+", choices=METHODS, default=METHODS)
    parser.add_argument("--only", nargs="+", choices=PARTS, default=tuple(PARTS))
    parser.add_argument("--quick", action="store_true", help="Lucas-Kanade alone")
    arguments = parser.parse_args()
    options = Options(arguments.cache, arguments.data, arguments.quick)
    methods = ("lucas-kanade",) if options.quick else arguments.methods
    records = []
    for part in arguments.only:
        if part == "real" and options.data is None:
            print("no --data: nothing measured on real images")
            continue
        for method in methods:
            records += list(PARTS[part](method, options))
    if arguments.out:
        write_records(arguments.out / "metrics.json", records)


if __name__ == "__main__":
    main()
