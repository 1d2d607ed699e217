"""Where the length of a motion comes from, which flow alone does not tell: swappable scale sources."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from scipy.spatial.transform import RigidTransform

from flowlik.datasets.base import ImageSequence, lacks
from flowlik.errors import DataError
from flowlik.geometry.camera import Pinhole
from flowlik.likelihood.likelihood import FlowLikelihood
from flowlik.measurement.measurements import Measurements
from flowlik.odometry._lengths import Length
from flowlik.odometry._seen_lengths import CameraHeight, Stereo

SCALES = ("truth-norm", "gps-norm", "camera-height", "stereo", "none")
# those that say how well they know a length
UNCERTAIN = ("gps-norm", "camera-height", "stereo")


class ScaleSource(Protocol):
    """Length of the motion from frame k - 1 to k."""

    @property
    def name(self) -> str:
        """As a protocol names it."""
        ...

    def length(
        self, k: int, m: Measurements, camera: Pinhole, T_k_prev: RigidTransform, likelihood: FlowLikelihood
    ) -> Length | None:
        """Length of a motion of unit length; None where it cannot be told.

        Parameters
        ----------
        k : int
            Frame.
        m : Measurements
            Flow between images k - 1 and k.
        camera : Pinhole
            Camera of both images.
        T_k_prev : RigidTransform
            Motion, with a translation of unit length.
        likelihood : FlowLikelihood
            Of the flow's errors.
        """
        ...


@dataclass(frozen=True)
class Norm:
    """Length of a motion known from elsewhere: the truth's, or a GPS's.

    Parameters
    ----------
    name : str
        As a protocol names it.
    distance_m : callable
        Length [m] of the motion from frame k - 1 to k; NaN unknown.
    sigma_m : callable, optional
        Its standard deviation [m]; without it lengths are taken as exact. A length no larger than that is
        none: the noise of two positions has a length too.
    """

    name: str
    distance_m: Callable[[int], float]
    sigma_m: Callable[[int], float] | None = None

    def length(
        self, k: int, m: Measurements, camera: Pinhole, T_k_prev: RigidTransform, likelihood: FlowLikelihood
    ) -> Length | None:
        """Length of the motion from frame k - 1 to k."""
        metres, sigma_m = self.distance_m(k), self.sigma_m(k) if self.sigma_m else 0.0
        known = np.isfinite(metres) and (metres > sigma_m or self.sigma_m is None)
        return Length(metres, sigma_m) if known else None


@dataclass(frozen=True)
class Unscaled:
    """No scale: every motion keeps unit length."""

    name: str = "none"

    def length(
        self, k: int, m: Measurements, camera: Pinhole, T_k_prev: RigidTransform, likelihood: FlowLikelihood
    ) -> Length | None:
        """Return None."""
        return None


def scale_source(name: str, sequence: ImageSequence, height_m: float | None = None) -> ScaleSource:
    """Scale source by its name in `SCALES`.

    Parameters
    ----------
    name : str
        Name.
    sequence : ImageSequence
        Data, with what the source needs.
    height_m : float, optional
        Height of the camera over the road [m]: needed by ``camera-height``, and by no other.

    Raises
    ------
    DataError
        If the name is unknown, the data lacks what the source needs, or the height is missing or has no use.
    """
    if name not in SCALES:
        raise DataError(f"unknown scale source {name!r}: known are {', '.join(SCALES)}")
    if height_m is None and name == "camera-height":
        raise DataError("--scale camera-height needs --camera-height, the camera's height over the road [m]")
    if height_m is not None:
        if name != "camera-height":
            raise DataError(f"--camera-height has no use with --scale {name}: --scale camera-height takes it")
        return CameraHeight(height_m)
    if name == "truth-norm":
        sequence.T_n_c(0)
        return Norm(name, lambda k: true_distance(sequence, k))
    if name == "gps-norm":
        return _gps_norm(sequence)
    if name == "stereo":
        if getattr(sequence, "baseline_m", None) is None or not hasattr(sequence, "right_image"):
            raise lacks(sequence.name, "second camera (scale stereo needs right images and their baseline)")
        return Stereo(sequence)
    return Unscaled()


def true_distance(sequence: ImageSequence, k: int) -> float:
    """Length [m] of the true motion from frame k - 1 to k: the scale source ``truth-norm``."""
    return float(np.linalg.norm(sequence.T_n_c(k).translation - sequence.T_n_c(k - 1).translation))


def _gps_norm(sequence: ImageSequence) -> Norm:
    """Distance of a GPS's positions, and its own word on their accuracy."""
    positions = getattr(sequence, "gps_positions", None)
    accuracy = getattr(sequence, "gps_accuracy_m", None)
    if positions is None or accuracy is None:
        raise lacks(sequence.name, "GPS positions and accuracy (scale gps-norm needs the OXTS of KITTI raw)")
    return Norm(
        "gps-norm",
        lambda k: float(np.linalg.norm(positions[k] - positions[k - 1])),
        lambda k: float(np.hypot(accuracy[k - 1], accuracy[k])),
    )
