"""The paper's Table II and Figure 7: drift and per-frame errors of every variant on long flights."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.spatial.transform import RigidTransform

from egomotion_consistency import judged
from egomotion_flights import FRAMES, WORLD_SEEDS, Exposed, TableFlight, description, rendered
from egomotion_variants import Variants, label, residuals, variants
from flowlik.egomotion import ByVector, EgoMotion
from flowlik.evaluation.motion import RelativeErrors, drift_percent, relative_pose_errors, true_trajectory
from flowlik.flow import flow_method
from flowlik.geometry.trajectory import Trajectory, chain
from flowlik.measurement.features import features_of
from flowlik.odometry._constant_velocity import ConstantVelocity
from flowlik.results.records import Record, protocol
from flowlik.results.runs import RunFolder
from flowlik.support.progress import Progress

BLOCK = 10
REPLICATES = 1000

PAPER = {
    ("farneback", "straight"): (1.410, 0.707),
    ("farneback", "forest-fig8"): (4.161, 0.669),
    ("lucas-kanade", "straight"): (0.720, 0.503),
    ("lucas-kanade", "forest-fig8"): (1.513, 1.010),
}
"""Drift [%] of RANSAC and LCMSAC in the paper's Table II."""


@dataclass(frozen=True)
class Flown:
    """One variant's way through one flight as one sensor saw it."""

    trajectory: Trajectory
    errors: RelativeErrors
    unsolved: np.ndarray
    drift_percent: float
    motions: list[EgoMotion]


def table(
    run: RunFolder,
    cache: Path,
    methods: tuple[str, ...],
    frames: int | None,
    world_seeds: int,
    sensor_seeds: int,
    progress: Progress,
    trajectories: tuple[str, ...] = tuple(FRAMES),
) -> None:
    """Fly every method and variant; records and figures go to the run."""
    for trajectory in trajectories:
        count = min(frames or FRAMES[trajectory], FRAMES[trajectory])
        flights = [TableFlight(trajectory, seed, count) for seed in WORLD_SEEDS[:world_seeds]]
        folders = [rendered(flight, cache, progress) for flight in flights]
        seen = [
            [Exposed(flight, folder, flight.seed + 1000 * sensor) for sensor in range(sensor_seeds)]
            for flight, folder in zip(flights, folders)
        ]
        for of_world in seen:
            run.records += description(of_world[0])
        for method in methods:
            everyone = variants(method, cache)
            flown = [fly(s, everyone, progress) for of_world in seen for s in of_world]
            run.records += list(records_of(everyone, trajectory, flown, world_seeds, sensor_seeds))
            run.records += judged(
                everyone, f"forest-{trajectory}", [f[1] for f in flown], truths=[f[0] for f in flown]
            )
            _figures(run, f"{method}-{trajectory}", *flown[0])
            _print(method, trajectory, run.records)


def fly(sequence: Exposed, everyone: Variants, progress: Progress) -> tuple[Trajectory, dict[str, Flown]]:
    """Truth, and everyone's trajectory; frames that could not be solved are predicted."""
    truth = true_trajectory(sequence, len(sequence))
    assert truth is not None
    pairs = residuals(sequence, everyone.method, list(range(len(sequence) - 1)), 10_000 * sequence.seed)
    what = f"{everyone.method} on {sequence.name}, sensor {sequence.seed}"
    found = everyone.motions_over(progress(pairs, what, len(sequence) - 1), sequence.seed)
    return truth, {name: _flown(motions, truth) for name, motions in found.items()}


def _flown(found: list[EgoMotion | RigidTransform | None], truth: Trajectory) -> Flown:
    """Chain motions; where there is none, odometry's prediction stands in, for rivals as for ours."""
    model, steps, unsolved, motions = ConstantVelocity(), [], [], []
    for motion in found:
        T = motion.T_k_prev if isinstance(motion, EgoMotion) else motion
        lost = T is None or (isinstance(motion, EgoMotion) and not motion.solved)
        if isinstance(motion, EgoMotion):
            motions.append(motion)
        if T is None or lost:
            T, _ = model.predict()
            model = model.untold()
        else:
            model = model.told(T, motion.covariance if isinstance(motion, EgoMotion) else np.eye(6) * 1e-8)
        steps.append(T)
        unsolved.append(lost)
    trajectory = Trajectory(truth.timestamps, chain(steps))
    errors = relative_pose_errors(trajectory, truth)
    return Flown(trajectory, errors, np.array(unsolved), drift_percent(trajectory, truth), motions)


