"""What flow is worth in a filter: IMU, GPS and flow fused on held-out flights by an error-state filter.

    python benchmarks/fused_over_time.py --cache CACHE --out RUN [--models lucas-kanade dis] [--draws 12]

The motions are those that `over_time.py` left in CACHE, estimated of images in a row: 30 s of each held-out
flight. IMU (EuRoC's noise densities and turn-on biases of a MEMS IMU), GPS (5 a second, 1.5 m) and the start
are drawn; {n} is the first camera's frame, level. What the models know of errors over time is of the
calibration flights, the others judge. First the filter itself is judged: with flow's errors drawn of its
covariance NEES is 9 if the filter is right.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.spatial.transform import RigidTransform
from scipy.stats import chi2

from error_state_filter import THETA, ErrorStateFilter, Imu, P, Start, Truth, V, drawn_imu, nees, true_flight
from flowlik.egomotion import EgoMotion
from flowlik.errors import ModelError
from flowlik.likelihood.likelihood import FlowLikelihood
from flowlik.likelihood.model_file import load_likelihood
from flowlik.likelihood.over_time import OverTime, Persistence
from flowlik.odometry import FlowFactor, flow_factor
from flowlik.results.records import Record, protocol, write_records
from over_time import CALIBRATION, FRAMES_PER_SECOND, HELD_OUT, Motions, flown, with_over_time

Factors = Callable[[EgoMotion], FlowFactor | None]
GPS_PER_SECOND, GPS_SIGMA_M, JUDGED_PER_SECOND = 5.0, 1.5, 2.0
INTERVAL_S = 1 / FRAMES_PER_SECOND
VINS_COVARIANCE = np.diag(
    np.repeat([0.01, 0.1], 3) ** 2
)  # VINS-Fusion's weights of a visual odometry: rad, m


def poses_of(motions: Motions) -> tuple[RigidTransform, np.ndarray]:
    """True poses ``T_n_c`` from the first camera's frame on, and their times [s]."""
    poses = [RigidTransform.identity()]
    for T in motions.true:
        poses.append(poses[-1] * T.inv())
    return RigidTransform.concatenate(poses), np.arange(len(poses)) * INTERVAL_S


