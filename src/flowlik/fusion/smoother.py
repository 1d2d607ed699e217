"""A fixed-lag smoother of IMU, flow and GPS on GTSAM (docs/fusion.md)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from flowlik.datasets.inertial import ImuNoise
from flowlik.errors import DataError
from flowlik.fusion._factors import (
    biased_gps_factor,
    gps_bias_factor,
    gps_factor,
    gps_observation,
    imu_parameters,
    pose3,
    preintegrated,
    start_factors,
    to_error_state,
)
from flowlik.fusion.direction_factor import MOST_UNKNOWN, DirectionFactor
from flowlik.fusion.gtsam_factor import gtsam_factor
from flowlik.fusion.innovations import GpsInnovations
from flowlik.fusion.state import FusedState, FusionSettings, GpsFix, ImuSegment
from flowlik.geometry.times import time_text
from flowlik.odometry import FlowFactor
from flowlik.support.arrays import Array
from flowlik.support.extras import extra

RELINEARISED_BEYOND = 0.02
"""Change of an estimate [rad, m, m/s] beyond which its factors are linearised anew."""


class _Innovation(NamedTuple):
    time_s: float
    innovation_m: Array
    covariance_m2: Array
    observation: Array
    gain: Array
    transition: Array


class _Mark(NamedTuple):
    """A node from which shifts of the estimate are followed: its keys, time, covariance, tangents."""

    keys: tuple[int, ...]
    time_s: float
    covariance: Array
    to_error_state: Array


class FixedLagSmoother:
    """One graph: an IMU factor and, where there is one, a flow factor between nodes; GPS at nodes.

    Nodes that are older than the lag become a prior. GTSAM's ISAM2 factorises by QR: by Cholesky's
    decomposition it fails at the first update.

    Parameters
    ----------
    start : FusedState
        What is known of the first node.
    noise : ImuNoise
        Of the IMU; every density above 0.
    settings : FusionSettings
        How the sensors sit and err.

    Attributes
    ----------
    state : FusedState
        Of the last node.
    flow_factors : int
        Motions that were used until now.

    Raises
    ------
    MissingExtraError
        If GTSAM is not installed.
    DataError
        If a density of the IMU's noise is not positive, or the start's covariance not positive definite.
    """

    def __init__(self, start: FusedState, noise: ImuNoise, settings: FusionSettings) -> None:
        gtsam = self._gtsam = extra("gtsam", "a smoother")
        self.settings, self.state = settings, start
        self._imu = imu_parameters(gtsam, noise, settings.gravity_n_mps2)
        parameters = gtsam.ISAM2Params()
        parameters.setFactorization("QR")
        parameters.setRelinearizeThreshold(RELINEARISED_BEYOND)
        parameters.relinearizeSkip = 1
        self._smoother = gtsam.IncrementalFixedLagSmoother(settings.lag_s + settings.alignment_s, parameters)
        self._aligned_s = start.time_s + settings.alignment_s if settings.alignment_s > 0 else np.inf
        self._node, self._keys = 0, self._keys_of(0)
        self._fixes: list[_Innovation] = []
        graph, values = start_factors(gtsam, start, self._keys[:3])
        if settings.coloured is not None:
            graph.add(gps_bias_factor(gtsam, self._keys[3:], 0.0))
            values.insert(self._keys[3], np.zeros(3))
        self._update(graph, values, dict.fromkeys(self._keys, start.time_s))
        self._image = (self._keys[0], start.time_s)
        self.flow_factors = 0
        self._mark = self._marked(start.time_s, self._marginal(self._keys))
        self._transition = np.eye(len(self._mark.covariance))

    def step(
        self,
        imu: ImuSegment,
        flow: FlowFactor | DirectionFactor | None = None,
        fixes: Sequence[GpsFix] = (),
        image: bool = True,
    ) -> FusedState:
        """Go on to the next node.

        Parameters
        ----------
        imu : ImuSegment
            From the last node to this one: at most half the lag.
        flow : FlowFactor or DirectionFactor, optional
            Measured motion of the camera since the last image; None where images tell none. A direction is
            used at the length that is predicted, unless that is hardly known.
        fixes : sequence of GpsFix
            Fixes near this node; each is carried to the node's time by the estimated velocity.
        image : bool
            Whether an image was taken at this node, to which the next flow is relative.

        Returns
        -------
        FusedState
            Of this node, by all that came until now.

        Raises
        ------
        DataError
            If no time passes, the last node or the image that flow is relative to is too old for the lag, or
            the graph has no solution.
        """
        gtsam, before = self._gtsam, self._keys
        time_s = self.state.time_s + float(imu.steps_s.sum())
        self._check_step(imu.steps_s, time_s, flow)
        self._node += 1
        # the bias of GPS has nodes of its own: at fixes, and before the last one is older than the lag
        marked = bool(fixes) or time_s - self._mark.time_s > self.settings.lag_s / 4
        graph, values = self._imu_graph(imu, before)
        if isinstance(flow, DirectionFactor):
            flow = self._at_length(flow, values.atPose3(self._keys[0]), time_s)
        if flow is not None:
            graph.add(gtsam_factor(flow, self._image[0], self._keys[0], self.settings.T_b_c))
            self.flow_factors += 1
        new = self._keys[:3]
        if marked and self.settings.coloured is not None:
            new = self._keys
            last = self._mark.keys[3]
            kept = float(np.exp(-(time_s - self._mark.time_s) / self.settings.coloured.memory_s))
            graph.add(gps_bias_factor(gtsam, (last, new[3]), kept))
            values.insert(new[3], kept * np.array(self._smoother.calculateEstimateVector(last)))
        if time_s > self._aligned_s:
            self._smoother.setSmootherLag(self.settings.lag_s)
            self._aligned_s = np.inf
        self._update(graph, values, dict.fromkeys(new, time_s))
        joint = self._marginal((*self._keys, *self._mark.keys) if marked else new)
        self.state = self._read(time_s, joint)
        if marked:
            own = self._follow(joint)
            for fix in fixes:
                own = self._take(fix, imu.last_rate_radps - self.state.gyroscope_bias_radps, own)
            self._mark = self._marked(time_s, own)
        if image:
            self._image = (self._keys[0], time_s)
        return self.state

    @property
    def innovations(self) -> GpsInnovations:
        """Of all fixes until now."""
        n = len(self._mark.covariance)
        shapes: tuple[tuple[int, ...], ...] = ((), (3,), (3, 3), (3, n), (n, 3), (n, n))
        columns = zip(*self._fixes) if self._fixes else ((),) * len(shapes)
        arrays = [np.array(column).reshape(-1, *shape) for column, shape in zip(columns, shapes)]
        if self._fixes:
            arrays[-1][0] = np.eye(n)
        return GpsInnovations(*arrays)

    def _update(self, graph: Any, values: Any, stamps: dict[int, float]) -> None:
        try:
            self._smoother.update(graph, values, stamps)
        except RuntimeError as error:  # GTSAM's own exceptions arrive as these
            why = str(error).strip().splitlines()[:1]
            raise DataError(
                f"the smoother's graph has no solution at {time_text(self.state.time_s)} s: {''.join(why)}"
            ) from error

    def _at_length(self, flow: DirectionFactor, predicted: Any, time_s: float) -> FlowFactor | None:
        """A direction at the length of the predicted step; None where that is not known well enough."""
        last = self._smoother.calculateEstimatePose3(self._image[0])
        arm = self.settings.T_b_c.translation
        length_m = float(np.linalg.norm(predicted.transformFrom(arm) - last.transformFrom(arm)))
        unknown_mps = float(np.sqrt(np.linalg.eigvalsh(self.state.covariance[3:6, 3:6])[-1]))
        if unknown_mps * (time_s - self._image[1]) > MOST_UNKNOWN * length_m:
            return None
        return flow.at_length(length_m)

    def _check_step(self, steps_s: Array, time_s: float, flow: FlowFactor | DirectionFactor | None) -> None:
        lag_s, step_s, image_s = self.settings.lag_s, time_s - self.state.time_s, time_s - self._image[1]
        if not (step_s > 0 and (steps_s > 0).all()):
            raise DataError("a step of the IMU takes no time")
        if step_s > lag_s / 2:
            raise DataError(f"a step of {step_s:.3g} s is more than half the smoother's lag of {lag_s:g} s")
        if flow is not None and image_s > lag_s:
            raise DataError(f"flow over {image_s:.3g} s is longer than the smoother's lag of {lag_s:g} s")

    def _keys_of(self, node: int) -> tuple[int, ...]:
        letters = "xvb" if self.settings.coloured is None else "xvbg"
        return tuple(self._gtsam.symbol(letter, node) for letter in letters)

    def _imu_graph(self, imu: ImuSegment, before: tuple[int, ...]) -> tuple[Any, Any]:
        """Graph and values of this node, as the IMU alone tells it."""
        gtsam, state = self._gtsam, self.state
        self._keys = self._keys_of(self._node)
        bias = gtsam.imuBias.ConstantBias(state.accelerometer_bias_mps2, state.gyroscope_bias_radps)
        steps = preintegrated(gtsam, self._imu, bias, imu)
        last = gtsam.NavState(pose3(gtsam, state), state.velocity_n_mps)
        predicted = steps.predict(last, bias)
        (x0, v0, b0), (x, v, b) = before[:3], self._keys[:3]
        graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
        graph.add(gtsam.CombinedImuFactor(x0, v0, x, v, b0, b, steps))
        values.insert(x, predicted.pose())
        values.insert(v, predicted.velocity())
        values.insert(b, bias)
        return graph, values

    def _read(self, time_s: float, joint: Array) -> FusedState:
        """State of this node, whose covariance in GTSAM's tangents comes first in a joint one."""
        x, v, b = self._keys[:3]
        smoother = self._smoother
        T = smoother.calculateEstimatePose3(x).matrix()
        bias = smoother.calculateEstimateConstantBias(b)
        velocity = np.array(smoother.calculateEstimateVector(v))
        M = to_error_state(T[:3, :3])
        C = M @ joint[:15, :15] @ M.T
        biases = bias.gyroscope(), bias.accelerometer()
        return FusedState(time_s, T[:3, :3], T[:3, 3], velocity, *biases, (C + C.T) / 2)

    def _marginal(self, keys: tuple[int, ...]) -> Array:
        """Joint covariance of keys in their order, in GTSAM's tangents."""
        joint = self._smoother.getISAM2().jointMarginalCovariance(list(keys))
        return np.asarray(joint.fullMatrix())

    def _marked(self, time_s: float, own: Array) -> _Mark:
        M = to_error_state(self.state.R_n_b, self.settings.coloured is not None)
        return _Mark(self._keys, time_s, M @ own @ M.T, M)

    def _follow(self, joint: Array) -> Array:
        """Follow shifts of the estimate from the last mark to this node; this node's own covariance.

        Given what was known at the mark, all that came since is one Gaussian; a shift of its mean moves
        the estimate now by cov(now, mark) inv(cov(mark as it was then)).
        """
        mark, size = self._mark, len(self._transition)
        M = to_error_state(self.state.R_n_b, size == 18)
        across = M @ joint[:size, size:] @ mark.to_error_state.T
        self._transition = np.linalg.solve(mark.covariance, across.T).T @ self._transition
        return joint[:size, :size]

    def _take(self, fix: GpsFix, rate_radps: Array, own: Array) -> Array:
        """Use a fix, and keep what it told that was not known; this node's covariance before and after."""
        gtsam, settings, state = self._gtsam, self.settings, self.state
        R = state.R_n_b
        later_s = state.time_s - fix.time_s
        antenna_mps = state.velocity_n_mps + R @ np.cross(rate_radps, settings.antenna_b_m)
        position_m = fix.position_n_m + later_s * antenna_mps
        stated = np.asarray(fix.covariance_m2, dtype=np.float64)
        white = stated + later_s**2 * state.covariance[3:6, 3:6]
        innovation = position_m - (state.position_n_m + R @ settings.antenna_b_m)
        coloured: Array | None = None
        if settings.coloured is not None:
            white = white - settings.coloured.share * stated
            coloured = np.asarray(np.linalg.cholesky(settings.coloured.share * stated))
            bias = np.array(self._smoother.calculateEstimateVector(self._keys[3]))
            innovation = innovation - coloured @ bias
        H = gps_observation(R, settings, coloured)
        C = self._marked(state.time_s, own).covariance
        S = H @ C @ H.T + white
        gain = np.asarray(np.linalg.solve(S, H @ C).T)
        self._fixes.append(_Innovation(fix.time_s, innovation, S, H, gain, self._transition))
        self._transition = np.eye(len(C))
        graph = gtsam.NonlinearFactorGraph()
        if coloured is None:
            carried = GpsFix(state.time_s, position_m, stated)
            graph.add(gps_factor(gtsam, self._keys[0], carried, settings, white))
        else:
            at = gtsam.Values()
            at.insert(self._keys[0], pose3(gtsam, state))
            at.insert(self._keys[3], bias)
            keys = (self._keys[0], self._keys[3])
            graph.add(biased_gps_factor(gtsam, keys, at, innovation, H, R, white))
        self._update(graph, gtsam.Values(), {})
        own = self._marginal(self._keys)
        self.state = self._read(state.time_s, own)
        return own
