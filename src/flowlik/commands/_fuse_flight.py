"""A fused flight as `flowlik fuse` tells it: of the camera, with errors where the truth is known."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from flowlik.commands._fuse_inputs import Sensors, without_gps
from flowlik.commands._fuse_monitor import Watched
from flowlik.datasets.selection import Selection
from flowlik.egomotion import EgoMotion, Estimator
from flowlik.fusion import DirectionFactor, Fused
from flowlik.fusion import fuse as fuse_flight
from flowlik.geometry.motion import adjoint
from flowlik.geometry.trajectory import Trajectory
from flowlik.odometry import FlowFactor
from flowlik.odometry.trajectory_covariance import TrajectoryCovariance
from flowlik.support.arrays import Array

PARTS = {"attitude": slice(0, 3), "velocity": slice(3, 6), "position": slice(6, 9)}


@dataclass(frozen=True, eq=False)
class FusedFlight:
    """What was fused, and what came of it.

    Attributes
    ----------
    sequence : Selection
        Frames.
    truth : Trajectory or None
        True poses of the camera at the frames, if they are in the {n} of the fusion.
    sensors : Sensors
        IMU and GPS.
    motions : list of EgoMotion
        Of every frame after the first.
    factors : list of FlowFactor, DirectionFactor or None
        Their factors.
    fused : Fused
        States from the first frame whose state is known on.
    seen : Watched
        What the monitor says.
    seconds : float
        What smoothing took.
    flow : str
        Name of the flow method in results.
    estimator : Estimator
        Of the motions.

    Raises
    ------
    DataError
        From `without`, where the smoother refuses.
    """

    sequence: Selection
    truth: Trajectory | None
    sensors: Sensors
    motions: list[EgoMotion]
    factors: list[FlowFactor | DirectionFactor | None]
    fused: Fused
    seen: Watched
    seconds: float
    flow: str
    estimator: Estimator

    @property
    def first(self) -> int:
        """Number of the first frame whose state is told."""
        return len(self.sequence) - len(self.fused.states)

    @cached_property
    def trajectory(self) -> Trajectory:
        """Poses ``T_n_c`` of the camera."""
        body = self.fused.trajectory
        return Trajectory(body.timestamps, body.poses * self.sensors.settings.T_b_c)

    @cached_property
    def covariances(self) -> TrajectoryCovariance:
        """Of the camera's poses, and of its motions as images told them."""
        turn = adjoint(self.sensors.settings.T_b_c.inv())
        poses = []
        for state in self.fused.states:
            to_body = np.zeros((6, 15))
            to_body[:3, :3], to_body[3:, 6:9] = np.eye(3), state.R_n_b.T
            J = turn @ to_body
            poses.append(J @ state.covariance @ J.T)
        motions = [np.zeros((6, 6)), *(motion.covering for motion in self.motions[self.first :])]
        return TrajectoryCovariance(self.trajectory.timestamps, np.array(poses), np.array(motions))

    @cached_property
    def truth_there(self) -> Trajectory | None:
        """True poses of the frames whose state is told."""
        if self.truth is None:
            return None
        return Trajectory(self.truth.timestamps[self.first :], self.truth.poses[self.first :])

    @cached_property
    def pose_errors(self) -> Array | None:
        """Errors (N, 6) of the camera's poses along the right tangent [rad, m], true of estimated."""
        if self.truth_there is None:
            return None
        return np.asarray((self.trajectory.poses.inv() * self.truth_there.poses).as_exp_coords())

    @cached_property
    def sigmas(self) -> dict[str, Array]:
        """Stated deviations (N,) of attitude [rad], velocity [m/s] and position [m], all axes together."""
        return stated_sigmas(self.fused)

    @cached_property
    def without(self) -> dict[str, dict[str, Array]]:
        """The same without flow, and without GPS, from the first state told on."""
        first, sensors = self.first, self.sensors
        times_s, factors = self.fused.times_s, self.factors[first:]
        begun = replace(sensors, settings=replace(sensors.settings, alignment_s=0.0))
        alone: dict[str, tuple[Sensors, list[FlowFactor | DirectionFactor | None]]] = {
            "flow": (begun, [None] * len(factors))
        }
        if sensors.fixes is not None:
            alone["gps"] = (without_gps(begun), factors)
        return {
            name: stated_sigmas(
                fuse_flight(self.fused.states[0], times_s, flows, left.imu, left.fixes, left.settings)
            )
            for name, (left, flows) in alone.items()
        }


def stated_sigmas(fused: Fused) -> dict[str, Array]:
    """Stated deviations (N,) of attitude [rad], velocity [m/s] and position [m], all axes together."""
    variances = np.diagonal(fused.covariances, axis1=1, axis2=2)
    return {name: np.sqrt(variances[:, part].sum(axis=1)) for name, part in PARTS.items()}


def in_one_frame(truth: Trajectory | None, sensors: Sensors, found: bool) -> Trajectory | None:
    """The truth, if it is in the {n} of the fusion.

    It is not where GPS told latitude and longitude, nor where the start was ``found`` without GPS.
    """
    if sensors.fixes is None:
        return None if found else truth
    return truth if sensors.fixes.origin is None else None
