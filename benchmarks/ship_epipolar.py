"""Calibrate models of errors across epipolar lines in simulation, by the true motions.

    python benchmarks/ship_epipolar.py --cache CACHE --kitti-poses POSES --out FOLDER

The flights are those of `ship_models.py` without the drives along KITTI 04 and 07, which judge.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

from calibration_plan import CALIBRATION
from flights import rendered
from flowlik.flow import flow_method
from flowlik.likelihood.model_file import load_likelihood, save_likelihood
from flowlik.self_supervision import (
    MotionErrors,
    Reading,
    errors_against,
    model_of_errors,
    seen_pairs,
    shared_by,
    truthless_form,
    truthless_signals,
)

JUDGES = ("04", "07")
FLIGHTS = tuple(flight for flight in CALIBRATION if flight.trajectory not in JUDGES)


def measured(method: str, cache: Path, kitti_poses: Path) -> list[list[MotionErrors]]:
    """Errors of every flight's pairs against their true motions."""
    start = load_likelihood(method)
    flow = flow_method(start.method or {})
    names = tuple(
        dict.fromkeys(
            ["texture", *truthless_form(flow, "epipolar").covariates, *start.schedule.index.covariates]
        )
    )
    signals = truthless_signals(flow, "epipolar", start)
    flights = []
    for flight in FLIGHTS:
        runs = rendered(flight, cache, kitti_poses)
        firsts = [k for block in runs.blocks(flight.seed) for k in block.firsts]
        pairs = seen_pairs(runs, firsts, flow, start.texture, signals, seed=flight.seed)
        truth = [runs.T_n_c(k + 1).inv() * runs.T_n_c(k) for k in firsts]
        flights.append([errors_against(pair.residuals(), (T, T), names) for pair, T in zip(pairs, truth)])
        print(flight.name, len(firsts), flush=True)
    return flights


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--cache", type=Path, required=True)
    parser.add_argument("--kitti-poses", type=Path, required=True)
    parser.add_argument("--methods", nargs="+", default=["lucas-kanade", "lucas-kanade-11"])
    parser.add_argument("--out", type=Path, required=True)
    options = parser.parse_args()
    for method in options.methods:
        start, flights = load_likelihood(method), measured(method, options.cache, options.kitti_poses)
        errors = [e for flight in flights for e in flight]
        blocks = [number for number, flight in enumerate(flights) for _ in flight]
        model = model_of_errors(errors, blocks, flow_method(start.method or {}))
        provenance = {
            **model.provenance,
            "data": ", ".join(flight.name for flight in FLIGHTS),
            "command": "python benchmarks/ship_epipolar.py",
            "truth": "true motions",
        }
        goodness = {**model.goodness, **Reading.of(model, errors).values()}
        model = replace(
            model, provenance=provenance, goodness=goodness, shared_errors=shared_by(model, errors, start)
        )
        save_likelihood(model, options.out / f"{method}-epipolar.json")
        print(method, goodness, flush=True)


if __name__ == "__main__":
    main()
