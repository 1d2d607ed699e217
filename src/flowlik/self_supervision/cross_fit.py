"""Errors of an image pair's flow vectors against a motion estimated from the pair's other vectors.

Once the motion is known to a thousandth, what thousands of vectors leave over is their error. A motion bends
towards the vectors that it was estimated from, so that their errors against it are too small. Each half of a
chessboard's tiles is therefore held against the motion of the other: these errors are too large by what that
motion is wrong, and the two readings bracket the truth.
"""

from __future__ import annotations

from collections.abc import Sequence as Seq
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform

from flowlik.egomotion import EgoMotion, Epipolar, Estimator, KnownDepth, Residual
from flowlik.geometry.camera import Pinhole
from flowlik.likelihood.covariates import covariate
from flowlik.likelihood.schedule import Index
from flowlik.measurement.halves import halves
from flowlik.measurement.measurements import Measurements
from flowlik.support.arrays import Array


class SeenPair(NamedTuple):
    """Measurements of one image pair, the camera that made them, and depth [m] along z of the first image.

    Depth is a map (H, W) or that of the vectors (N,); without it the errors are those across epipolar lines.
    """

    measurements: Measurements
    camera: Pinhole
    depth: Array | None = None

    def residuals(self) -> tuple[Residual, Residual]:
        """Residuals of the white and of the black tiles' vectors."""
        first, second = (self._residual(half) for half in halves(self.measurements.pixels))
        return first, second

    def _residual(self, half: NDArray[np.bool_]) -> Residual:
        m, depth = self.measurements.select(half), self.depth
        if depth is None:
            return Epipolar.of(m, self.camera)
        return KnownDepth.of(m, self.camera, depth if depth.ndim == 2 else depth[half])


@dataclass(frozen=True, eq=False)
class MotionErrors:
    """Errors of one pair's vectors (N,), one component each across its line, or two with known depth.

    Attributes
    ----------
    z : array (C,)
        Errors [px], those of a vector side by side.
    directions : array (C, 2)
        Unit vectors in {i} along which they are.
    values : dict of str to array (C,)
        Covariates along these directions, by name.
    measurements : Measurements
        The vectors.
    """

    z: Array
    directions: Array
    values: dict[str, Array]
    measurements: Measurements

    @property
    def sign(self) -> Array:
        """Sign (C,) of the measured flow along the directions, +1 at 0."""
        each = len(self.z) // max(len(self.measurements), 1)
        flow = np.repeat(self.measurements.flow, each, axis=0)
        return np.where((flow * self.directions).sum(axis=1) < 0, -1.0, 1.0)

    def coordinates(self, index: Index) -> Array:
        """Schedule coordinates x (C,)."""
        return index.combine({name: self.values[name] for name in index.covariates})


def half_motions(
    estimator: Estimator,
    residuals: tuple[Residual, Residual],
    seed: Seq[int],
    starts: tuple[RigidTransform | None, RigidTransform | None] = (None, None),
) -> tuple[EgoMotion, EgoMotion]:
    """Motions of both halves, which share neither samples nor a start."""
    first, second = (
        estimator.estimate(residual, np.random.default_rng([*seed, half]), start)
        for half, (residual, start) in enumerate(zip(residuals, starts))
    )
    return first, second


def errors_against(
    residuals: tuple[Residual, Residual], motions: Seq[RigidTransform], names: Seq[str]
) -> MotionErrors:
    """Errors of each half against the motion given for it.

    Parameters
    ----------
    residuals : pair of Residual
        Of `SeenPair.residuals`.
    motions : pair of RigidTransform
        ``T_k_prev`` for each: those of the other halves for errors out of fit, their own for errors in fit.
    names : sequence of str
        Covariates to keep.

    Raises
    ------
    ModelError
        If a covariate is unknown or its signal was not measured.
    """
    parts = [_errors(residual, T, names) for residual, T in zip(residuals, motions)]
    of_first, of_second = parts
    return MotionErrors(
        np.concatenate([p.z for p in parts]),
        np.concatenate([p.directions for p in parts]),
        {name: np.concatenate([p.values[name] for p in parts]) for name in names},
        joined(of_first.measurements, of_second.measurements),
    )


def _errors(residual: Residual, T_k_prev: RigidTransform, names: Seq[str]) -> MotionErrors:
    T = residual.retract(T_k_prev.as_matrix()[:3], np.zeros(6))
    at = residual.at(T, Index())
    count = len(residual.measurements)
    # at the epipole there is no line, and behind the camera no image
    kept = np.asarray(np.isfinite(at.z.reshape(count, -1)).all(axis=1))
    m = residual.measurements.select(kept)
    each = len(at.z) // max(count, 1)
    chosen = np.repeat(kept, each)
    directions = at.directions[chosen]
    values = {}
    for name in names:
        along = [covariate(name).along(m, directions[c::each]) for c in range(each)]
        values[name] = np.stack(along, axis=-1).ravel()
    return MotionErrors(at.z[chosen], directions, values, m)


def joined(first: Measurements, second: Measurements) -> Measurements:
    """Measurements of both, of one method and texture."""
    return Measurements(
        np.concatenate([first.pixels, second.pixels]),
        np.concatenate([first.flow, second.flow]),
        np.concatenate([first.R_i_e, second.R_i_e]),
        np.concatenate([first.t, second.t]),
        first.texture,
        first.method,
        {name: np.concatenate([values, second.signals[name]]) for name, values in first.signals.items()},
        first.lost + second.lost,
    )
