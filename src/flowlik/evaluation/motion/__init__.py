"""How good motions and trajectories are."""

from flowlik.evaluation.motion.drift import (
    absolute_trajectory_error,
    drift_percent,
    kitti_errors,
    relative_pose_errors,
)
from flowlik.evaluation.motion.motion_records import trajectory_records, true_trajectory

__all__ = [
    "absolute_trajectory_error",
    "drift_percent",
    "kitti_errors",
    "relative_pose_errors",
    "trajectory_records",
    "true_trajectory",
]
