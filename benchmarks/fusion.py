"""The smoother against the error-state filter on the same draws, in an outage of GPS, and under a monitor.

    python benchmarks/fusion.py --out RUN [--cache CACHE] [--draws 12] [--only held-out]

The motions are those that `over_time.py` left in CACHE, of 3 s or of 30 s and more; without CACHE they are
drawn as the model says, which is no measurement (`gps_integrity_flights.py`). IMU (EuRoC's noise
densities, turn-on biases), GPS (5 a second, 1.5 m an axis) and the start are drawn, the same for both.
Flights of 30 s and more lose GPS for 20 s, once; and GPS is carried off from 10 s on, for the monitor, whose
thresholds are of `drawn_maxima` on each flight.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from error_state_filter import (
    GRAVITY_N_MPS2,
    Coloured,
    ErrorStateFilter,
    Imu,
    P,
    Start,
    Truth,
    drawn_imu,
    nees,
    true_flight,
)
from flowlik.datasets import GpsFixes, ImuNoise, ImuSamples
from flowlik.fusion import (
    ColouredGps,
    Fused,
    FusedState,
    FusionSettings,
    GpsInnovations,
    drawn_maxima,
    false_alarm_threshold,
    fuse,
    normalised_innovations_squared,
    ramp_test,
)
from flowlik.likelihood.model_file import load_likelihood
from flowlik.odometry import FlowFactor
from flowlik.results.records import Record, protocol, write_records
from fused_over_time import GPS_PER_SECOND, GPS_SIGMA_M, JUDGED_PER_SECOND, Factors, poses_of, told, ways
from gps_integrity import A_FLIGHT, ONSET_S, RATES_MPS, THRESHOLD_DRAWS, carried_off
from gps_integrity_flights import (
    COLOURED,
    GPS_MEMORY_S,
    WHITE,
    Flight,
    Receiver,
    drawn_flight,
    measured_flights,
    shifted,
)
from over_time import CALIBRATION, FRAMES_PER_SECOND

LONG_S = 29.9
OUTAGE_S = (8.0, 28.0)
ALLOWED = {"5 % a 33 s flight": float(-np.log1p(-A_FLIGHT) / 33 * 3600), "1 an hour": 1.0}
GOALS_S = {"white": (13.0, 8.0, 4.5, 2.5), "coloured": (20.0, 12.0, 7.0, 4.0)}


class Drawn(NamedTuple):
    """All but flow: the truth, IMU of all draws (N, D, 3), fixes (M, D, 3) at times, and the filter."""

    truth: Truth
    imu: Imu
    rates: np.ndarray
    forces: np.ndarray
    fix_times_s: np.ndarray
    fixes: np.ndarray
    robot: ErrorStateFilter


def drawn(flight: Flight, draws: int, seed: int, receiver: Receiver = WHITE, modelled: bool = False) -> Drawn:
    """All draws of a flight; a receiver's colour may be ``modelled`` by the filter."""
    imu, rng = Imu(), np.random.default_rng([seed, 11])
    truth = true_flight(*poses_of(flight.motions), imu.rate_hz)
    rates, forces = drawn_imu(truth, imu, draws, rng)
    coloured = Coloured(receiver.coloured_m, GPS_MEMORY_S) if modelled else None
    robot = ErrorStateFilter(truth, imu, Start(), draws, rng, coloured=coloured)
    each = round(imu.rate_hz / GPS_PER_SECOND)
    p = truth.p[each::each]
    kept = np.exp(-1 / GPS_PER_SECOND / GPS_MEMORY_S)
    slow = [rng.standard_normal((draws, 3))]
    for _ in p[1:]:
        slow.append(kept * slow[-1] + np.sqrt(1 - kept**2) * rng.standard_normal((draws, 3)))
    white = rng.standard_normal((len(p), draws, 3))
    fixes = p[:, None] + receiver.coloured_m * np.array(slow) + receiver.white_m * white
    return Drawn(truth, imu, rates, forces, truth.times_s[each::each], fixes, robot)


class Judged(NamedTuple):
    errors: np.ndarray
    covariances: np.ndarray

    @property
    def off_m(self) -> np.ndarray:
        """Distances (T, D) [m] from the true position."""
        return np.linalg.norm(self.errors[..., P], axis=-1)

    @property
    def said_m(self) -> np.ndarray:
        """Stated deviations (T, D) [m] of all axes together."""
        return np.sqrt(np.trace(self.covariances[..., P, P], axis1=-2, axis2=-1))


