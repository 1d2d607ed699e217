"""How good motions and trajectories are."""

from flowlik.evaluation.motion._consistency import consistency, consistency_records, tangent_errors
from flowlik.evaluation.motion._data_check import Agreement, agreement, disagreement_warning
from flowlik.evaluation.motion._drift import (
    Align,
    RelativeErrors,
    absolute_trajectory_error,
    drift_percent,
    kitti_errors,
    relative_pose_errors,
)
from flowlik.evaluation.motion._length_records import length_records, length_sigma
from flowlik.evaluation.motion._matching import match
from flowlik.evaluation.motion._motion_records import status_records, trajectory_records, true_trajectory
from flowlik.evaluation.motion._resampling import errors_by_length, errors_by_speed, t_err_interval

__all__ = [
    "Agreement",
    "Align",
    "RelativeErrors",
    "absolute_trajectory_error",
    "agreement",
    "consistency",
    "consistency_records",
    "disagreement_warning",
    "drift_percent",
    "errors_by_length",
    "errors_by_speed",
    "kitti_errors",
    "length_records",
    "length_sigma",
    "match",
    "relative_pose_errors",
    "status_records",
    "t_err_interval",
    "tangent_errors",
    "trajectory_records",
    "true_trajectory",
]
