"""Motions for `flowlik fuse`: measured of images, or those of an earlier run."""

from __future__ import annotations

import csv
from dataclasses import replace
from pathlib import Path
from typing import cast, get_args

import numpy as np
from scipy.spatial.transform import RigidTransform

from flowlik.commands.fuse_options import FuseOptions
from flowlik.datasets.base import ImageSequence
from flowlik.datasets.selection import Selection
from flowlik.egomotion import EgoMotion, Status
from flowlik.errors import DataError, ModelError
from flowlik.fusion import DirectionFactor, direction_factor
from flowlik.likelihood.likelihood import FlowLikelihood
from flowlik.likelihood.over_time import OverTime, Persistence
from flowlik.odometry import FlowFactor, flow_factor
from flowlik.odometry.flow_factor import Form
from flowlik.odometry.loop import ResidualKind
from flowlik.support.files import read_json, read_npz, read_text


def measured_options(options: FuseOptions) -> FuseOptions:
    """Options with the model of the run whose motions are used.

    Raises
    ------
    DataError
        If that is no run of `flowlik odometry` with known depth, or the model given is another.
    """
    if options.motions is None:
        return options
    path = options.motions / "run.json"
    info = read_json(path) if path.is_file() else {}
    config = info.get("config", {})
    if info.get("name") != "flowlik odometry" or config.get("residual") != "depth":
        raise DataError(f"{options.motions}: not a run of `flowlik odometry` with known depth")
    for name in ("model", "estimator"):
        told = config.get(name)
        default = FuseOptions.__dataclass_fields__[name].default
        asked = getattr(options, name)
        if asked not in (None, default) and str(asked) != str(told):
            raise DataError(f"{options.motions}: its {name} is {told}, not {asked}")
    model = config.get("model")
    return replace(options, model=None if model is None else Path(model), estimator=config["estimator"])


def read_motions(run: Path, whole: ImageSequence) -> tuple[Selection, list[EgoMotion]]:
    """Frames and motions of a run of `flowlik odometry` on a data set.

    Raises
    ------
    DataError
        If files are damaged, or the run is of other data.
    """
    arrays = read_npz(run / "trajectory.npz")
    rows = list(csv.DictReader(read_text(run / "frames.csv").splitlines()))
    try:
        times_s, poses, covariances = (
            arrays[name] for name in ("timestamps_s", "T_n_c", "motion_covariance")
        )
        numbers = [int(row["frame"]) for row in rows]
        states = [(Status(row["status"]), row["predicted"] == "1") for row in rows]
        T = RigidTransform.from_matrix(poses)
    except (KeyError, ValueError, TypeError) as error:
        raise DataError(f"{run}: trajectory.npz or frames.csv is damaged ({error})") from error
    if len(times_s) != len(rows) + 1:
        raise DataError(f"{run}: trajectory.npz has {len(times_s)} frames, frames.csv {len(rows)} motions")
    first = [k for k in range(numbers[0]) if abs(whole.timestamp(k) - times_s[0]) < 1e-6] if rows else []
    if not first:
        raise DataError(f"{run}: its first frame is none of {whole.name}: a run of other data?")
    sequence = Selection(whole, [first[-1], *numbers])
    found = np.array([sequence.timestamp(k) for k in range(len(sequence))])
    if np.abs(found - times_s).max() > 1e-6:
        raise DataError(f"{run}: its times are not those of {whole.name}: a run of other data?")
    motions = [
        EgoMotion(T[k].inv() * T[k - 1], np.zeros((6, 6)), covariances[k], status, predicted=predicted)
        for k, (status, predicted) in enumerate(states, start=1)
    ]
    return sequence, motions


def flow_factors(
    motions: list[EgoMotion],
    likelihood: FlowLikelihood,
    interval_s: float,
    options: FuseOptions,
    kind: ResidualKind = "depth",
) -> list[FlowFactor | DirectionFactor | None]:
    """Factors of motions of known depth or of directions; of those that images did not tell, none.

    Raises
    ------
    DataError
        If the form is unknown, or the factor given is not above 0.
    ModelError
        If the model does not know how errors stay over time, and no factor is given.
    """
    if options.form not in get_args(Form):
        raise DataError(f"unknown --form {options.form!r}: known are {', '.join(get_args(Form))}")
    form = cast(Form, options.form)
    if kind == "epipolar":
        return _directions(motions, form, options)
    if options.long_run_factor is None:
        if likelihood.shared_errors.over_time is None:
            raise ModelError(
                "this model does not know how errors stay over time, so that a filter would be far too sure: "
                "take a shipped model of lucas-kanade or dis, or state by --long-run-factor how much larger "
                "the covariance of a sum of motions is than that of independent ones"
            )
        return [flow_factor(motion, likelihood, interval_s, form) for motion in motions]
    if not 0 < options.long_run_factor < np.inf:
        raise DataError(f"--long-run-factor must be above 0, not {options.long_run_factor:g}")
    alone = OverTime(Persistence(0.0, 1.0), Persistence(0.0, 1.0))
    once = replace(likelihood, shared_errors=replace(likelihood.shared_errors, over_time=alone))
    factors = [flow_factor(motion, once, interval_s, form) for motion in motions]
    return [
        None if f is None else replace(f, covariance=options.long_run_factor * f.covariance) for f in factors
    ]


def _directions(
    motions: list[EgoMotion], form: Form, options: FuseOptions
) -> list[FlowFactor | DirectionFactor | None]:
    """Factors of directions, whose long-run factor and start must be stated."""
    if options.long_run_factor is None:
        raise DataError(
            "without depth a motion is a direction, and how its errors stay over time is not calibrated: "
            "state by --long-run-factor how much larger the covariance of a sum of motions is than that of "
            "independent ones"
        )
    if options.initial is None:
        raise DataError("without depth the start cannot be found: give it by --initial, a file or `truth`")
    return [direction_factor(motion, options.long_run_factor, form) for motion in motions]
