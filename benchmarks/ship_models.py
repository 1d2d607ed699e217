"""Calibrate the models that ship with flowlik and write them to `src/flowlik/likelihood/shipped`.

    python benchmarks/ship_models.py --cache CACHE --kitti-poses KITTI_POSES [--methods lucas-kanade ...]

Flights are rendered once into CACHE (about half an hour on two cores). The `driving` world runs along true
poses of KITTI odometry, of which nothing but the shape of the route enters.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import replace
from pathlib import Path

from calibration_plan import CALIBRATION
from flights import errors_of, rendered
from flowlik.calibration import (
    FLOW_INDEX,
    ErrorSketch,
    Task,
    fit_likelihood,
    index_form,
    measured_pairs,
    merge_all,
    schedule_index,
    with_shared_errors,
)
from flowlik.calibration.shared_errors import Pairs
from flowlik.evaluation.likelihood import Counting, coverage, kolmogorov_smirnov, negative_log_likelihood
from flowlik.flow import flow_method
from flowlik.image.texture import TextureDefinition
from flowlik.likelihood.families import error_family
from flowlik.likelihood.likelihood import FlowLikelihood
from flowlik.likelihood.model_file import load_likelihood, save_likelihood
from flowlik.likelihood.schedule import Index

DENSE_PIXELS = 20_000
PAPER = {"lucas-kanade": "lucas-kanade-opencv", "lucas-kanade-11": "lucas-kanade-11-opencv"}
"""Methods whose texture models are of the paper's solver."""

METHODS = ("lucas-kanade", "lucas-kanade-11", "farneback", "dis", "horn-schunck")
MODELS = Path(__file__).resolve().parents[1] / "src" / "flowlik" / "likelihood" / "shipped"


def measured(method: str, cache: Path, kitti_poses: Path | None) -> list[list[list[ErrorSketch]]]:
    """Sketches of every calibration flight: over texture, and over the flow's magnitude."""
    flow = flow_method(method)
    task = Task(flow, (Index(), FLOW_INDEX), index_form(flow).covariates, pixels=DENSE_PIXELS)
    return [errors_of(flight, task, cache, kitti_poses) for flight in CALIBRATION]


def with_goodness(likelihood: FlowLikelihood, blocks: list[ErrorSketch]) -> FlowLikelihood:
    """Likelihood whose file tells how well it fits its own calibration data."""
    merged = merge_all(blocks)
    ks = kolmogorov_smirnov(merged, likelihood, Counting(10_000))
    figures = {
        "nll": negative_log_likelihood(merged, likelihood),
        "ks_median": ks.median,
        "ks_max": ks.maximum,
        "coverage_90": coverage(merged, likelihood, 0.9),
    }
    return replace(likelihood, goodness={**likelihood.goodness, **figures})


def shared(method: str, signals: tuple[str, ...], cache: Path, kitti_poses: Path | None) -> Pairs:
    """What errors share, on all calibration flights."""
    blocks = [
        block for flight in CALIBRATION for block in rendered(flight, cache, kitti_poses).blocks(flight.seed)
    ]
    return measured_pairs(blocks, flow_method(method), TextureDefinition(), signals)


def ship(method: str, cache: Path, kitti_poses: Path | None, out: Path) -> None:
    """Calibrate and write the two models of a method."""
    start = time.perf_counter()
    provenance = {
        "data": ", ".join(flight.name for flight in CALIBRATION),
        "command": "python benchmarks/ship_models.py",
        "sensor": "default",
    }
    for name, measures, family in (
        (method, method, "glc"), (f"{method}-lcm", PAPER.get(method, method), "lcm"),
    ):  # fmt: skip
        flow, flights = flow_method(measures), measured(measures, cache, kitti_poses)
        blocks = [block for flight in flights for block in flight[0]]
        index = Index()
        if family == "glc":
            index = schedule_index("index", [flight[0] for flight in flights], index_form(flow))
            blocks = [block.over(index) for block in blocks]
        model = fit_likelihood(blocks, error_family(family), flow, provenance=provenance)
        model = with_shared_errors(model, shared(measures, index.signals, cache, kitti_poses))
        save_likelihood(with_goodness(model, blocks), out / f"{name}.json")
        print(name, model.goodness["fit"], f"{time.perf_counter() - start:.0f} s", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--cache", type=Path, required=True)
    parser.add_argument("--kitti-poses", type=Path)
    parser.add_argument("--methods", nargs="+", choices=METHODS, default=METHODS)
    parser.add_argument("--out", type=Path, default=MODELS)
    parser.add_argument("--shared", action="store_true", help="measure only what errors share anew")
    options = parser.parse_args()
    for method in options.methods:
        if options.shared:
            for name, measures in ((method, method), (f"{method}-lcm", PAPER.get(method, method))):
                model = load_likelihood(options.out / f"{name}.json")
                pairs = shared(measures, model.signals, options.cache, options.kitti_poses)
                found = with_shared_errors(model, pairs)
                save_likelihood(found, options.out / f"{name}.json")
                print(name, found.shared_errors, flush=True)
            continue
        ship(method, options.cache, options.kitti_poses, options.out)


if __name__ == "__main__":
    main()
