"""Are motions as uncertain as they say, and as good as rivals', in worlds and at speeds of all kinds?

NEES and coverage of the ellipsoids by flow method and world, errors of a frame by flight.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import RigidTransform

from calibration_plan import REPORT
from egomotion_variants import (
    RADIUS_PX,
    Variants,
    label,
    residuals_of_flight,
    translation_error,
    variants,
)
from flights import Flight
from flowlik.egomotion import ByVector, EgoMotion
from flowlik.evaluation.motion import consistency, consistency_records, tangent_errors
from flowlik.geometry.trajectory import Trajectory
from flowlik.results.records import Record, protocol
from flowlik.support.progress import Progress

HELD_OUT = {
    "forest": [
        *(f for f in REPORT.values() if f.world == "forest"),
        Flight("forest", "straight", 6.0, 110, 60, 4, "nees"),
        Flight("forest", "training", 6.0, 111, 60, 4, "nees"),
        Flight("forest", "forest-fig8", 6.0, 112, 60, 4, "nees"),
    ],
    "planes": [
        Flight("planes", "straight", 6.0, 110, 40, 4, "nees"),
        Flight("planes", "training", 12.0, 111, 40, 4, "nees"),
    ],
    "driving": [
        *(f for f in REPORT.values() if f.world == "driving"),
        Flight("driving", "06", 0.0, 110, 20, 4, "nees"),
    ],
}
"""Flights by world that no model has seen: 1 020 pairs, seen by three flow methods."""

Found = EgoMotion | RigidTransform | None


def consistency_part(
    methods: tuple[str, ...], cache: Path, kitti_poses: Path | None, quick: bool, progress: Progress
) -> list[Record]:
    """NEES and coverage of ours, and everyone's errors, on held-out flights; quick: the report's."""
    records = []
    for method in methods:
        everyone = variants(method, cache)
        for world, flights in HELD_OUT.items():
            flights = [f for f in flights if not quick or f.use == "rep"]
            if world == "driving" and kitti_poses is None:
                print("no --data: nothing measured in driving")
                continue
            motions: dict[str, list[EgoMotion]] = {e.name: [] for e in everyone.ours}
            true: list[RigidTransform] = []
            for flight in progress(iter(flights), f"{method} in {world}", len(flights)):
                pairs = residuals_of_flight(flight, method, cache, kitti_poses)
                found = everyone.motions_over(pairs)
                truth = [T for _, T in pairs]
                records += _of_flight(everyone, flight, found, truth)
                true += truth
                for name, of_name in motions.items():
                    of_name += found[name]  # type: ignore[arg-type]
            if true:
                records += _of_world(everyone, world, motions, true)
    return records


def _of_flight(
    everyone: Variants, flight: Flight, found: dict[str, list[Found]], true: list[RigidTransform]
) -> list[Record]:
    """Median errors of a frame's motion; one that is not found stands still."""
    records = []
    print(f"\n{everyone.method}, {flight.name}, {len(true)} pairs: median errors, mm and 0.001 deg")
    for name, motions in found.items():
        poses = [m.T_k_prev if isinstance(m, EgoMotion) else m for m in motions]
        turned = [(t.rotation if T is None else T.rotation * t.rotation.inv()) for T, t in zip(poses, true)]
        trans = float(np.median([translation_error(T, t) for T, t in zip(poses, true)]))
        rot = float(np.median([np.degrees(rotation.magnitude()) for rotation in turned]))
        base = Record(
            "", None, "", flight.name, label(everyone.method), estimator=name, count=len(true),
            protocol=protocol(residual="depth", scale="depth", align="none"),
        )  # fmt: skip
        records.append(replace(base, metric="rpe_trans_median_m", value=trans, unit="m"))
        records.append(replace(base, metric="rpe_rot_median_deg", value=rot, unit="deg"))
        print(f"{name:<14}{1e3 * trans:10.3f}{1e3 * rot:10.2f}", flush=True)
    return records


def judged(
    everyone: Variants, dataset: str, flown: list[Mapping[str, Any]], truths: list[Trajectory]
) -> list[Record]:
    """NEES and coverage of flights already flown (`egomotion_table.Flown` by name), pooled."""
    true = [T for truth in truths for T in (truth.poses[1:].inv() * truth.poses[:-1])]
    motions = {e.name: [m for way in flown for m in way[e.name].motions] for e in everyone.ours}
    return _of_world(everyone, dataset, motions, true)


def _of_world(
    everyone: Variants, dataset: str, motions: dict[str, list[EgoMotion]], true: list[RigidTransform]
) -> list[Record]:
    records = []
    for estimator in everyone.ours:
        # a constant radius knows nothing of the errors
        if estimator.rule == ByVector(RADIUS_PX):
            continue
        solved = [(m, T) for m, T in zip(motions[estimator.name], true) if m.solved]
        left_out = len(true) - len(solved)
        errors = tangent_errors([m.T_k_prev for m, _ in solved], [T for _, T in solved])
        base = Record(
            "", None, "", dataset, label(everyone.method), estimator.likelihood.family.name,
            estimator.likelihood.schedule.name, estimator.name,
            protocol=protocol(residual="depth", unsolved_left_out=left_out),
        )  # fmt: skip
        line = f"{everyone.method:<13} {dataset:<20} {estimator.name:<13} {len(solved):5d} pairs"
        for kind, covariances in (
            ("sandwich", [m.covariance for m, _ in solved]),
            ("product", [np.linalg.inv(m.information) for m, _ in solved]),
        ):
            found = consistency(errors, np.array(covariances))
            records += consistency_records(found, base, kind)
            covered = " ".join(f"{found.coverage(c):.2f}" for c in (0.5, 0.9, 0.95))
            line += f" | {kind} NEES {found.mean:7.2f} median {found.median:6.2f}"
            line += f" trimmed {found.trimmed_mean:6.2f} covers {covered}"
        print(line, flush=True)
    return records
