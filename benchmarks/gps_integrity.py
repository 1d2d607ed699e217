"""When a monitor of GPS notices that it lies: delays of its alarms, at one rate of false alarms for all.

    python benchmarks/gps_integrity.py --out RUN [--cache CACHE] [--flights 20] [--draws 12] [--answers 2]

Flights of `--seconds` at 60 frames/s with an IMU (EuRoC's noise densities, turn-on biases) at 120 Hz and GPS
(5 a second, 1.5 m an axis) go through the error-state filter of `error_state_filter.py`. Motions are those of
CACHE that are long enough, in the layout of `over_time.py`; without CACHE they are drawn: a smooth path whose
flow errs as the model says that it does, which is no measurement, or (`--errors`) as motions of flights of
3 s did, one after the other (`PIECES`). GPS is carried off at a constant speed from 10 s on, level, in a
direction that is drawn. Thresholds are of `drawn_maxima` on all flights, for 5 % false alarms a flight and
for one an hour; clean flights count how many there were.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.stats import chi2

from flowlik.fusion import (
    GpsInnovations,
    drawn_maxima,
    false_alarm_threshold,
    normalised_innovations_squared,
    ramp_alarm,
    ramp_test,
    trusted_fixes,
    windowed_nis,
)
from flowlik.likelihood.model_file import load_likelihood
from flowlik.results.records import Record, protocol, write_records
from fused_over_time import GPS_PER_SECOND, Factors, ways
from gps_integrity_flights import (
    COLOURED,
    WHITE,
    Filtered,
    Flight,
    Receiver,
    drawn_flight,
    filtered,
    measured_flights,
    shifted,
    with_errors_of,
)

# flights of 3 s that the shipped models' errors over time were not fitted on at first
PIECES = ("forest-forest-fig8-6-300", "forest-curve-6-301", "planes-training-4-303", "forest-training-9-305")
RATES_MPS = (0.2, 0.5, 1.0, 2.0)
ONSET_S = 10.0
NIS_WINDOW_S = 10.0
AFTER_S = 30.0
A_FLIGHT = 0.05
THRESHOLD_DRAWS = 100  # a flight; those of all flights together give the threshold


class Monitor(NamedTuple):
    """A filter's flow, the receiver, whether its colour is modelled, and a statistic of innovations."""

    flow: str
    statistic: str = "glrt"
    receiver: Receiver = WHITE
    modelled: bool = True


MONITORS = {
    "flowlik": Monitor("given-rotation"),
    "imu-only": Monitor("imu-gps"),
    "vins-weights": Monitor("vins-weights"),
    "per-fix-gate": Monitor("given-rotation", "nis"),
    "windowed-nis": Monitor("given-rotation", "windowed-nis"),
    "flowlik, coloured GPS": Monitor("given-rotation", "glrt", COLOURED),
    "flowlik, coloured GPS taken as white": Monitor("given-rotation", "glrt", COLOURED, False),
}


def statistics(name: str, fixes: GpsInnovations, innovations: np.ndarray) -> np.ndarray:
    """Statistic (N, D) of innovations (N, D, 3)."""
    if name == "glrt":
        return ramp_test(fixes, innovations_m=innovations).statistic
    nis = normalised_innovations_squared(innovations, fixes.innovation_covariances_m2[:, None])
    return nis if name == "nis" else windowed_nis(fixes.times_s, nis, NIS_WINDOW_S)


def white_maxima(name: str, fixes: GpsInnovations, draws: int, rng: np.random.Generator) -> np.ndarray:
    """Largest statistics (draws,) of flights whose innovations are what the filter says."""
    if name == "glrt":
        return drawn_maxima(fixes, draws, rng)
    nis = chi2(3).rvs((len(fixes.times_s), draws), random_state=rng)
    statistic = nis if name == "nis" else windowed_nis(fixes.times_s, nis, NIS_WINDOW_S)
    return statistic.max(axis=0)


def carried_off(times_s: np.ndarray, rate_mps: float, draws: int, seed: int) -> np.ndarray:
    """Shifts (N, draws, 3) [m] of fixes, level, in directions that are drawn."""
    heading = np.random.default_rng([seed, 7]).uniform(0, 2 * np.pi, draws)
    level = np.stack([np.sin(heading), np.zeros(draws), np.cos(heading)], axis=1)
    return rate_mps * np.maximum(times_s - ONSET_S, 0)[:, None, None] * level


class Judged(NamedTuple):
    """Of every draw: whether a clean flight alarms, and by rate the delay [s], inf where missed."""

    false_alarms: np.ndarray
    delays_s: dict[float, np.ndarray]
    nis_mean: float


def told(monitor: Monitor, flown: Filtered, seed: int) -> dict[float, np.ndarray]:
    """Statistics (N, draws) of one flight, clean (rate 0) and carried off at each rate."""
    fixes, draws = flown.record, flown.innovations.shape[1]
    changes = {
        rate: shifted(fixes, carried_off(fixes.times_s, rate, draws, seed)) for rate in (0.0, *RATES_MPS)
    }
    return {r: statistics(monitor.statistic, fixes, flown.innovations + c) for r, c in changes.items()}


