"""Ego-motion over a sequence: loop, scale, boresight, motion model, self-calibration, outputs."""

from flowlik.odometry.adaptation import Adaptation, Adapted, adapting
from flowlik.odometry.boresight import Boresight
from flowlik.odometry.flow_factor import FlowFactor, flow_factor
from flowlik.odometry.loop import measure_sequence, run_odometry
from flowlik.odometry.odometry import Odometry
from flowlik.odometry.scale import Length, ScaleSource, scale_source
from flowlik.odometry.self_calibration import SelfCalibration
from flowlik.odometry.trajectory_covariance import read_covariance_csv, trajectory_covariance

__all__ = [
    "Adaptation",
    "Adapted",
    "Boresight",
    "FlowFactor",
    "Length",
    "Odometry",
    "ScaleSource",
    "SelfCalibration",
    "adapting",
    "flow_factor",
    "measure_sequence",
    "read_covariance_csv",
    "run_odometry",
    "scale_source",
    "trajectory_covariance",
]
