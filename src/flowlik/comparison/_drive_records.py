"""Records and figures of estimators compared on one drive."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.spatial.transform import RigidTransform

from flowlik.comparison._drives import OURS, Drive, Row
from flowlik.egomotion import EgoMotion
from flowlik.errors import DataError
from flowlik.evaluation.motion import (
    errors_by_length,
    errors_by_speed,
    kitti_errors,
    relative_pose_errors,
    status_records,
    t_err_interval,
    trajectory_records,
)
from flowlik.evaluation.motion.split_half import (
    LEAST_STEP_M,
    direction_errors_mrad,
    direction_noise_mrad,
    half_coverage,
    half_distances,
    rotation_noise_mdeg,
    truth_distances,
)
from flowlik.flow import flow_method
from flowlik.geometry.trajectory import Trajectory, chain
from flowlik.measurement.features import features_of
from flowlik.results.records import Record, protocol
from flowlik.support.arrays import Array

LEVELS = (50, 90, 95)


def drive_records(drive: Drive, exact: bool = False) -> list[Record]:
    """Records of every row: errors of trajectory and frames, noise of split halves, coverage, time.

    Where the truth is exact, coverage of the errors against it too: real truth has noise of its own.
    """
    records = []
    for name, row in drive.rows.items():
        base = _base(drive, name)
        keys: dict[str, Any] = {
            "scale": "truth-norm", "residual": "epipolar", **row.keys, "features": _features(drive),
        }  # fmt: skip
        names = (base.dataset or "", base.flow, base.family, base.schedule, base.estimator)
        estimated = _trajectory(drive, row)
        records += trajectory_records(estimated, drive.truth, *names, drive.seed, **keys)
        records += [
            Record(metric, value, unit, *names, count, drive.seed, protocol(**keys, **extra))
            for metric, value, unit, count, extra in _figures_of(drive, row, estimated)
        ]
        if row.found:
            records += status_records(row.found, base)
            records += _coverage(drive, row, base, exact)
    each = 1000 * drive.measuring_s / max(len(drive.truth) - 1, 1)
    note = protocol(includes="decoding, features, flow, signals")
    records.append(
        Record("measuring_ms", each, "CPU-ms", drive.sequence, drive.flow, count=len(drive.truth) - 1,
               seed=drive.seed, protocol=note)
    )  # fmt: skip
    return records


def drive_figures(drive: Drive) -> dict[str, dict[str, Any]]:
    """Arrays of the figures of one drive, by kind."""
    rows = drive.rows
    paths = {name: _trajectory(drive, row) for name, row in rows.items()}
    steps = {name: relative_pose_errors(path, drive.truth) for name, path in paths.items()}
    names = np.array(list(rows))
    times = drive.truth.timestamps
    figures: dict[str, dict[str, Any]] = {
        "trajectories": {
            "names": names, "timestamps": times, "unit": np.array("m"), "truth": drive.truth.positions,
            "positions": np.stack([path.positions for path in paths.values()]),
        },
        "frame-errors": {
            "names": names, "timestamps": times[1:],
            "translation": np.stack([steps[name].translation_m for name in rows]),
            "rotation": np.stack([steps[name].rotation_deg for name in rows]),
        },
    }  # fmt: skip
    segments = {name: kitti_errors(path, drive.truth) for name, path in paths.items()}
    if all(not found.reason for found in segments.values()):
        by_length = {name: np.array(errors_by_length(found.segments)) for name, found in segments.items()}
        by_speed = {
            name: np.array(errors_by_speed(found.segments, drive.truth)) for name, found in segments.items()
        }
        figures["segment-errors"] = {
            "names": names,
            "lengths": by_length[names[0]][:, 0], "speeds": by_speed[names[0]][:, 0],
            "translation_by_length": np.stack([rows_[:, 1] for rows_ in by_length.values()]),
            "rotation_by_length": np.stack([rows_[:, 2] for rows_ in by_length.values()]),
            "translation_by_speed": np.stack([rows_[:, 1] for rows_ in by_speed.values()]),
            "rotation_by_speed": np.stack([rows_[:, 2] for rows_ in by_speed.values()]),
        }  # fmt: skip
    if drive.outliers:
        figures["outliers"] = drive.outliers
    if drive.intrinsics:
        settings = drive.intrinsics[0].settings
        figures["intrinsics"] = {
            "names": np.array(settings.names), "timestamps": times[: len(drive.intrinsics)],
            "values": np.stack([state.values for state in drive.intrinsics]),
            "sigma": np.stack([state.sigma for state in drive.intrinsics]),
        }  # fmt: skip
    return figures


def _figures_of(
    drive: Drive, row: Row, estimated: Trajectory
) -> list[tuple[str, float | None, str, int, dict[str, Any]]]:
    """Rows (metric, value, unit, count, protocol) of an estimator, those of its trajectory apart."""
    truth, count = drive.truth, len(row.motions)
    try:
        interval = t_err_interval(estimated, truth, np.random.default_rng(drive.seed))
        ends: tuple[float | None, float | None] = (interval.low, interval.high)
        note: dict[str, Any] = {"blocks": "10 frames", "confidence": 0.95}
    except DataError as error:
        ends, note = (None, None), {"reason": str(error)}
    moving = _moving(truth)
    true = _true_motions(truth)
    directions = direction_errors_mrad(_of(row.motions, moving), true[moving])
    turns = (_of(row.motions, moving).rotation * true[moving].rotation.inv()).magnitude()
    least = {"true_step": f"> {LEAST_STEP_M} m"}
    found = [
        ("t_err_percent_low", ends[0], "%", count, note),
        ("t_err_percent_high", ends[1], "%", count, note),
        ("direction_error_median_mrad", float(np.median(directions)), "mrad", len(directions), least),
        ("direction_error_worst_mrad", float(np.max(directions)), "mrad", len(directions), least),
        ("rotation_error_median_mdeg", float(1e3 * np.degrees(np.median(turns))), "0.001 deg", len(turns),
         least),
        ("estimation_ms", 1000 * row.seconds / max(count, 1), "CPU-ms", count, {"includes": "estimation"}),
    ]  # fmt: skip
    if row.pairs:
        first, second = (RigidTransform.concatenate([pair[i] for pair in row.pairs]) for i in (0, 1))
        halves, n = {"halves": "64 px chessboard"}, len(row.pairs)
        found += [
            ("split_half_direction_mrad", direction_noise_mrad(first, second), "mrad", n, halves),
            ("split_half_rotation_mdeg", rotation_noise_mdeg(first, second), "0.001 deg", n, halves),
        ]
    return [(metric, value, unit, n, extra) for metric, value, unit, n, extra in found]


def _coverage(drive: Drive, row: Row, base: Record, exact: bool) -> list[Record]:
    """How often the predicted covariance covers differences of halves, and errors against the truth."""
    freedoms = {"degrees_of_freedom": 5, "covariance": "sandwich"}
    measured: dict[str, tuple[Array, str]] = {}
    if row.halves:
        halves = [a for a, _ in row.halves], [b for _, b in row.halves]
        for metric, covariances, shared in (
            ("split_half_coverage", row.differences, "correlated"),
            ("split_half_coverage_sum", None, "as if independent"),
        ):
            note = protocol(halves="64 px chessboard", halves_are=shared, **freedoms)
            measured[metric] = half_distances(*halves, covariances), note
    moving, true = _moving(drive.truth), _true_motions(drive.truth)
    solved = [k for k in np.flatnonzero(moving) if row.found[k].solved]
    if solved and exact:
        found: list[EgoMotion] = [row.found[k] for k in solved]
        distances = truth_distances(found, [true[k] for k in solved])
        measured["truth_coverage"] = distances, protocol(against="truth", **freedoms)
    return [
        Record(
            f"{metric}_{level}", half_coverage(distances, level / 100), "", base.dataset, base.flow,
            base.family, base.schedule, base.estimator, len(distances), base.seed, note,
        )
        for metric, (distances, note) in measured.items() for level in LEVELS
    ]  # fmt: skip


def _base(drive: Drive, name: str) -> Record:
    if name not in OURS:
        return Record("", None, "", drive.sequence, drive.flow, estimator=name, seed=drive.seed)
    likelihood = drive.estimator.likelihood
    family, schedule = likelihood.family.name, likelihood.schedule.name
    label = f"{drive.estimator.name}-{name}"
    return Record("", None, "", drive.sequence, drive.flow, family, schedule, label, seed=drive.seed)


def _features(drive: Drive) -> str:
    return features_of(flow_method(drive.flow))


def _trajectory(drive: Drive, row: Row) -> Trajectory:
    return Trajectory(drive.truth.timestamps, chain(row.motions))


def _true_motions(truth: Trajectory) -> RigidTransform:
    return truth.poses[1:].inv() * truth.poses[:-1]


def _moving(truth: Trajectory) -> Array:
    return np.asarray(np.linalg.norm(np.diff(truth.positions, axis=0), axis=1) > LEAST_STEP_M)


def _of(motions: list[RigidTransform], which: Array) -> RigidTransform:
    return RigidTransform.concatenate([motions[k] for k in np.flatnonzero(which)])
