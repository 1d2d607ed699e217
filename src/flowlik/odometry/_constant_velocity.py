"""The motion expected where the images do not tell: the last one goes on, within the spread of changes."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import RigidTransform

from flowlik.egomotion import EgoMotion, Status
from flowlik.egomotion.result import of_rotation
from flowlik.support.arrays import Array

REMEMBERED = 30
ENOUGH = 12


@dataclass(frozen=True, eq=False)
class ConstantVelocity:
    """A random walk of motions from frame to frame, its steps as large as those seen of late.

    Attributes
    ----------
    last : RigidTransform or None
        Last motion that the images told; None before the first.
    covariance : array (6, 6)
        Its covariance, left tangent; not finite where unknown.
    changes : tuple of array (6,)
        Tangents log(T_k T_{k-1}^-1) between neighbouring motions of the last 30 frames.
    missed : int
        Frames since then.
    """

    last: RigidTransform | None = None
    covariance: Array | None = None
    changes: tuple[Array, ...] = ()
    missed: int = 0

    def update(self, T_k_prev: RigidTransform, covariance: Array) -> ConstantVelocity:
        """Return the model after a frame that was solved."""
        changes = self.changes
        if self.last is not None and not self.missed:
            changes = (*changes, (T_k_prev * self.last.inv()).as_exp_coords())[-REMEMBERED:]
        return ConstantVelocity(T_k_prev, covariance, changes)

    def turned(self, T_k_prev: RigidTransform, covariance: Array) -> ConstantVelocity:
        """Return the model after a frame that told its rotation alone: of translations it learns nothing."""
        return replace(self, last=T_k_prev, covariance=covariance, missed=0)

    def nearer(self, first: RigidTransform, second: RigidTransform, metric: bool) -> RigidTransform:
        """Of two motions the one nearer to the last, by rotation and translation or its direction."""
        if self.last is None:
            return first
        last = self.last
        length = max(float(np.linalg.norm(last.translation)), 1e-9)

        def away(T: RigidTransform) -> float:
            turn = (T.rotation * last.rotation.inv()).magnitude()
            t = T.translation if metric else T.translation * length / np.linalg.norm(T.translation)
            return float(turn + np.linalg.norm(t - last.translation) / length)

        return min(first, second, key=away)

    def completed(self, motion: EgoMotion, unscaled: bool) -> EgoMotion:
        """Add to a motion what those before say where the images do not tell all.

        Of two motions it is the nearer one; beside a rotation alone stands the last translation, which may be
        anything of its length (1 of the first if motions are without a scale); else the motion is predicted.
        """
        if motion.solved:
            return motion
        if (other := motion.alternative) is not None:
            if self.nearer(motion.T_k_prev, other.T_k_prev, motion.scale_known) is motion.T_k_prev:
                return motion
            return replace(other, alternative=replace(motion, alternative=None))
        T, covariance = self.predict()
        if motion.rotation_alone:
            length = float(np.linalg.norm(T.translation)) or (1.0 if unscaled else np.nan)
            T = RigidTransform.from_components(T.translation, motion.T_k_prev.rotation)
            wide = of_rotation(motion.covariance, length**2)
            return replace(motion, T_k_prev=T, covariance=wide, sensitivity=None)
        nothing = np.zeros((6, 6))
        return replace(
            motion, T_k_prev=T, information=nothing, covariance=covariance, sensitivity=None, predicted=True
        )

    def after(self, motion: EgoMotion) -> ConstantVelocity:
        """Return the model after a motion that `completed` gave."""
        if motion.predicted:
            return self.skip()
        if motion.status is Status.DEGENERATE:
            return self.turned(motion.T_k_prev, motion.covariance)
        return self.update(motion.T_k_prev, motion.covariance)

    def skip(self) -> ConstantVelocity:
        """Return the model after a frame that was not."""
        return replace(self, missed=self.missed + 1)

    def predict(self) -> tuple[RigidTransform, Array]:
        """Motion expected of the next frame and its covariance (6, 6); identity and NaN before the first.

        The covariance is the last motion's and, for every frame since, the mean square of the changes seen.
        Until twelve have been seen, for six directions, a change may be as large as the motion itself.
        """
        if self.last is None:
            return RigidTransform.identity(), np.full((6, 6), np.nan)
        if len(self.changes) < ENOUGH:
            length = float(np.linalg.norm(self.last.translation))
            change = np.diag(np.repeat([self.last.rotation.magnitude(), length], 3) ** 2)
        else:
            change = np.mean([np.outer(c, c) for c in self.changes], axis=0)
        known = self.covariance is not None and np.isfinite(self.covariance).all()
        start = self.covariance if known and self.covariance is not None else np.zeros((6, 6))
        return self.last, start + (self.missed + 1) * change
