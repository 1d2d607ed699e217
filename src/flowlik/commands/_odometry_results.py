"""Records, figures and warnings of `flowlik odometry`."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform

from flowlik.commands.options import OdometryOptions
from flowlik.datasets.base import ImageSequence, notes_of
from flowlik.datasets.selection import Skipped
from flowlik.egomotion import EgoMotion, Status
from flowlik.evaluation.likelihood import outside_warning
from flowlik.evaluation.motion import (
    Agreement,
    disagreement_warning,
    length_records,
    relative_pose_errors,
    status_records,
    trajectory_records,
)
from flowlik.flow import describe, method_label
from flowlik.geometry.trajectory import Trajectory
from flowlik.measurement.features import features_of
from flowlik.odometry.adaptation import Adaptation
from flowlik.odometry.odometry import Odometry
from flowlik.odometry.ros_odometry import bag_notes
from flowlik.odometry.scale import UNCERTAIN
from flowlik.results.records import Record, protocol, select
from flowlik.results.runs import RunFolder
from flowlik.support.files import printable


@dataclass(frozen=True)
class Flown:
    """What an odometry made of a sequence.

    Attributes
    ----------
    sequence : ImageSequence
        Its frames.
    numbers : array (N,)
        Their numbers in the data.
    robot : Odometry
        The odometry, at the last frame.
    truth : Trajectory or None
        True poses, where there are any.
    motions : list of EgoMotion
        Of every frame after the first.
    agreements : list of Agreement
        How well images and true poses fit, of every such frame where there is truth.
    seconds : float
        What it took.
    """

    sequence: ImageSequence
    numbers: NDArray[np.int64]
    robot: Odometry
    truth: Trajectory | None
    motions: list[EgoMotion]
    agreements: list[Agreement]
    seconds: float

    @property
    def estimated(self) -> Trajectory:
        """The poses found."""
        return Trajectory(np.array(self.robot.timestamps), RigidTransform.concatenate(self.robot.poses))

    @property
    def flow(self) -> str:
        """Name of the flow method in results."""
        return method_label(describe(self.robot.method))


def report_odometry(
    run: RunFolder, flown: Flown, options: OdometryOptions, skipped: list[Skipped], doubted: bool
) -> None:
    """Add records, figures and warnings to a run; the options' residual is the one chosen.

    Frames that contradict their poses are named unless the data test ``doubted`` the poses as a whole.
    """
    name, scale = flown.sequence.name, "depth" if options.residual == "depth" else options.scale
    run.records = _records(flown, options, scale)
    _save_figures(run, flown, metric=scale != "none")
    frames = flown.numbers[1:].astype(np.float64)
    (outside,) = select(run.records, metric="outside_fraction")
    if options.skip_bad_frames:
        count = float(len(skipped))
        run.records.append(
            replace(run.records[0], metric="skipped_frames", value=count, unit="", count=None, protocol="")
        )
    if not doubted and (message := disagreement_warning(name, frames, flown.agreements)):
        run.warn(message)
    for bad in skipped:
        run.warn(f"{name}: frame {bad.frame} skipped: {bad.reason}")
    if message := outside_warning(outside.value or 0.0, name):
        run.warn(message)
    for note in [*notes_of(flown.sequence), *_bag_notes(flown, options)]:
        run.warn(note)
    for note in _told_in_part(flown.motions):
        run.warn(f"{name}: {note}")


def _told_in_part(motions: list[EgoMotion]) -> list[str]:
    """What the images did not tell, a sentence each."""
    of, notes = f"of {len(motions)} frames", []
    if predicted := sum(motion.predicted for motion in motions):
        notes.append(
            f"{predicted} {of} could not be solved and were predicted from the motions before them; "
            "frames.csv says which and why"
        )
    if turned := sum(m.status is Status.DEGENERATE and not m.predicted for m in motions):
        notes.append(
            f"{turned} {of} told their rotation alone; the translation is that of the motion before, "
            "as uncertain as it is long"
        )
    if planes := sum(motion.alternative is not None for motion in motions):
        notes.append(
            f"{planes} {of} have two motions that explain their flow (a plane, a vehicle, a rail); "
            "the one nearer to the motion before was taken"
        )
    return notes


def _adapting(options: OdometryOptions) -> str | None:
    """How the model follows the drive, in a protocol."""
    settings = Adaptation()
    memory, prior = settings.memory_frames, settings.prior_frames
    return f"memory {memory:g} frames, model worth {prior:g}" if options.adapt else None


def _bag_notes(flown: Flown, options: OdometryOptions) -> list[str]:
    return bag_notes(flown.motions, options.bag_unscaled) if options.bag else []


def _records(flown: Flown, options: OdometryOptions, scale: str) -> list[Record]:
    """Records of a run: errors where the truth is known, states of frames, speed."""
    estimator, motions = flown.robot.estimator, flown.motions
    keys = {
        "residual": options.residual, "scale": scale,
        "boresight": options.boresight, "self_calibrate": options.self_calibrate,
        "adapt": _adapting(options), "gate": "none" if options.gate is None else options.gate,
        "features": features_of(flown.robot.method),
        "timestamps": getattr(flown.sequence, "times_source", None), **options.images,
        "true_poses": None if options.truth is None else printable(options.truth.name),
        "stride": None if options.stride == 1 else options.stride, "parallax_px": options.parallax,
    }  # fmt: skip
    base = Record(
        "frames_per_second", len(motions) / flown.seconds, "1/s", flown.sequence.name, flown.flow,
        estimator.likelihood.family.name, estimator.likelihood.schedule.name, estimator.name,
        len(motions), options.seed,
        protocol(**keys, includes="decoding, flow, estimation, compilation"),
    )  # fmt: skip
    plain = replace(base, protocol=protocol(**keys))
    records = [base, *status_records(motions, plain)]
    if scale in UNCERTAIN:
        records += length_records(motions, flown.truth, plain)
    if flown.truth is None:
        return records
    errors = trajectory_records(
        flown.estimated, flown.truth, flown.sequence.name, base.flow, base.family, base.schedule,
        base.estimator, base.seed, **keys,
    )  # fmt: skip
    if scale == "none":
        unscaled = "; " + protocol(reason="without a scale the trajectory has no unit of length")
        errors = [
            r if r.metric == "rpe_rot_median_deg" else replace(r, value=None, protocol=r.protocol + unscaled)
            for r in errors
        ]
    return [*errors, *records]


def _save_figures(run: RunFolder, flown: Flown, metric: bool) -> None:
    """Save what the figures of a run show."""
    estimated, truth = flown.estimated, flown.truth
    origin = estimated.poses[0] if truth is None else truth.poses[0]
    unsolved = np.array([False, *(not motion.solved for motion in flown.motions)])
    arrays = {
        "names": np.array([flown.robot.estimator.name]),
        "positions": origin.apply(estimated.positions)[None],
        "timestamps": estimated.timestamps,
        "unit": np.array("m" if metric else "steps"),
        "unsolved": unsolved[None],
    }
    if truth is not None and metric:
        arrays["truth"] = truth.positions
        steps = relative_pose_errors(estimated, truth)
        errors = {"translation": steps.translation_m[None], "rotation": steps.rotation_deg[None]}
        shown = {"names": arrays["names"], "timestamps": estimated.timestamps[1:], **errors}
        run.save("frame-errors", flown.flow, shown)
    run.save("trajectories", flown.flow, arrays)