def records_of(
    everyone: Variants,
    trajectory: str,
    flown: list[tuple[Trajectory, dict[str, Flown]]],
    world_seeds: int,
    sensor_seeds: int,
) -> Iterator[Record]:
    """Drift of each flight with mean and range, per-frame errors pooled over flights with intervals."""
    truth = flown[0][0]
    for name in everyone.names:
        ways = [of_flight[name] for _, of_flight in flown]
        keys = dict(
            align="none", scale="depth", residual="depth", features=features_of(flow_method(everyone.method)),
            gate=_gate(everyone, name), frames=len(truth), length_m=f"{truth.length:.1f}",
            worlds=world_seeds, sensors=sensor_seeds, settings=_settings(everyone, name),
        )  # fmt: skip
        family, schedule = _density(everyone, name)
        base = Record(
            "", None, "", f"forest-{trajectory}", label(everyone.method), family, schedule, name,
            count=len(ways), seed=WORLD_SEEDS[0], protocol=protocol(**keys),
        )  # fmt: skip
        drifts = [way.drift_percent for way in ways]
        spread = protocol(flights=" ".join(f"{d:.3f}" for d in drifts))
        yield replace(
            base, metric="drift_percent", value=float(np.mean(drifts)), unit="%",
            protocol=f"{base.protocol}; {spread}",
        )  # fmt: skip
        unsolved = np.concatenate([way.unsolved for way in ways])
        yield replace(base, metric="unsolved_fraction", value=float(unsolved.mean()), count=len(unsolved))
        for metric, unit, errors in (
            ("trans", "m", [way.errors.translation_m for way in ways]),
            ("rot", "deg", [way.errors.rotation_deg for way in ways]),
        ):
            for statistic, f in (("median", np.median), ("rms", _rms)):
                value, low, high = with_interval(errors, f)
                note = protocol(interval_95=f"{low:.3g} … {high:.3g}", bootstrap=f"blocks of {BLOCK} frames")
                yield replace(
                    base, metric=f"rpe_{metric}_{statistic}_{unit}", value=value, unit=unit,
                    count=sum(map(len, errors)), protocol=f"{base.protocol}; {note}",
                )  # fmt: skip


def with_interval(
    errors: list[np.ndarray], statistic: Callable[[np.ndarray], float]
) -> tuple[float, float, float]:
    """Statistic of the pooled errors, and its 95 % interval over blocks of neighbouring frames."""
    # short runs in five blocks at least
    blocks = [b for e in errors for b in np.array_split(e, max(len(e) // BLOCK, min(len(e), 5)))]
    rng = np.random.default_rng(0)
    draws = [
        statistic(np.concatenate([blocks[i] for i in rng.integers(len(blocks), size=len(blocks))]))
        for _ in range(REPLICATES)
    ]
    low, high = np.percentile(draws, [2.5, 97.5])
    return float(statistic(np.concatenate(errors))), float(low), float(high)


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))


def _gate(everyone: Variants, name: str) -> object:
    gates = {e.name: e.gate for e in everyone.ours} | {n: r.gate for n, r in everyone.rivals.items()}
    return "none" if gates[name] is None else gates[name]


def _settings(everyone: Variants, name: str) -> str | None:
    rival = everyone.rivals.get(name)
    return None if rival is None else f"{rival.name} {rival.radius_px:g} px, best on calibration flights"


def _density(everyone: Variants, name: str) -> tuple[str | None, str | None]:
    for e in everyone.ours:
        if e.name == name:
            return e.likelihood.family.name, "constant" if isinstance(
                e.rule, ByVector
            ) else e.likelihood.schedule.name
    return None, None


def _figures(run: RunFolder, name: str, truth: Trajectory, flown: dict[str, Flown]) -> None:
    names = list(flown)
    positions = np.array([truth.poses[0].apply(f.trajectory.positions) for f in flown.values()])
    unsolved = np.array([f.unsolved for f in flown.values()])
    run.save(
        "trajectories", name,
        {"names": names, "positions": positions, "timestamps": truth.timestamps, "truth": truth.positions,
         "unit": "m", "unsolved": np.pad(unsolved, ((0, 0), (1, 0)))},
    )  # fmt: skip
    run.save(
        "frame-errors", name,
        {"names": names, "translation": np.array([f.errors.translation_m for f in flown.values()]),
         "rotation": np.array([f.errors.rotation_deg for f in flown.values()]),
         "timestamps": truth.timestamps[1:]},
    )  # fmt: skip


def _print(method: str, trajectory: str, records: list[Record]) -> None:
    shown = [r for r in records if r.flow == label(method) and r.dataset == f"forest-{trajectory}"]
    paper = PAPER.get((method, trajectory))
    beside = f"   (paper: RANSAC {paper[0]} %, LCMSAC {paper[1]} %)" if paper else ""
    print(f"\n{method}, {trajectory}{beside}")
    columns = (
        ("drift_percent", 1), ("rpe_trans_median_m", 1e3), ("rpe_trans_rms_m", 1e3),
        ("rpe_rot_median_deg", 1e3), ("rpe_rot_rms_deg", 1e3), ("unsolved_fraction", 100),
    )  # fmt: skip
    heads = ("drift %", "trans med mm", "rms mm", "rot med mdeg", "rms mdeg", "unsolved %")
    print(f"{'':<16}" + "".join(f"{head:>14}" for head in heads))
    for name in dict.fromkeys(r.estimator for r in shown):
        values = {r.metric: r.value for r in shown if r.estimator == name}
        if "drift_percent" in values:
            print(
                f"{name:<16}" + "".join(f"{scale * (values[m] or 0):14.3f}" for m, scale in columns),
                flush=True,
            )
