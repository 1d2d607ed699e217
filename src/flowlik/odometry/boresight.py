"""Boresight: the small rotation between the camera and the frame of a reference trajectory."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from flowlik.support.arrays import Array

LEAST_STEP_M = 0.3


@dataclass(frozen=True, eq=False)
class Boresight:
    """Rotation from the camera to the reference, from the directions of past motions alone.

    The mean of what turns estimated directions into the reference's, orthogonal to them, with a prior of no
    rotation that counts as `prior_frames`. It removes what is constant: a mounting angle, or what wrong
    intrinsics do to directions.

    Attributes
    ----------
    total : array (3,)
        Sum of rotation vectors [rad], outliers clipped.
    frames : int
        How many.
    prior_frames : float
        Weight of the prior.
    clip_rad : float
        Longest rotation that a frame is believed to say [rad], from the present one.
    """

    total: Array
    frames: int = 0
    prior_frames: float = 10.0
    clip_rad: float = 0.02

    @classmethod
    def none(cls) -> Boresight:
        """No rotation, before the first frame."""
        return cls(np.zeros(3))

    @property
    def rotation(self) -> Rotation:
        """Takes directions in {c} to those of the reference."""
        return Rotation.from_rotvec(self._mean)

    def applied(self, T_k_prev: RigidTransform) -> RigidTransform:
        """Motion of the reference's frame, turned against the camera."""
        B = RigidTransform.from_rotation(self.rotation)
        return B * T_k_prev * B.inv()

    def updated(self, T_k_prev: RigidTransform, reference_m: Array) -> Boresight:
        """Boresight after a frame.

        Parameters
        ----------
        T_k_prev : RigidTransform
            Motion that the camera found, before this boresight.
        reference_m : array (3,)
            The reference's move from the previous frame to this, in its own previous frame [m]; moves shorter
            than 0.3 m say nothing.
        """
        move, length = T_k_prev.inv().translation, np.linalg.norm(reference_m)
        if length < LEAST_STEP_M or not np.any(move):
            return self
        turn = np.cross(move / np.linalg.norm(move), reference_m / length)
        away = turn - self._mean
        size = np.linalg.norm(away)
        if size > self.clip_rad:
            turn = self._mean + away * self.clip_rad / size
        return replace(self, total=self.total + turn, frames=self.frames + 1)

    @property
    def _mean(self) -> Array:
        return self.total / (self.frames + self.prior_frames)
