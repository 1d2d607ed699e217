"""Tables that `flowlik odometry` writes beside the trajectory."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from flowlik.egomotion import EgoMotion
from flowlik.evaluation.motion import length_sigma
from flowlik.geometry.trajectory import Trajectory
from flowlik.odometry.self_calibration import Intrinsics
from flowlik.support.files import atomic_write


def write_frames(
    path: Path, estimated: Trajectory, motions: list[EgoMotion], numbers: NDArray[np.int64]
) -> None:
    """One row a frame: status and reason, whether predicted, standard deviations, inliers, losses.

    Raises
    ------
    DataError
        If the place cannot be written to.
    """
    with atomic_write(path) as file:
        writer = csv.writer(file)
        writer.writerow(
            ["frame", "timestamp_s", "status", "reason", "predicted", "sigma_rotation_deg",
             "sigma_translation", "sigma_length", "length_predicted", "inliers", "unit",
             "informative", "components", "outside_fraction", "hypotheses", "log_prob_nat", "excluded"]
        )  # fmt: skip
        for k, (number, motion) in enumerate(zip(numbers, motions), start=1):
            excluded = " ".join(f"{reason}:{count}" for reason, count in motion.excluded.items() if count)
            variance = np.diag(motion.covariance).reshape(2, 3).sum(axis=1)
            rotation, translation = np.sqrt(variance) * [np.degrees(1.0), 1.0]
            writer.writerow(
                [number, estimated.timestamps[k], motion.status.value, motion.reason, int(motion.predicted),
                 f"{rotation:.6g}", f"{translation:.6g}", f"{length_sigma(motion):.6g}",
                 int(motion.length_predicted), motion.inliers,
                 motion.inlier_unit, motion.informative, motion.components,
                 f"{motion.outside:.4f}", motion.hypotheses, f"{motion.log_prob:.3f}", excluded]
            )  # fmt: skip


def write_intrinsics(path: Path, states: list[Intrinsics], numbers: NDArray[np.int64]) -> None:
    """One row a frame: the refined parameters [px, 1] and their standard deviations.

    Raises
    ------
    DataError
        If the place cannot be written to.
    """
    names = states[0].settings.names
    with atomic_write(path) as file:
        writer = csv.writer(file)
        writer.writerow(["frame", *names, *(f"sigma_{name}" for name in names)])
        for number, state in zip(numbers, states):
            writer.writerow([number, *(f"{v:.6g}" for v in (*state.values, *state.sigma))])