def fused(
    motions: Motions,
    factors: Factors,
    draws: int,
    seed: int,
    drawn: bool = False,
    stays: Persistence | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """Errors (times, draws, 9) and their covariances (times, draws, 9, 9), twice a second.

    With ``drawn`` the flow is not the images' but the true motion with white errors of its covariance.
    """
    imu, rng = Imu(), np.random.default_rng(seed)
    truth: Truth = true_flight(*poses_of(motions), imu.rate_hz)
    rates, forces = drawn_imu(truth, imu, draws, rng)
    robot = ErrorStateFilter(truth, imu, Start(), draws, rng, stays)
    each, gps_each, judged_each = (
        round(imu.rate_hz / r) for r in (FRAMES_PER_SECOND, GPS_PER_SECOND, JUDGED_PER_SECOND)
    )
    estimated = motions.estimated
    if drawn:
        estimated = [replace(m, T_k_prev=true) for m, true in zip(*motions)]
    errors, covariances = [], []
    for k in range(1, len(truth.times_s)):
        robot.propagate(rates[k - 1 : k + 1], forces[k - 1 : k + 1])
        if k % each == 0:
            if (factor := factors(estimated[k // each - 1])) is not None:
                freedoms = np.zeros(len(factor.covariance))
                noise = rng.multivariate_normal(freedoms, factor.covariance, draws) if drawn else None
                robot.flow(factor, noise)
            robot.clone()
            robot.age(INTERVAL_S)
        fix = truth.p[k] + GPS_SIGMA_M * rng.standard_normal((draws, 3))
        if k % gps_each == 0:
            robot.gps(fix, GPS_SIGMA_M)
        if k % judged_each == 0:
            errors.append(robot.errors(truth.R[k], truth.v[k], truth.p[k]))
            covariances.append(robot.C[:, :9, :9].copy())
    return np.array(errors), np.array(covariances)


def ways(model: FlowLikelihood, over_time: OverTime) -> dict[str, Factors]:
    """Measurements of a motion: none, of fixed weights, of one motion's covariance, and both forms."""
    once = Persistence(0.0, 1.0)
    alone, knows = with_over_time(model, OverTime(once, once)), with_over_time(model, over_time)

    def fixed(motion: EgoMotion) -> FlowFactor | None:
        return (
            FlowFactor("full", motion.T_k_prev, VINS_COVARIANCE, np.zeros((3, 3))) if motion.solved else None
        )

    return {
        "imu-gps": lambda motion: None,
        "vins-weights": fixed,
        "one-motion": lambda motion: flow_factor(motion, alone, INTERVAL_S, "full"),
        "full": lambda motion: flow_factor(motion, knows, INTERVAL_S, "full"),
        "bias-state": lambda motion: flow_factor(motion, alone, INTERVAL_S),
        "given-rotation": lambda motion: flow_factor(motion, knows, INTERVAL_S),
    }


def told(errors: np.ndarray, covariances: np.ndarray) -> dict[str, tuple[float, str]]:
    """Figures of a flight: NEES, what 90 % regions hold, and root mean square errors."""
    squared = nees(errors, covariances)

    def rms(part: slice) -> float:
        return float(np.sqrt((errors[..., part] ** 2).sum(axis=-1).mean()))

    return {
        "nees_mean": (float(squared.mean()), ""),
        "coverage_90": (float((squared < chi2.ppf(0.9, 9)).mean()), ""),
        "attitude_rms_deg": (float(np.rad2deg(rms(THETA))), "deg"),
        "velocity_rms_mps": (rms(V), "m/s"),
        "position_rms_m": (rms(P), "m"),
    }


def judged(name: str, model: FlowLikelihood, cache: Path, draws: int) -> list[Record]:
    """Every way on every held-out flight, a record a flight and figure."""
    if (over_time := model.shared_errors.over_time) is None:
        raise ModelError(f"{name}: this model does not know how errors stay over time")
    print(f"{name}: {over_time}", flush=True)
    records = []
    for way, factors in ways(model, over_time).items():
        of_flights = []
        for number, flight in enumerate(HELD_OUT):
            motions = flown(flight, name, model, cache)
            stays = over_time.given_rotation if way == "bias-state" else None
            found = told(*fused(motions, factors, draws, number, stays=stays))
            of_flights.append(found)
            note = protocol(
                fused="imu+gps+flow", form=way, seconds=flight.seconds, draws=draws, gps_m=GPS_SIGMA_M
            )
            keys = (flight.name, name, model.family.name, model.schedule.name, "lcmsac", draws, number, note)
            records += [Record(metric, value, unit, *keys) for metric, (value, unit) in found.items()]
        print_row(f"{name:12} {way:15}", of_flights)
    return records


def check_filter(cache: Path, name: str, model: FlowLikelihood, draws: int) -> list[Record]:
    """NEES of the filter itself on every flight, flow's errors drawn white of each motion's covariance."""
    once = OverTime(Persistence(0.0, 1.0), Persistence(0.0, 1.0))
    records = []
    for way in ("full", "given-rotation"):
        of_flights = []
        for number, flight in enumerate([*CALIBRATION, *HELD_OUT]):
            motions = flown(flight, name, model, cache)
            of_flights.append(told(*fused(motions, ways(model, once)[way], draws, 1000 + number, drawn=True)))
        print_row(f"drawn white  {way:15}", of_flights)
        mean = float(np.mean([f["nees_mean"][0] for f in of_flights]))
        note = protocol(fused="imu+gps+drawn-flow", form=way, seconds="3 to 30", gps_m=GPS_SIGMA_M)
        keys = (
            "all",
            name,
            model.family.name,
            model.schedule.name,
            "lcmsac",
            draws * len(of_flights),
            0,
            note,
        )
        records.append(Record("nees_mean", mean, "", *keys))
    return records


def print_row(what: str, of_flights: Sequence[dict[str, tuple[float, str]]]) -> None:
    means = {key: np.mean([f[key][0] for f in of_flights]) for key in of_flights[0]}
    each = " ".join(f"{f['nees_mean'][0]:6.1f}" for f in of_flights)
    rest = " ".join(f"{key} {value:.3f}" for key, value in means.items() if key != "nees_mean")
    print(f"{what} NEES(9) {means['nees_mean']:6.1f} | {each} | {rest}", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--cache", type=Path, required=True)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--models", nargs="+", default=("lucas-kanade", "dis"))
    parser.add_argument("--draws", type=int, default=12)
    options = parser.parse_args()
    records: list[Record] = []
    for path in options.models:
        name, model = Path(path).stem, load_likelihood(path)
        if not records:
            records += check_filter(options.cache, name, model, 4 * options.draws)
        records += judged(name, model, options.cache, options.draws)
    options.out.mkdir(parents=True, exist_ok=True)
    write_records(options.out / "metrics.json", records)


if __name__ == "__main__":
    main()