def judge(flown: Filtered, statistic: dict[float, np.ndarray], threshold: float) -> Judged:
    """Alarms of one flight's draws at a threshold; draws that alarm before the onset have no delay (NaN)."""
    fixes = flown.record
    clean = statistic[0.0] > threshold
    before = clean[fixes.times_s <= ONSET_S].any(axis=0)
    delays = {}
    for rate in RATES_MPS:
        alarms = statistic[rate] > threshold
        alarms[fixes.times_s <= ONSET_S] = False
        delay = np.where(alarms.any(axis=0), fixes.times_s[alarms.argmax(axis=0)] - ONSET_S, np.inf)
        delays[rate] = np.where(before, np.nan, delay)
    nis = normalised_innovations_squared(flown.innovations, fixes.innovation_covariances_m2[:, None])
    return Judged(clean.any(axis=0), delays, float(nis.mean()))


def judged(
    names: Sequence[str], flights: Sequence[Flight], factors: dict[str, Factors], draws: int
) -> dict[str, dict[str, list[Judged]]]:
    """What monitors make of all flights, by names and rates of false alarms; each filter flies once."""
    flown: dict[str, list[Filtered]] = {name: [] for name in names}
    maxima: dict[str, list[np.ndarray]] = {name: [] for name in names}
    for seed, flight in enumerate(flights):
        done: dict[tuple[str, Receiver, bool], Filtered] = {}
        for name in names:
            monitor = MONITORS[name]
            key = monitor.flow, monitor.receiver, monitor.modelled
            if key not in done:
                flow, receiver, modelled = key
                done[key] = filtered(flight.motions, factors[flow], draws, seed, receiver, modelled)
            flown[name].append(done[key])
            rng = np.random.default_rng([seed, 3])
            maxima[name].append(white_maxima(monitor.statistic, done[key].record, THRESHOLD_DRAWS, rng))
        print(f"{flight.name}: flown", flush=True)
    seconds = float(np.mean([flight.seconds for flight in flights]))
    rates = {"5 % a flight": -np.log1p(-A_FLIGHT) / seconds * 3600, "1 an hour": 1.0}
    found: dict[str, dict[str, list[Judged]]] = {}
    for name in names:
        pooled = np.concatenate(maxima[name])
        statistic = [told(MONITORS[name], one, seed) for seed, one in enumerate(flown[name])]
        for rate, per_hour in rates.items():
            threshold = false_alarm_threshold(pooled, seconds, per_hour)
            pairs = zip(flown[name], statistic)
            found.setdefault(name, {})[rate] = [judge(one, values, threshold) for one, values in pairs]
    return found


def records_of(
    name: str, rate: str, found: list[Judged], flights: Sequence[Flight], kind: str, model: str, draws: int
) -> Iterator[Record]:
    """Figures over all flights, and a line of them."""
    seconds = float(np.mean([f.seconds for f in flights]))
    note = {"flow": kind, "monitor": name, "allowed": rate, "seconds": f"{seconds:.0f}", "onset_s": ONSET_S}
    count = draws * len(flights)
    keys = ("all", model, None, None, "lcmsac", count, 0)
    false = np.concatenate([j.false_alarms for j in found])
    share = float(false.mean())
    text = f"{name:38} {rate:13} NIS {np.mean([j.nis_mean for j in found]):5.2f} clean alarms {share:.3f} |"
    yield Record("nis_mean", np.mean([j.nis_mean for j in found]), "", *keys, protocol(**note))
    yield Record("false_alarm_fraction", share, "", *keys, protocol(**note))
    per_hour = -np.log1p(-share) / seconds * 3600 if share < 1 else np.inf
    yield Record("false_alarms_per_hour", per_hour, "1/h", *keys, protocol(**note))
    for speed in RATES_MPS:
        delays = np.concatenate([j.delays_s[speed] for j in found])
        delays = delays[~np.isnan(delays)]
        at = protocol(**note, rate_mps=speed)
        missed = float(np.isinf(delays).mean()) if len(delays) else 1.0
        quantiles = np.quantile(delays, [0.5, 0.9], method="higher") if len(delays) else [np.inf, np.inf]
        for which, value in zip(("median", "p90"), quantiles):
            yield Record("detection_delay_s", value, "s", *keys, f"{at}; quantile={which}")
        yield Record("missed_fraction", missed, "", *keys, at)
        text += f" {speed:g}: {quantiles[0]:.1f} ({quantiles[1]:.1f}) {missed:.3f}"
    print(text, flush=True)


