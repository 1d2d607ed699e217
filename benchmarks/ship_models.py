"""Calibrate the models that ship with flowlik and write them to `src/flowlik/likelihood/shipped`.

    python benchmarks/ship_models.py --cache CACHE --kitti-poses KITTI_POSES --runs RUNS [--methods dis ...]

Each is a run of `flowlik calibrate --standard` in RUNS, with its report. Flights are rendered once into
CACHE (more than an hour on two cores). The `driving` world runs along true poses of KITTI odometry, of which
nothing but the shape of the route enters.
"""

from __future__ import annotations

import argparse
import shutil
from pathlib import Path

from flowlik.calibration import measured_pairs, with_shared_errors
from flowlik.commands import calibrate
from flowlik.commands.options import CalibrateOptions
from flowlik.commands.standard_flights import DENSE_PIXELS, rendered
from flowlik.commands.standard_plan import CALIBRATION
from flowlik.flow import describe, flow_method, method_label
from flowlik.image.texture import TextureDefinition
from flowlik.likelihood.model_file import load_likelihood, save_likelihood
from flowlik.support.progress import terminal_progress

PAPER = {"lucas-kanade": "lucas-kanade-opencv", "lucas-kanade-11": "lucas-kanade-11-opencv"}
"""Methods whose texture models are of the paper's solver."""

METHODS = ("lucas-kanade", "lucas-kanade-11", "farneback", "dis", "horn-schunck")
MODELS = Path(__file__).resolve().parents[1] / "src" / "flowlik" / "likelihood" / "shipped"

__all__ = ["DENSE_PIXELS", "METHODS"]


def models_of(method: str) -> tuple[tuple[str, str, str, str], ...]:
    """Name, flow method, family and schedule of the two models of a method."""
    return (method, method, "glc", "index"), (f"{method}-lcm", PAPER.get(method, method), "lcm", "texture")


def ship(name: str, flow: str, family: str, schedule: str, options: argparse.Namespace) -> None:
    """Calibrate one model and copy it to where it ships from."""
    run = calibrate(
        [], flow, options.runs / name,
        CalibrateOptions(
            family=family, schedule=schedule, standard=True, cache=options.cache,
            kitti_poses=options.kitti_poses,
        ),
        command="python benchmarks/ship_models.py", progress=terminal_progress,
    )  # fmt: skip
    label = method_label(describe(flow_method(flow)))
    shutil.copyfile(run.path / "models" / f"{label}.json", options.out / f"{name}.json")
    print(options.out / f"{name}.json", flush=True)


def share_anew(name: str, flow: str, options: argparse.Namespace) -> None:
    """Measure only what errors share anew."""
    model = load_likelihood(options.out / f"{name}.json")
    flights = [(flight, rendered(flight, options.cache, options.kitti_poses)) for flight in CALIBRATION]
    blocks = [block for flight, runs in flights for block in runs.blocks(flight.seed)]
    found = measured_pairs(blocks, flow_method(flow), TextureDefinition(), model.signals)
    save_likelihood(with_shared_errors(model, found), options.out / f"{name}.json")
    print(name, flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--cache", type=Path, required=True)
    parser.add_argument("--kitti-poses", type=Path)
    parser.add_argument("--runs", type=Path, default=Path("ship"), help="folder of the calibrations' runs")
    parser.add_argument("--methods", nargs="+", choices=METHODS, default=METHODS)
    parser.add_argument("--out", type=Path, default=MODELS)
    parser.add_argument("--shared", action="store_true", help="measure only what errors share anew")
    options = parser.parse_args()
    for method in options.methods:
        for name, flow, family, schedule in models_of(method):
            if options.shared:
                share_anew(name, flow, options)
            else:
                ship(name, flow, family, schedule, options)


if __name__ == "__main__":
    main()