def by_filter(of: Drawn, flows: Sequence[FlowFactor | None], outage: tuple[float, float] | None) -> Judged:
    """Errors (T, D, 9) and covariances (T, D, 9, 9), twice a second."""
    truth, robot = of.truth, of.robot
    white_m = GPS_SIGMA_M if robot.coloured is None else COLOURED.white_m
    image, gps, judge = (
        round(of.imu.rate_hz / r) for r in (FRAMES_PER_SECOND, GPS_PER_SECOND, JUDGED_PER_SECOND)
    )
    errors, covariances = [], []
    for k in range(1, len(truth.times_s)):
        robot.propagate(of.rates[k - 1 : k + 1], of.forces[k - 1 : k + 1])
        if k % image == 0:
            if (factor := flows[k // image - 1]) is not None:
                robot.flow(factor)
            robot.clone()
            robot.age(1 / FRAMES_PER_SECOND)
        if k % gps == 0 and not lost(truth.times_s[k], outage):
            robot.gps(of.fixes[k // gps - 1], white_m)
        if k % judge == 0:
            errors.append(robot.errors(truth.R[k], truth.v[k], truth.p[k]))
            covariances.append(robot.C[:, :9, :9].copy())
    return Judged(np.array(errors), np.array(covariances))


def lost(time_s: float, outage: tuple[float, float] | None) -> bool:
    return outage is not None and outage[0] < time_s <= outage[1]


def starts_of(of: Drawn) -> list[FusedState]:
    """The filter's states, before it has gone anywhere."""
    robot, zero = of.robot, np.zeros(3)
    return [
        FusedState(
            0.0,
            robot.R[d].copy(),
            robot.p[d].copy(),
            robot.v[d].copy(),
            zero,
            zero,
            robot.C[d, :15, :15].copy(),
        )
        for d in range(robot.draws)
    ]


def by_smoother(
    of: Drawn,
    starts: list[FusedState],
    flows: Sequence[FlowFactor | None],
    outage: tuple[float, float] | None = None,
    coloured: ColouredGps | None = None,
) -> tuple[list[Fused], float]:
    """Every draw through the smoother, and processor time [ms] a frame."""
    imu, truth = of.imu, of.truth
    noise = ImuNoise(imu.gyroscope, imu.gyroscope_walk, imu.accelerometer, imu.accelerometer_walk)
    settings = FusionSettings(GRAVITY_N_MPS2, coloured=coloured)
    image = round(imu.rate_hz / FRAMES_PER_SECOND)
    kept = np.array([not lost(t, outage) for t in of.fix_times_s])
    sigma = np.full((int(kept.sum()), 3), GPS_SIGMA_M)
    found, begin = [], time.process_time()
    for d, start in enumerate(starts):
        samples = ImuSamples(truth.times_s, of.rates[:, d], of.forces[:, d], noise)
        fixes = GpsFixes(of.fix_times_s[kept], of.fixes[kept, d], sigma)
        found.append(fuse(start, truth.times_s[::image], flows, samples, fixes, settings))
    return found, 1e3 * (time.process_time() - begin) / len(starts) / len(flows)


def judged(of: Drawn, found: list[Fused]) -> Judged:
    """Errors and covariances of the smoother at the filter's moments."""
    truth = of.truth
    image, judge = (round(of.imu.rate_hz / r) for r in (FRAMES_PER_SECOND, JUDGED_PER_SECOND))
    errors, covariances = [], []
    for k in range(judge, len(truth.times_s), judge):
        states = [fused.states[k // image] for fused in found]
        R = np.array([state.R_n_b for state in states])
        theta = Rotation.from_matrix(np.swapaxes(R, 1, 2) @ truth.R[k]).as_rotvec()
        v, p = (np.array([getattr(s, name) for s in states]) for name in ("velocity_n_mps", "position_n_m"))
        errors.append(np.hstack([theta, truth.v[k] - v, truth.p[k] - p]))
        covariances.append([state.covariance[:9, :9] for state in states])
    return Judged(np.array(errors), np.array(covariances))


Keys = tuple[str, str, None, None, str, int, int]


def keys_of(flight: str, model: str, count: int, seed: int) -> Keys:
    return flight, model, None, None, "lcmsac", count, seed


def agreement(
    name: str, flights: Sequence[Flight], factors: dict[str, Factors], draws: int, form: str
) -> Iterator[Record]:
    """Smoother and filter on the same draws, a record a flight and figure."""
    rows: dict[str, list[dict[str, float]]] = {"filter": [], "smoother": []}
    speeds = []
    for seed, flight in enumerate(flights):
        of, flows = drawn(flight, draws, seed), [factors[form](m) for m in flight.motions.estimated]
        found, ms = by_smoother(of, starts_of(of), flows)
        speeds.append(ms)
        keys = keys_of(flight.name, name, draws, seed)
        text = f"{flight.name:28} {form:15}"
        for who, result in (("filter", by_filter(of, flows, None)), ("smoother", judged(of, found))):
            values = told(*result)
            rows[who].append({metric: value for metric, (value, _) in values.items()})
            note = protocol(by=who, form=form, seconds=f"{flight.seconds:.0f}", gps_m=GPS_SIGMA_M)
            yield from (Record(metric, value, unit, *keys, note) for metric, (value, unit) in values.items())
            nees_mean, _, attitude, velocity, position = (value for value, _ in values.values())
            text += f" | {who} NEES {nees_mean:5.2f} {attitude:.3f} deg {velocity:.4f} m/s {position:.3f} m"
        nis = [
            normalised_innovations_squared(i.innovations_m, i.innovation_covariances_m2).mean()
            for i in (fused.innovations for fused in found)
        ]
        yield Record("smoother_ms_per_frame", ms, "ms", *keys, protocol(form=form))
        yield Record("nis_mean", float(np.mean(nis)), "", *keys, protocol(form=form))
        print(text, f"| NIS {np.mean(nis):.2f} | {ms:.2f} ms a frame", flush=True)
    for metric in rows["filter"][0]:
        by_filter_, by_smoother_ = (float(np.mean([row[metric] for row in rows[who]])) for who in rows)
        ratio = by_smoother_ / by_filter_
        print(f"  {form} {metric:18} filter {by_filter_:8.4f} smoother {by_smoother_:8.4f} ratio {ratio:.4f}")
        note = protocol(by="smoother over filter", form=form)
        yield Record(f"{metric}_ratio", ratio, "", *keys_of("all", name, draws * len(flights), 0), note)
    share = np.median(speeds) * FRAMES_PER_SECOND / 10
    print(f"  {np.median(speeds):.2f} ms a frame: {share:.0f} % of a core at 60 Hz", flush=True)


def outages(
    name: str, flights: Sequence[Flight], factors: dict[str, Factors], draws: int
) -> Iterator[Record]:
    """Position after 20 s without GPS, of both, in metres, of the path, and over what is said."""
    last = round(OUTAGE_S[1] * JUDGED_PER_SECOND) - 1
    for way in ("given-rotation", "full", "imu-gps"):
        rows: dict[str, list[tuple[float, ...]]] = {"smoother": [], "filter": []}
        for seed, flight in enumerate(flights):
            of, flows = drawn(flight, draws, seed), [factors[way](m) for m in flight.motions.estimated]
            smoothed = judged(of, by_smoother(of, starts_of(of), flows, OUTAGE_S)[0])
            within = (of.truth.times_s >= OUTAGE_S[0]) & (of.truth.times_s <= OUTAGE_S[1])
            path_m = np.linalg.norm(np.diff(of.truth.p[within], axis=0), axis=1).sum()
            keys = keys_of(flight.name, name, draws, seed)
            for who, result in (("smoother", smoothed), ("filter", by_filter(of, flows, OUTAGE_S))):
                off, said = (float(np.sqrt((v[last] ** 2).mean())) for v in (result.off_m, result.said_m))
                at_end = float(nees(result.errors[last], result.covariances[last]).mean())
                rows[who].append((off, said, 100 * off / path_m, at_end))
                note = protocol(by=who, form=way, outage_s=OUTAGE_S[1] - OUTAGE_S[0])
                yield Record("outage_position_m", off, "m", *keys, note)
                yield Record("outage_percent", 100 * off / path_m, "%", *keys, note)
                yield Record("outage_over_said", off / said, "", *keys, note)
        for who, of_who in rows.items():
            off, said, percent, at_end = np.mean(of_who, axis=0)
            each = " ".join(f"{row[0]:.2f}" for row in of_who)
            print(
                f"outage of 20 s, {way:15} {who:9} {off:6.2f} m (said {said:.2f}), {percent:.2f} % of path, "
                f"NEES {at_end:.1f} | {each}",
                flush=True,
            )


def monitored(
    name: str, flights: Sequence[Flight], factors: dict[str, Factors], draws: int
) -> Iterator[Record]:
    """Delays of the monitor's alarms on the smoother's innovations."""
    for kind, receiver in (("white", WHITE), ("coloured", COLOURED)):
        colour = ColouredGps(0.5, GPS_MEMORY_S) if receiver is COLOURED else None
        false: dict[str, list[bool]] = {name: [] for name in ALLOWED}
        delays: dict[tuple[str, float], list[float]] = {(w, r): [] for w in ALLOWED for r in RATES_MPS}
        for seed, flight in enumerate(flights):
            of = drawn(flight, draws, seed, receiver)
            flows = [factors["given-rotation"](motion) for motion in flight.motions.estimated]
            found, _ = by_smoother(of, starts_of(of), flows, coloured=colour)
            fixes = [fused.innovations for fused in found]
            maxima = drawn_maxima(fixes[0], THRESHOLD_DRAWS, np.random.default_rng([seed, 3]))
            for which, per_hour in ALLOWED.items():
                threshold = false_alarm_threshold(maxima, flight.seconds, per_hour)
                for d, one in enumerate(fixes):
                    clean = ramp_test(one).statistic > threshold
                    false[which].append(bool(clean.any()))
                    if clean[one.times_s <= ONSET_S].any():
                        continue
                    for rate in RATES_MPS:
                        shift = carried_off(one.times_s, rate, draws, seed)[:, d : d + 1]
                        delays[which, rate].append(delay(one, shift, threshold))
        seconds = float(np.mean([flight.seconds for flight in flights]))
        for which, alarms in false.items():
            share, keys = float(np.mean(alarms)), keys_of("all", name, len(alarms), 0)
            note = {"gps": kind, "allowed": which, "by": "smoother", "onset_s": ONSET_S}
            per_hour = -np.log1p(-share) / seconds * 3600 if share < 1 else np.inf
            yield Record("false_alarms_per_hour", per_hour, "1/h", *keys, protocol(**note))
            text = f"monitor, GPS {kind:9} {which:18} clean alarms {share:.3f} ({per_hour:.1f} an hour) |"
            for rate in RATES_MPS:
                values, at = np.array(delays[which, rate]), protocol(**note, rate_mps=rate)
                median, late = np.quantile(values, [0.5, 0.9], method="higher")
                missed = float(np.isinf(values).mean())
                yield Record("detection_delay_s", median, "s", *keys, f"{at}; quantile=median")
                yield Record("detection_delay_s", late, "s", *keys, f"{at}; quantile=p90")
                yield Record("missed_fraction", missed, "", *keys, at)
                text += f" {rate:g} m/s: {median:.1f} ({late:.1f}) s, missed {missed:.3f};"
            print(text, "goal", GOALS_S[kind], flush=True)


def delay(fixes: GpsInnovations, shift_m: np.ndarray, threshold: float) -> float:
    """Time [s] from the onset of a shift (N, 1, 3) [m] to its alarm; inf if there is none."""
    moved = replace(fixes, innovations_m=fixes.innovations_m + shifted(fixes, shift_m)[:, 0])
    alarms = (ramp_test(moved).statistic > threshold) & (fixes.times_s > ONSET_S)
    return float(fixes.times_s[alarms.argmax()] - ONSET_S) if alarms.any() else np.inf


def chosen(cache: Path, model: str, only: str | None, most: int | None) -> Iterator[Flight]:
    """Flights of the cache: all, or those that were not calibrated on."""
    fitted = {flight.name for flight in CALIBRATION}
    flights = [f for f in measured_flights(cache, model, 0.0) if only != "held-out" or f.name not in fitted]
    yield from flights[:most]


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--cache", type=Path, help="motions of over_time.py; drawn ones without")
    parser.add_argument("--drawn", type=int, default=8, help="flights of 33 s, where there is no cache")
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--models", nargs="+", default=("lucas-kanade",))
    parser.add_argument("--draws", type=int, default=12)
    parser.add_argument("--only", choices=["held-out"], help="leave the flights of the calibration out")
    parser.add_argument("--most", type=int, help="only so many flights")
    parser.add_argument("--parts", nargs="+", default=["agreement", "outages", "monitor"])
    options = parser.parse_args()
    records: list[Record] = []
    for model in options.models:
        likelihood = load_likelihood(model)
        factors = ways(likelihood, likelihood.shared_errors.over_time)
        if options.cache is None:
            stays = likelihood.shared_errors.over_time
            flights = [drawn_flight(seed, 33.0, stays) for seed in range(options.drawn)]
        else:
            flights = list(chosen(options.cache, model, options.only, options.most))
        long = [f for f in flights if f.seconds >= LONG_S]
        if "agreement" in options.parts:
            for form in ("given-rotation", "full"):
                records += agreement(model, flights, factors, options.draws, form)
        if long and "outages" in options.parts:
            records += outages(model, long, factors, options.draws)
        if long and "monitor" in options.parts:
            records += monitored(model, long, factors, options.draws)
    options.out.mkdir(parents=True, exist_ok=True)
    write_records(options.out / "metrics.json", records)


if __name__ == "__main__":
    main()
