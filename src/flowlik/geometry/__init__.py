"""Cameras, rigid motions and trajectories."""

from flowlik.geometry.camera import Distortion, Pinhole
from flowlik.geometry.motion import exp_se3, relative_motion, right_covariance
from flowlik.geometry.trajectory import Trajectory, chain, read_kitti, read_tum, write_kitti, write_tum

__all__ = [
    "Distortion",
    "Pinhole",
    "Trajectory",
    "chain",
    "exp_se3",
    "read_kitti",
    "read_tum",
    "relative_motion",
    "right_covariance",
    "write_kitti",
    "write_tum",
]
