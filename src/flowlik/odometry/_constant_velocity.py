"""The motion expected where the images do not tell: the last one goes on, within the spread of changes."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import RigidTransform

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
