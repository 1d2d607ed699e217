"""Records, figures and warnings of `flowlik fuse`."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from flowlik.commands._fuse_flight import FusedFlight
from flowlik.commands.fuse_options import FuseOptions
from flowlik.datasets.base import notes_of
from flowlik.datasets.selection import Skipped
from flowlik.evaluation.motion import consistency, consistency_records, status_records, trajectory_records
from flowlik.fusion import DirectionFactor
from flowlik.results.records import Record, protocol
from flowlik.results.runs import RunFolder
from flowlik.support.arrays import Array

UNITS = {"attitude": ("deg", float(np.rad2deg(1.0))), "velocity": ("mps", 1.0), "position": ("m", 1.0)}


def report_fusion(run: RunFolder, flight: FusedFlight, options: FuseOptions, skipped: list[Skipped]) -> None:
    """Add records, figures and warnings to a run."""
    run.records = _records(flight, options)
    _save_figures(run, flight)
    name = flight.sequence.name
    for bad in skipped:
        run.warn(f"{name}: frame {bad.frame} skipped: {bad.reason}")
    for note in notes_of(flight.sequence):
        run.warn(note)
    lost, count = sum(factor is None for factor in flight.factors), len(flight.factors)
    if lost:
        run.warn(f"{name}: {lost} of {count} frames told no motion and gave no factor; frames.csv says why")
    fixes, used = flight.sensors.fixes, int(flight.fused.used_fixes.sum())
    if fixes is not None and used < len(fixes.times_s):
        count = len(fixes.times_s)
        run.warn(f"{name}: {count - used} of {count} fixes lie outside the frames' time")
    if fixes is not None and fixes.left_out:
        run.warn(f"{name}: {fixes.left_out} messages of GPS had no fix")
    if (alarm := flight.seen.alarm) is not None:
        begin, end = (t - flight.fused.times_s[0] for t in alarm.onset_interval_s)
        speed = float(np.linalg.norm(alarm.rate_n_mps))
        run.warn(
            f"{name}: GPS does not agree with IMU and flow: alarm at {alarm.time_s:.9g} s, of a drift of "
            f"{speed:.2g} m/s that began {begin:.1f} to {end:.1f} s after the first state; from the alarm on "
            "states are those without GPS since then"
        )


def _records(flight: FusedFlight, options: FuseOptions) -> list[Record]:
    settings, estimator = flight.sensors.settings, flight.estimator
    coloured = settings.coloured
    keys = {
        "fused": "imu+flow" if flight.sensors.fixes is None else "imu+flow+gps", "form": options.form,
        "residual": "epipolar" if any(isinstance(f, DirectionFactor) for f in flight.factors) else "depth",
        "long_run_factor": options.long_run_factor, "lag_s": options.lag_s,
        "gps_coloured": None if coloured is None else f"{coloured.share:g} {coloured.memory_s:g} s",
        "start": {None: "found", "truth": "truth"}.get(options.initial, "given"),
        "align_s": settings.alignment_s or None, **options.images,
    }  # fmt: skip
    states, seen = flight.fused.states, flight.seen
    plain = Record(
        "frames", float(len(states)), "", flight.sequence.name, flight.flow, estimator.likelihood.family.name,
        estimator.likelihood.schedule.name, estimator.name, len(states), options.seed, protocol(**keys),
    )  # fmt: skip

    def record(metric: str, value: float | None, unit: str, count: int | None = None) -> Record:
        return replace(plain, metric=metric, value=value, unit=unit, count=count)

    count = len(flight.sequence)
    told = [factor is not None for factor in flight.factors[flight.first :]]
    records = [
        record("flow_factor_fraction", float(np.mean(told)), "", len(told)),
        record("smoother_frames_per_second", count / flight.seconds, "1/s", count),
        *status_records(flight.motions[flight.first :], plain),
    ]
    for name, (unit, factor) in UNITS.items():
        shown = unit.replace("mps", "m/s")
        median = factor * float(np.median(flight.sigmas[name]))
        records.append(record(f"{name}_sigma_median_{unit}", median, shown, len(states)))
    for sensor, without in flight.without.items():
        for name, sigma in without.items():
            share = float(np.median(1 - (flight.sigmas[name][1:] / sigma[1:]) ** 2))
            records.append(record(f"information_share_{sensor}_{name}", share, "", len(states) - 1))
    if flight.sensors.fixes is not None:
        fixes = len(seen.nis)
        records.append(record("nis_mean", float(np.mean(seen.nis)) if fixes else None, "", fixes))
        records.append(record("gps_alarms", float(seen.alarm is not None), "", fixes))
    return [*records, *_against_truth(flight, plain, keys)]


def _against_truth(flight: FusedFlight, plain: Record, keys: dict[str, object]) -> list[Record]:
    truth, errors = flight.truth_there, flight.pose_errors
    if truth is None or errors is None:
        return []
    count = len(errors)
    turn, place = (np.sqrt((part**2).sum(axis=1).mean()) for part in (errors[:, :3], errors[:, 3:]))
    records = [
        replace(plain, metric="attitude_rms_deg", value=float(np.rad2deg(turn)), unit="deg", count=count),
        replace(plain, metric="position_rms_m", value=float(place), unit="m", count=count),
    ]
    found = consistency(errors, flight.covariances.poses)
    records += consistency_records(found, plain, "smoother")
    records += trajectory_records(
        flight.trajectory, truth, str(plain.dataset), plain.flow, plain.family, plain.schedule,
        plain.estimator, plain.seed, **keys,
    )  # fmt: skip
    return records


def _save_figures(run: RunFolder, flight: FusedFlight) -> None:
    """Save what the figures of a run show."""
    times_s, fused, seen = flight.fused.times_s, flight.fused, flight.seen
    arrays: dict[str, Array] = {
        "names": np.array(["fused"]),
        "positions": flight.trajectory.positions[None],
        "timestamps": times_s,
        "unit": np.array("m"),
        "unsolved": np.array([[False, *(f is None for f in flight.factors[flight.first :])]]),
    }
    if flight.truth_there is not None:
        arrays["truth"] = flight.truth_there.positions
    run.save("trajectories", flight.flow, arrays)
    if len(seen.nis):
        told: dict[str, Array] = {
            "timestamps": seen.fixes.times_s - times_s[0],
            "innovations": seen.fixes.innovations_m,
            "sigma": np.sqrt(np.diagonal(seen.fixes.innovation_covariances_m2, axis1=1, axis2=2)),
            "nis": seen.nis,
        }
        if seen.test is not None and seen.threshold is not None:
            told |= {"statistic": seen.test.statistic, "threshold": np.array(seen.threshold)}
        if seen.alarm is not None:
            told["alarm"] = np.array([seen.alarm.time_s, *seen.alarm.onset_interval_s]) - times_s[0]
        run.save("innovations", flight.flow, told)
    biases = [[*s.gyroscope_bias_radps, *s.accelerometer_bias_mps2] for s in fused.states]
    variances = np.diagonal(fused.covariances, axis1=1, axis2=2)[:, 9:15]
    shown = {"timestamps": times_s - times_s[0], "values": np.array(biases), "sigma": np.sqrt(variances)}
    run.save("biases", flight.flow, shown)
    everything = {"all": flight.sigmas} | {f"without {k}": v for k, v in flight.without.items()}
    run.save(
        "contributions",
        flight.flow,
        {
            "timestamps": times_s - times_s[0],
            "names": np.array([name.replace("gps", "GPS") for name in everything]),
            **{part: np.array([sigmas[part] for sigmas in everything.values()]) for part in UNITS},
        },
    )
