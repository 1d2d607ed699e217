"""What a smoother knows of the body at one moment, and what it is told."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from flowlik.errors import DataError
from flowlik.support.arrays import Array


@dataclass(frozen=True, eq=False)
class FusedState:
    """State of the body, which is the IMU, and its covariance.

    Attributes
    ----------
    time_s : float
        Time [s].
    R_n_b : array (3, 3)
        Attitude: takes coordinates in {b} to {n}.
    position_n_m : array (3,)
        Position [m] in {n}.
    velocity_n_mps : array (3,)
        Velocity [m/s] in {n}.
    gyroscope_bias_radps, accelerometer_bias_mps2 : array (3,)
        Biases in {b}.
    covariance : array (15, 15)
        Of the error state: attitude, velocity, position, both biases, as
        `flowlik.fusion.innovations` says.

    Raises
    ------
    DataError
        If the covariance has another shape.
    """

    time_s: float
    R_n_b: Array
    position_n_m: Array
    velocity_n_mps: Array
    gyroscope_bias_radps: Array
    accelerometer_bias_mps2: Array
    covariance: Array

    def __post_init__(self) -> None:
        if self.covariance.shape != (15, 15):
            raise DataError(f"a state's covariance is (15, 15), not {self.covariance.shape}")

    @property
    def T_n_b(self) -> RigidTransform:
        """Pose: takes points in {b} to {n} [m]."""
        return RigidTransform.from_components(self.position_n_m, Rotation.from_matrix(self.R_n_b))


@dataclass(frozen=True, eq=False)
class GpsFix:
    """One position of the antenna.

    Attributes
    ----------
    time_s : float
        Time [s].
    position_n_m : array (3,)
        Position [m] in {n}.
    covariance_m2 : array (3, 3)
        Of its whole error [m²].
    """

    time_s: float
    position_n_m: Array
    covariance_m2: Array


@dataclass(frozen=True, eq=False)
class ImuSegment:
    """IMU from one node of the graph to the next, M steps of the trapezoidal rule.

    Attributes
    ----------
    steps_s : array (M,)
        Lengths [s].
    rates_radps : array (M, 3)
        Mean angular rate [rad/s] of each step, in {b}.
    forces_mps2 : array (M, 3)
        Mean specific force [m/s²] of each step, in the axes of its begin: GTSAM holds these over the step.
    last_rate_radps : array (3,)
        Angular rate [rad/s] at the end.
    """

    steps_s: Array
    rates_radps: Array
    forces_mps2: Array
    last_rate_radps: Array


@dataclass(frozen=True)
class ColouredGps:
    """Part of a receiver's error that stays: a Gauss-Markov process beside white noise.

    Attributes
    ----------
    share : float
        Of the variance that a fix states, below 1.
    memory_s : float
        Time [s] within which the correlation falls to 1/e.

    Raises
    ------
    DataError
        If the share is not between 0 and 1, or the memory not above 0.
    """

    share: float
    memory_s: float

    def __post_init__(self) -> None:
        if not (0 < self.share < 1 and 0 < self.memory_s < np.inf):
            raise DataError(
                f"coloured GPS needs a share between 0 and 1 and a memory above 0 s, not {self.share:g} and "
                f"{self.memory_s:g}"
            )


@dataclass(frozen=True, eq=False)
class FusionSettings:
    """How sensors sit on the body, and how they err.

    Attributes
    ----------
    gravity_n_mps2 : array (3,)
        Gravity [m/s²] in {n}: along +y where y points down.
    T_b_c : RigidTransform
        Takes points in the camera to the body [m].
    antenna_b_m : array (3,)
        Where the antenna sits [m] in {b}.
    coloured : ColouredGps, optional
        What of GPS's errors stays.
    lag_s : float
        How far back [s] the smoother still moves its estimate.
    alignment_s : float
        First seconds in which the whole flight stays in the lag, so that a start that is hardly known is
        linearised anew until it is.

    Raises
    ------
    DataError
        If the lag is not above 0 s, or the alignment negative.
    """

    gravity_n_mps2: Array
    T_b_c: RigidTransform = field(default_factory=RigidTransform.identity)
    antenna_b_m: Array = field(default_factory=lambda: np.zeros(3))
    coloured: ColouredGps | None = None
    lag_s: float = 1.0
    alignment_s: float = 0.0

    def __post_init__(self) -> None:
        if not 0 < self.lag_s < np.inf:
            raise DataError(f"a smoother needs a lag above 0 s, not {self.lag_s:g}")
        if not 0 <= self.alignment_s < np.inf:
            raise DataError(f"an alignment of {self.alignment_s:g} s")