def answers(
    flights: Sequence[Flight], factors: dict[str, Factors], draws: int, model: str, kind: str
) -> Iterator[Record]:
    """How far off positions are under attack: with the answer to the alarm, by a gate, and undisturbed."""
    found: dict[tuple[str, float], list[tuple[float, ...]]] = {}
    speeds = np.repeat(RATES_MPS, draws)
    per_hour = -np.log1p(-A_FLIGHT) / 33.0 * 3600
    gate = float(chi2(3).isf(-np.expm1(np.log1p(-A_FLIGHT) / round(33.0 * GPS_PER_SECOND))))
    for seed, flight in enumerate(flights):
        fixes_s = np.arange(1, round(flight.seconds * GPS_PER_SECOND) + 1) / GPS_PER_SECOND
        shift_m = carried_off(fixes_s, 1.0, len(speeds), seed) * speeds[:, None]

        def flown(
            flow: str, of: Flight = flight, number: int = seed, shift: np.ndarray = shift_m, **options
        ) -> Filtered:  # type: ignore[no-untyped-def]
            return filtered(of.motions, factors[flow], len(speeds), number, shift_m=shift, **options)

        fooled = flown("given-rotation")
        fixes = fooled.record
        maxima = drawn_maxima(fixes, 3 * THRESHOLD_DRAWS, np.random.default_rng([seed, 5]))
        threshold = false_alarm_threshold(maxima, flight.seconds, per_hour)
        alarms = [
            ramp_alarm(replace(fixes, innovations_m=fooled.innovations[:, d]), threshold)
            for d in range(len(speeds))
        ]
        taken = np.stack([trusted_fixes(fixes.times_s, alarm) for alarm in alarms], axis=1)
        runs = {
            "answered": flown("given-rotation", taken=taken),
            "gate": flown("given-rotation", gate=gate),
            "undisturbed": fooled,
            "vins-weights": flown("vins-weights"),
        }
        for d, alarm in enumerate(alarms):
            if alarm is None or alarm.time_s <= ONSET_S:
                continue
            now = int(np.searchsorted(fixes.times_s, alarm.time_s))
            later = slice(now, now + round(AFTER_S * GPS_PER_SECOND))
            for name, run in runs.items():
                off = np.linalg.norm(run.errors[:, d], axis=1)
                values = off[now], off[later].max(), alarm.onset_s - ONSET_S
                found.setdefault((name, speeds[d]), []).append(values)
        print(f"{flight.name}: answered", flush=True)
    for (name, speed), values in sorted(found.items()):
        at, most, onset = np.array(values).T
        texts = [f"{np.median(q):.2f} ({np.quantile(q, 0.9):.2f})" for q in (at, most)]
        print(
            f"{name:12} {speed:g} m/s {len(at)}: at the alarm {texts[0]}, worst of {AFTER_S:g} s {texts[1]}, "
            f"onset off by {np.median(onset):+.1f} s ({onset.std():.1f})",
            flush=True,
        )
        note = protocol(flow=kind, way=name, rate_mps=speed, seconds_after=AFTER_S)
        keys = ("all", model, None, None, "lcmsac", len(at), 0)
        for metric, quantity in (("position_at_alarm_m", at), ("position_after_alarm_m", most)):
            for which, q in (("median", 0.5), ("p90", 0.9)):
                value = float(np.quantile(quantity, q))
                yield Record(metric, value, "m", *keys, f"{note}; quantile={which}")


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--cache", type=Path, help="motions of over_time.py; drawn ones without")
    parser.add_argument("--errors", type=Path, help="motions of over_time.py whose errors drawn flights get")
    parser.add_argument("--model", default="lucas-kanade")
    parser.add_argument("--flights", type=int, default=20, help="drawn flights")
    parser.add_argument(
        "--seconds", type=float, default=33.0, help="of a drawn flight; measured ones: at least 30"
    )
    parser.add_argument("--draws", type=int, default=12)
    parser.add_argument("--monitors", nargs="*", default=list(MONITORS), choices=list(MONITORS))
    parser.add_argument("--answers", type=int, default=2, help="flights of 60 s on which alarms are answered")
    options = parser.parse_args()
    model = load_likelihood(options.model)
    stays = model.shared_errors.over_time
    factors = ways(model, stays)
    if options.cache is not None:
        flights, kind = list(measured_flights(options.cache, options.model, 29.9)), "measured"
    else:
        flights = [drawn_flight(seed, options.seconds, stays) for seed in range(options.flights)]
        kind = "drawn"
    if options.errors is not None:
        found = measured_flights(options.errors, options.model, 0.0)
        pieces = [flight.motions for flight in found if flight.name in PIECES]
        if not pieces:
            raise SystemExit(f"{options.errors}: none of {', '.join(PIECES)}")
        flights, kind = [with_errors_of(f, pieces, seed) for seed, f in enumerate(flights)], "pieces"
    if not flights:
        raise SystemExit(f"{options.cache}: no flight of 30 s")
    records: list[Record] = []
    for name, of_rates in judged(options.monitors, flights, factors, options.draws).items():
        for rate, found in of_rates.items():
            records += records_of(name, rate, found, flights, kind, options.model, options.draws)
    if options.answers:
        if options.cache is None:
            flights = [drawn_flight(1000 + seed, 60.0, stays) for seed in range(options.answers)]
        records += answers(
            flights[: options.answers], factors, max(options.draws // 2, 1), options.model, kind
        )
    options.out.mkdir(parents=True, exist_ok=True)
    write_records(options.out / "metrics.json", records)


if __name__ == "__main__":
    main()
