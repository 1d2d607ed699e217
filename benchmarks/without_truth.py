"""Models calibrated without truth against those made with it, and against the one that ships.

    python benchmarks/without_truth.py --data KITTI_03 --cache CACHE --kitti-poses POSES --out RUN

In simulation the errors of held-back flights are taken against their true motions. On KITTI 03 the model
is learned from frames 0 to 149 and judged on frames 150 to 299: on errors against the motions of the other
tiles, and by the noise of split halves beside PoseLib's.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from scipy.spatial.transform import RigidTransform

from flights import Flight, rendered
from flowlik.comparison.baselines import poselib_relative
from flowlik.datasets import open_sequence
from flowlik.datasets.base import ImageSequence
from flowlik.egomotion import EgoMotion, Epipolar, Estimator, lcmsac, mle
from flowlik.evaluation.motion.split_half import (
    difference_covariance,
    direction_noise_mrad,
    half_coverage,
    half_distances,
    rotation_noise_mdeg,
)
from flowlik.flow import flow_method
from flowlik.likelihood.likelihood import FlowLikelihood
from flowlik.likelihood.model_file import load_likelihood, save_likelihood
from flowlik.measurement.features import measure_features
from flowlik.measurement.halves import halves
from flowlik.report import finish
from flowlik.results.records import Record, protocol
from flowlik.results.runs import RunFolder
from flowlik.self_supervision import (
    MotionErrors,
    Reading,
    SeenPair,
    errors_against,
    learn_without_truth,
    model_of_errors,
    pass_over,
    seen_pairs,
    truthless_form,
    truthless_signals,
)

DRIVING, FOREST = "driving", "forest"
TRAINED = {
    "drives": (
        Flight(DRIVING, "05", 0.0, 208, 12, 5, "truthless"), Flight(DRIVING, "02", 0.0, 50, 10, 4, "val"),
    ),
    "forest": (
        Flight(FOREST, "training", 9.0, 50, 8, 4, "val"), Flight(FOREST, "training", 4.0, 52, 6, 4, "val"),
        Flight(FOREST, "forest-fig8", 6.0, 60, 12, 4, "val"),
    ),
}  # fmt: skip
JUDGED = {
    "drives": (Flight(DRIVING, "07", 0.0, 307, 10, 5, "truthless"), Flight(DRIVING, "04", 0.0, 14, 7, 3)),
    "forest": (Flight(FOREST, "forest-fig8", 6.0, 61, 12, 4, "val"),),
}
"""Flights trained on and judged on share neither seed nor, but for the figure of eight, path."""

CAUCHY_PX = (0.03, 0.05, 0.1, 0.15)
FIRST_HALF = range(149)
SECOND_HALF = range(150, 299)


class Judge:
    """One flow method, its shipped model, and where records go."""

    def __init__(self, model: str, run: RunFolder, seed: int) -> None:
        self.start, self.run, self.seed = load_likelihood(model), run, seed
        self.method = flow_method(self.start.method or {})

    def measure(
        self, sequence: ImageSequence, firsts: range | list[int], depth: bool = False
    ) -> list[SeenPair]:
        residual = "depth" if depth else "epipolar"
        signals = truthless_signals(self.method, residual, self.start)  # type: ignore[arg-type]
        return list(seen_pairs(sequence, firsts, self.method, self.start.texture, signals, depth, self.seed))

    def names(self, depth: bool) -> tuple[str, ...]:
        form = truthless_form(self.method, "depth" if depth else "epipolar")
        return tuple(dict.fromkeys(["texture", *form.covariates, *self.start.schedule.index.covariates]))

    def read(
        self, name: str, model: FlowLikelihood, errors: list[MotionErrors], dataset: str, **keys: object
    ) -> None:
        """Record score and coverage of a model on errors."""
        reading = Reading.of(model, errors)
        note = protocol(model=name, pairs=len(errors), **keys)
        for metric, value in reading.values().items():
            unit = "nat" if metric == "nll" else ""
            self.record(metric, value, unit, dataset, model, None, reading.components, note)
        print(
            f"{dataset:<16} {name:<14} {keys} " + " ".join(f"{v:.3f}" for v in reading.values().values()),
            flush=True,
        )

    def record(
        self, metric: str, value: float, unit: str, dataset: str, model: FlowLikelihood | None,
        estimator: str | None, count: int, note: str,
    ) -> None:  # fmt: skip
        family, schedule = (None, None) if model is None else (model.family.name, model.schedule.name)
        self.run.records.append(
            Record(
                metric,
                value,
                unit,
                dataset,
                self.method.name,
                family,
                schedule,
                estimator,
                count,
                self.seed,
                note,
            )
        )


def flown(
    judge: Judge, flights: tuple[Flight, ...], cache: list[Path], poses: Path, depth: bool
) -> tuple[list[SeenPair], list[RigidTransform]]:
    """Pairs of flights and their true motions."""
    pairs, truth = [], []
    for flight in flights:
        folder = next((c for c in cache if (c / f"{flight.name}.npz").is_file()), cache[0])
        runs = rendered(flight, folder, poses)
        firsts = [k for block in runs.blocks(flight.seed) for k in block.firsts]
        pairs += judge.measure(runs, firsts, depth)
        truth += [runs.T_n_c(k + 1).inv() * runs.T_n_c(k) for k in firsts]
    return pairs, truth


def against_truth(judge: Judge, kind: str, cache: list[Path], poses: Path, depth: bool) -> None:
    """Learn without and with the truth of the same pairs; judge on other flights' true errors."""
    pairs, truth = flown(judge, TRAINED[kind], cache, poses, depth)
    done = learn_without_truth(pairs, judge.method, judge.start, seed=judge.seed)
    learned_from = [k for k in range(len(pairs)) if k not in set(done.held_out)]
    true_errors = [
        errors_against(pairs[k].residuals(), (truth[k], truth[k]), judge.names(depth)) for k in learned_from
    ]
    with_truth = model_of_errors(true_errors, [k // 10 for k in learned_from], judge.method, seed=judge.seed)
    residual = "depth" if depth else "epipolar"
    save_likelihood(done.likelihood, judge.run.begin() / "models" / f"{kind}-{residual}.json")
    for flight in JUDGED[kind]:
        judged, true = flown(judge, (flight,), cache, poses, depth)
        errors = [errors_against(p.residuals(), (T, T), judge.names(depth)) for p, T in zip(judged, true)]
        for name, model in (
            ("shipped", judge.start),
            ("without truth", done.likelihood),
            ("with truth", with_truth),
        ):
            judge.read(name, model, errors, flight.name, against="true motion", residual=residual,
                       trained=kind, trained_pairs=len(learned_from))  # fmt: skip


def starts(judge: Judge, across: FlowLikelihood, cache: list[Path], poses: Path, data: Path) -> None:
    """Judge both tables that ship for a method on errors across lines: on other flights and on KITTI 03."""
    models = {"shipped": judge.start, "epipolar": across}
    names = tuple(dict.fromkeys([*judge.names(False), *across.schedule.index.covariates]))
    for flight in (*JUDGED["drives"], Flight(DRIVING, "02", 0.0, 50, 10, 4, "val"), *JUDGED["forest"]):
        pairs, truth = flown(judge, (flight,), cache, poses, False)
        errors = [errors_against(p.residuals(), (T, T), names) for p, T in zip(pairs, truth)]
        for name, model in models.items():
            judge.read(name, model, errors, flight.name, against="true motion", residual="epipolar")
    pairs = judge.measure(open_sequence(data), list(SECOND_HALF)[::5])
    found = pass_over(pairs, lcmsac(judge.start), names, judge.seed)
    for name, model in models.items():
        judge.read(name, model, found.crossed, "KITTI/03", against="other tiles", motions_by="shipped")


def on_kitti(judge: Judge, data: Path, model: Path | None) -> None:
    """Learn from the first half of KITTI 03, judge on the second."""
    sequence = open_sequence(data)
    if model is None:
        done = learn_without_truth(
            judge.measure(sequence, FIRST_HALF), judge.method, judge.start, seed=judge.seed
        )
        own = done.likelihood
        save_likelihood(own, judge.run.begin() / "models" / "kitti-03.json")
    else:
        own = load_likelihood(model)
    pairs = judge.measure(sequence, SECOND_HALF)
    models = {"shipped": judge.start, "without truth": own}
    for by, mover in models.items():
        found = pass_over(pairs, lcmsac(mover), judge.names(False), judge.seed)
        for name, likelihood in models.items():
            judge.read(name, likelihood, found.crossed, "KITTI/03", against="other tiles", motions_by=by)
    split_halves(judge, sequence, models)


def split_halves(judge: Judge, sequence: ImageSequence, models: dict[str, FlowLikelihood]) -> None:
    """Noise of split halves of corners: ours, and PoseLib's over Cauchy scales."""
    found: dict[tuple[str, str], list[tuple[RigidTransform, RigidTransform]]] = {}
    distances: dict[tuple[str, str], list[float]] = {}
    for k in SECOND_HALF:
        images = sequence.image(k), sequence.image(k + 1)
        m = measure_features(*images, judge.method, judge.start.texture, judge.seed + k, judge.start.signals)
        parts = [Epipolar.of(m.select(half), sequence.camera) for half in halves(m.pixels)]
        for name, model in models.items():
            for estimator in (lcmsac(model), mle(model)):
                pair = [estimator.estimate(part, judge.seed) for part in parts]
                if all(motion.solved for motion in pair):
                    key = (estimator.name, name)
                    found.setdefault(key, []).append((pair[0].T_k_prev, pair[1].T_k_prev))
                    distances.setdefault(key, []).append(distance(estimator, parts, pair))
        for scale in CAUCHY_PX:
            first, second = (poselib_relative(part, cauchy_px=scale) for part in parts)
            if first is not None and second is not None:
                found.setdefault((f"poselib-cauchy-{scale:g}", ""), []).append((first, second))
    for (estimator_name, name), halves_ in found.items():
        first, second = (RigidTransform.concatenate([pair[i] for pair in halves_]) for i in (0, 1))
        note = protocol(model=name or None, halves="64 px chessboard", start="none", features="corners")
        model = models.get(name)
        figures = {
            "split_half_direction_mrad": (direction_noise_mrad(first, second), "mrad"),
            "split_half_rotation_mdeg": (rotation_noise_mdeg(first, second), "0.001 deg"),
        }
        if (estimator_name, name) in distances:
            d = np.array(distances[estimator_name, name])
            figures |= {f"split_half_coverage_{c}": (half_coverage(d, c / 100), "") for c in (50, 90, 95)}
        for metric, (value, unit) in figures.items():
            judge.record(metric, value, unit, "KITTI/03", model, estimator_name, len(halves_), note)
        print(
            estimator_name, name, len(halves_), " ".join(f"{v:.3f}" for v, _ in figures.values()), flush=True
        )


def distance(estimator: Estimator, parts: list[Epipolar], pair: list[EgoMotion]) -> float:
    """Squared Mahalanobis distance of two halves' motions."""
    covariance = difference_covariance(estimator, parts, pair)
    return float(half_distances(pair[:1], pair[1:], [covariance])[0])


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--data", type=Path, required=True, help="KITTI 03, frames 0 to 299")
    parser.add_argument(
        "--cache", type=Path, required=True, nargs="+", help="rendered flights; new ones go to the first"
    )
    parser.add_argument("--kitti-poses", type=Path, required=True, help="folder of NN.txt")
    parser.add_argument("--model", default="lucas-kanade-11", help="shipped model to begin with")
    parser.add_argument(
        "--own", type=Path, help="model learned from KITTI 03's first half, instead of learning it"
    )
    parser.add_argument(
        "--across", help="table of errors across lines for the part `starts`, not the shipped"
    )
    parser.add_argument("--parts", nargs="+", default=["drives", "forest", "starts", "kitti"])
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path, required=True, help="run folder")
    options = parser.parse_args()
    config = {"model": options.model, "parts": options.parts}
    run = RunFolder(options.out, "benchmarks/without_truth", config, options.seed)
    judge = Judge(options.model, run, options.seed)
    if "drives" in options.parts:
        against_truth(judge, "drives", options.cache, options.kitti_poses, False)
    if "forest" in options.parts:
        for depth in (False, True):
            against_truth(judge, "forest", options.cache, options.kitti_poses, depth)
    if "starts" in options.parts:
        across = load_likelihood(options.across or options.model, "epipolar")
        starts(judge, across, options.cache, options.kitti_poses, options.data)
    if "kitti" in options.parts:
        on_kitti(judge, options.data, options.own)
    finish(run)


if __name__ == "__main__":
    main()
