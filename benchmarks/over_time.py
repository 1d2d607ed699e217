"""Errors of motions over time: how they stay, and whether chains of motions are as far off as they say.

    python benchmarks/over_time.py --cache CACHE --out RUN [--models lucas-kanade dis] [--write FOLDER]

Motions of known depth in a row, of flights rendered once into CACHE, at 60, 30 and 10 frames/s of the same
images. `CALIBRATION`, flights of 3 s at 60 frames/s, gives the share that stays and its memory; `HELD_OUT`,
flights of 30 s of other seeds and speeds, judges. With --write the models with what was found are left in
FOLDER.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.optimize import least_squares
from scipy.spatial.transform import RigidTransform

from flowlik.egomotion import EgoMotion, Status, lcmsac
from flowlik.flow import flow_method
from flowlik.geometry.motion import relative_motion
from flowlik.likelihood.likelihood import FlowLikelihood
from flowlik.likelihood.model_file import load_likelihood, save_likelihood
from flowlik.likelihood.over_time import OverTime, Persistence
from flowlik.odometry import Odometry, flow_factor
from flowlik.odometry.flow_factor import given_rotation
from flowlik.odometry.trajectory_covariance import ChainedErrors
from flowlik.results.records import Record, protocol, write_records
from flowlik.simulation import PAPER_CAMERA, camera_of, simulate
from flowlik.support.files import atomic_write

FRAMES_PER_SECOND = 60
RATES = (60, 30, 10)  # frames/s: every one, every second and every sixth image
CHAINS_S = (0.25, 1.0, 2.0, 5.0)
FORMS = {"full": 6, "given-rotation": 3}


@dataclass(frozen=True)
class Flight:
    """Frames in a row from the middle of a flight: world, path, speed [m/s], seed, length [s], width [px]."""

    world: str
    trajectory: str
    speed_mps: float
    seed: int
    seconds: float = 3.0
    width: int = PAPER_CAMERA.width

    @property
    def name(self) -> str:
        long = "" if self.seconds == 3 else f"-{self.seconds:g}s"
        small = "" if self.width == PAPER_CAMERA.width else f"-{self.width}px"
        return f"{self.world}-{self.trajectory}-{self.speed_mps:g}-{self.seed}{long}{small}"


CALIBRATION = (
    Flight("forest", "forest-fig8", 6.0, 200),
    Flight("forest", "curve", 3.0, 202),
    Flight("planes", "training", 6.0, 204),
    Flight("forest", "straight", 6.0, 206),
    Flight("forest", "training", 12.0, 203),
    Flight("forest", "training", 3.0, 205),
    Flight("forest", "forest-fig8", 6.0, 300),
    Flight("forest", "curve", 6.0, 301),
    Flight("planes", "training", 4.0, 303),
    Flight("forest", "training", 9.0, 305),
)
HELD_OUT = (
    Flight("planes", "training", 3.0, 402, 30.0),
    Flight("forest", "forest-fig8", 6.0, 400, 30.0, 320),
    Flight("forest", "training", 4.0, 401, 30.0, 320),
    Flight("planes", "training", 6.0, 404, 30.0),
    Flight("forest", "curve", 3.0, 403, 30.0, 320),
    Flight("forest", "straight", 2.5, 405, 30.0, 320),
)


class Motions(NamedTuple):
    """Estimated motions of a flight with their covariances (M, 6, 6), and the true ones."""

    estimated: list[EgoMotion]
    true: list[RigidTransform]


def flown(
    flight: Flight, name: str, model: FlowLikelihood, cache: Path, rate: int = FRAMES_PER_SECOND
) -> Motions:
    """Motions of a flight by a model, from the cache if it has them."""
    path = _cached(flight, name, cache, rate)
    if not path.is_file():
        fly(flight, {name: model}, cache, (rate,))
    with np.load(path) as data:
        status = [Status(s) for s in data["status"]]
        estimated = [
            EgoMotion(RigidTransform.from_matrix(T), np.zeros((6, 6)), C, s)
            for T, C, s in zip(data["T"], data["covariance"], status)
        ]
        return Motions(estimated, [RigidTransform.from_matrix(T) for T in data["true"]])


def fly(flight: Flight, models: Mapping[str, FlowLikelihood], cache: Path, rates: tuple[int, ...]) -> None:
    """Leave a flight's motions by every model at every frame rate in the cache; images are rendered once."""
    missing = [(n, r) for n in models for r in rates if not _cached(flight, n, cache, r).is_file()]
    if not missing:
        return
    camera = camera_of(flight.world, flight.width, flight.width * 9 // 16, None)
    length_m = 100.0 if flight.trajectory in ("straight", "curve") else 200.0
    frames = int(length_m * FRAMES_PER_SECOND / flight.speed_mps)
    sequence = simulate(flight.world, flight.trajectory, frames, flight.speed_mps, flight.seed, camera)
    motions = round(flight.seconds * FRAMES_PER_SECOND)
    first = int(0.4 * (frames - motions - 1))
    robots = [
        Odometry(sequence.camera, flow_method(models[name].method or {}), lcmsac(models[name]))
        for name, _ in missing
    ]
    estimated: list[list[EgoMotion]] = [[] for _ in missing]
    true: list[list[RigidTransform]] = [[] for _ in missing]
    for k in range(motions + 1):
        frame = first + k
        image, depth = sequence.image(frame), sequence.depth(frame)
        for robot, (_, rate), found, truth in zip(robots, missing, estimated, true):
            every = FRAMES_PER_SECOND // rate
            if k % every:
                continue
            motion = robot.step(image, frame / FRAMES_PER_SECOND, depth)
            if k:
                found.append(motion)
                truth.append(relative_motion(sequence.T_n_c(frame - every), sequence.T_n_c(frame)))
    for (name, rate), found, truth in zip(missing, estimated, true):
        with atomic_write(_cached(flight, name, cache, rate), "wb") as file:
            np.savez(
                file,
                T=np.array([m.T_k_prev.as_matrix() for m in found]),
                covariance=np.array([m.covariance for m in found]),
                status=[m.status.value for m in found],
                true=np.array([T.as_matrix() for T in truth]),
            )
    print(f"flown {flight.name}", flush=True)


def _cached(flight: Flight, name: str, cache: Path, rate: int) -> Path:
    return cache / f"{flight.name}--{name}{'' if rate == FRAMES_PER_SECOND else f'--{rate}'}.npz"


def with_over_time(model: FlowLikelihood, over_time: OverTime | None) -> FlowLikelihood:
    """Model that knows how its motions' errors stay, or that does not."""
    return replace(model, shared_errors=replace(model.shared_errors, over_time=over_time))


def whitened(motions: Motions, form: str) -> np.ndarray:
    """Errors (M, 6) of motions in stated standard deviations, or of translations (M, 3) given rotation."""
    errors = []
    for motion, true in zip(*motions):
        xi = (motion.T_k_prev * true.inv()).as_exp_coords()
        C = motion.covariance
        if form == "given-rotation":
            gain, C = given_rotation(C)
            xi = xi[3:] - gain @ xi[:3]
        errors.append(np.linalg.solve(np.linalg.cholesky(C), xi))
    return np.array(errors)


def factors(errors: np.ndarray, lengths: tuple[int, ...]) -> np.ndarray:
    """Variance of sums of so many whitened errors in a row, over that of independent ones."""
    sums = np.vstack([np.zeros(errors.shape[1]), np.cumsum(errors, axis=0)])
    return np.array([((sums[n:] - sums[:-n]) ** 2).mean() / n for n in lengths])


def fitted(flights: list[np.ndarray]) -> Persistence:
    """Share and memory whose long-run factors are nearest to the flights' mean, in ratio.

    Runs of 3 s tell nothing of a memory that is longer than half of them.
    """
    lengths = (1, 2, 4, 8, 15, 30, 60, 90)
    mean = np.log(np.mean([factors(errors, lengths) for errors in flights], axis=0))

    def misfit(free: np.ndarray) -> np.ndarray:
        stays = Persistence(*np.exp(free))
        return np.log([stays.long_run_factor(n, 1 / FRAMES_PER_SECOND) for n in lengths]) - mean

    longest_s = 0.5 * min(flight.seconds for flight in CALIBRATION)
    bounds = np.log([[1e-3, 0.02], [9.9, longest_s]])
    found = np.exp(least_squares(misfit, np.log([0.5, 0.5]), bounds=bounds).x)
    return Persistence(*(round(float(value), 4) for value in found))


def calibrated(name: str, model: FlowLikelihood, cache: Path) -> OverTime:
    """What stays of a model's motions on the calibration flights."""
    flights = [flown(flight, name, model, cache) for flight in CALIBRATION]
    full, given = (fitted([whitened(f, form) for f in flights]) for form in FORMS)
    return OverTime(full, given)


def nees(
    motions: Motions, first: int, length: int, model: FlowLikelihood, form: str, interval_s: float
) -> float:
    """Squared error of a chain over its stated covariance."""
    chain = list(zip(*motions))[first : first + length]
    over_time = model.shared_errors.over_time
    if form == "full":
        errors = ChainedErrors(persistence=over_time and over_time.full)
        estimated = true = RigidTransform.identity()
        for motion, T in chain:
            errors = errors.after(motion, interval_s)
            estimated, true = motion.T_k_prev * estimated, T * true
        eta = (estimated * true.inv()).as_exp_coords()
        return float(eta @ np.linalg.solve(errors.pose, eta))
    independent = OverTime(Persistence(0.0, 1.0), Persistence(0.0, 1.0))
    one = with_over_time(model, independent)
    stays = (over_time or independent).given_rotation
    total, covariance, R = np.zeros(3), np.zeros((3, 3)), np.eye(3)
    for motion, T in chain:
        if (factor := flow_factor(motion, one, interval_s)) is None:
            continue
        # into the axes of the first frame
        R = R @ T.rotation.as_matrix().T
        total += R @ factor.residual(T)
        covariance += R @ factor.covariance @ R.T
    covariance *= stays.long_run_factor(length, interval_s)
    return float(total @ np.linalg.solve(covariance, total))


def judged(name: str, model: FlowLikelihood, cache: Path) -> Iterator[Record]:
    """Chains of the held-out flights: NEES and long-run factors, a record a flight; means are printed."""
    over_time = model.shared_errors.over_time
    for form, rate in product(FORMS, RATES):
        flights = [flown(flight, name, model, cache, rate) for flight in HELD_OUT]
        errors = [whitened(motions, form) for motions in flights]
        for length in (round(seconds * rate) for seconds in CHAINS_S):
            if length < 2:
                continue
            means, found = [], []
            for flight, motions, of_flight in zip(HELD_OUT, flights, errors):
                firsts = range(0, len(motions.true) - length + 1, max(length // 2, 1))
                values = [nees(motions, first, length, model, form, 1 / rate) for first in firsts]
                means.append(float(np.mean(values)))
                found.append(float(factors(of_flight, (length,))[0]))
                note = protocol(
                    model=name, form=form, chain=length, frames_per_second=rate,
                    over_time="none" if over_time is None else "calibrated",
                )  # fmt: skip
                keys = (flight.name, name, model.family.name, model.schedule.name, "lcmsac", len(values), 0)
                yield Record("nees_mean", means[-1], "", *keys, note)
                yield Record("long_run_factor", found[-1], "", *keys, note)
            what = f"{name:13} {form:14} {rate:2} Hz {length:3} motions"
            print(f"{what}: NEES {np.mean(means):6.1f} | " + " ".join(f"{m:6.1f}" for m in means))
            if over_time is not None:
                stays = over_time.full if form == "full" else over_time.given_rotation
                stated = stays.long_run_factor(length, 1 / rate)
                print(f"{'':32} long-run factor over the calibrated one: ", end="")
                print(" ".join(f"{f / stated:.2f}" for f in found))


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--cache", type=Path, required=True)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--models", nargs="+", default=("lucas-kanade", "dis"))
    parser.add_argument("--write", type=Path, help="folder for the models with what was found")
    options = parser.parse_args()
    options.cache.mkdir(parents=True, exist_ok=True)
    records: list[Record] = []
    models = {Path(path).stem: load_likelihood(path) for path in options.models}
    for flight in CALIBRATION:
        fly(flight, models, options.cache, (FRAMES_PER_SECOND,))
    for flight in HELD_OUT:
        fly(flight, models, options.cache, RATES)
    for name, model in models.items():
        over_time = calibrated(name, model, options.cache)
        print(f"{name}: {over_time}")
        for known in (None, over_time):
            records += judged(name, with_over_time(model, known), options.cache)
        if options.write is not None:
            save_likelihood(with_over_time(model, over_time), options.write / f"{name}.json")
    options.out.mkdir(parents=True, exist_ok=True)
    write_records(options.out / "metrics.json", records)


if __name__ == "__main__":
    main()
