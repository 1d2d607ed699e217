"""Flow of points of known depth."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from flowlik.egomotion import _kernels
from flowlik.egomotion.residual import Bound, Chosen, Equations, InliersOf, Linearised, count_support
from flowlik.errors import DataError
from flowlik.geometry.camera import Pinhole
from flowlik.image.depth import check_depth_z
from flowlik.image.sampling import inverse_depth_at
from flowlik.likelihood.schedule import Index
from flowlik.measurement.measurements import Measurements
from flowlik.support.arrays import Array


@dataclass(frozen=True, eq=False)
class KnownDepth:
    """Flow of points of known depth: two eigen-components a vector, z = R_e_i (y - h).

    Where depths err, errors are divided by how much wider that makes them: ``widened`` (N, 2), of
    `flowlik.egomotion.with_depth_errors`.
    """

    metric: ClassVar[bool] = True
    measurements: Measurements
    camera: Pinhole
    rho: Array
    excluded: dict[str, int] = field(default_factory=dict)
    widened: Array | None = None

    @classmethod
    def of(cls, measurements: Measurements, camera: Pinhole, depth_z: Array) -> KnownDepth:
        """Residual of measurements with a depth map (H, W) [m] along z, or depths (N,) at their pixels.

        Vectors whose depth is NaN, zero, negative or infinite are left out and counted. Between pixels a
        map is interpolated on a surface, never across an edge (`flowlik.image.sampling`).

        Raises
        ------
        DataError
            If depths are whole numbers, a depth map's size is not the camera's, or measurements lie outside
            the camera's image.
        """
        check_depth_z(depth_z)
        size = f"{camera.width}x{camera.height}"
        column, row = np.rint(measurements.pixels).T
        inside = (column >= 0) & (column < camera.width) & (row >= 0) & (row < camera.height)
        if not inside.all():
            raise DataError(
                f"{int((~inside).sum())} measurements lie outside the image of {size}: another camera's?"
            )
        if depth_z.ndim == 2:
            if depth_z.shape != (camera.height, camera.width):
                raise DataError(f"depth map of {depth_z.shape[1]}x{depth_z.shape[0]} for a camera of {size}")
            inverse_z = inverse_depth_at(depth_z, measurements.pixels)
        elif depth_z.shape != (len(measurements),):
            raise DataError(f"{len(measurements)} measurements, but depths of shape {depth_z.shape}")
        else:
            with np.errstate(divide="ignore"):
                inverse_z = 1.0 / depth_z
        usable = np.isfinite(inverse_z) & (inverse_z > 0)
        kept = measurements.select(usable)
        scale = np.linalg.norm(camera.rays(kept.pixels), axis=-1)
        excluded = {"no depth": int((~usable).sum()), "no flow": measurements.lost}
        return cls(kept, camera, inverse_z[usable] / scale, excluded)

    def __post_init__(self) -> None:
        m, c = self.measurements, self.camera
        # the kernels turn errors into the eigenbasis: what widens them is one with that
        R_i_e = m.R_i_e if self.widened is None else m.R_i_e / self.widened[:, None]
        arrays = (c.p2v(m.pixels), self.rho, m.pixels + m.flow, R_i_e)
        object.__setattr__(self, "_points", tuple(np.ascontiguousarray(a) for a in arrays))
        object.__setattr__(self, "_camera", (c.fx, c.fy, c.cx, c.cy))
        object.__setattr__(self, "_directions", np.swapaxes(m.R_i_e, 1, 2).reshape(-1, 2))

    _points: tuple[Array, ...] = field(init=False, repr=False)
    _camera: tuple[float, ...] = field(init=False, repr=False)
    _directions: Array = field(init=False, repr=False)
    _coordinates: dict[int, tuple[Index, Array]] = field(init=False, repr=False, default_factory=dict)

    def __len__(self) -> int:
        """Return the number of flow vectors."""
        return len(self.rho)

    @property
    def sampling(self) -> ThreePoint:
        """Samples of three vectors."""
        return ThreePoint(self)

    def at(self, T: Array, index: Index) -> Linearised:
        """Errors z (2N,) [px] of eigen-components; their coordinates are the same at every motion."""
        z, J = _kernels.linearise_depth(T, *self._points, self._camera)
        return Linearised(T, z, J, self.coordinates(index), self._directions, np.eye(6))

    def coordinates(self, index: Index) -> Array:
        """Schedule coordinates x (2N,), kept."""
        # by identity: the hash of an index is that of all its terms
        if id(index) not in self._coordinates:
            self._coordinates[id(index)] = index, index.of(self.measurements).ravel()
        return self._coordinates[id(index)][1]

    def equations(self, T: Array, chosen: Chosen, widened: float = 1.0) -> Equations:
        """Normal equations of the chosen components."""
        tables = chosen.tables
        return Equations(
            *_kernels.equations_depth(
                T, *self._points, self._camera, chosen.rows, chosen.fisher, chosen.used,
                tables.log_prob, tables.weight, widened,
            ),
            np.eye(6),
        )  # fmt: skip

    def total_scores(self, motions: Array, chosen: Chosen, bounds: Array) -> Array:
        """Gradients (K, 6) of the log-density of the chosen components within their bounds."""
        scores: Array = _kernels.total_scores_depth(
            motions, *self._points, self._camera, chosen.rows, chosen.used, bounds, chosen.tables.weight
        )
        return scores

    def retract(self, T: Array, step: Array) -> Array:
        """Motion after a step (6,)."""
        return np.asarray(_kernels.retract(T, step))


@dataclass(frozen=True)
class ThreePoint:
    """Three flow vectors of known depth: six equations for the six freedoms of a motion."""

    residual: KnownDepth
    minimal: ClassVar[int] = 3

    def among(self, which: NDArray[np.bool_]) -> KnownDepth:
        """Return the residual of some of the vectors (N,) alone."""
        r = self.residual
        widened = None if r.widened is None else r.widened[which]
        return KnownDepth(r.measurements.select(which), r.camera, r.rho[which], r.excluded, widened)

    def coordinates(self, index: Index) -> Array:
        """Coordinates x (N, 2) of the eigen-components."""
        return self.residual.coordinates(index).reshape(-1, 2)

    def propose(self, samples: NDArray[np.intp], start: Array) -> Array:
        """Motions (M, 3, 4) through three points each, those that converged from `start`."""
        directions, rho, ends, _ = self.residual._points
        motions, converged = _kernels.three_point_motions(
            samples, start, directions, rho, ends, self.residual._camera
        )
        return motions[converged]

    def components(self, kept: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Components (2N,) of kept eigen-components (N, 2)."""
        return kept.ravel()

    def bounds(self, bound: Bound, index: Index) -> Array:
        """Bounds (2N, 1) [px] of the eigen-components."""
        return bound(self.residual.coordinates(index))[:, None]

    def support(self, hypotheses: Array, bounds: Array, by_vector: bool) -> NDArray[np.int64]:
        """Inlier components, or vectors, of each motion."""
        inputs = (hypotheses, *self.residual._points, self.residual._camera, bounds.reshape(-1, 2), by_vector)
        return count_support(_kernels.support_depth, inputs, len(hypotheses))

    def resolve(self, hypothesis: Array, inliers_of: InliersOf) -> Array:
        """Return the hypothesis: it is a motion, and with known depth no other has the same errors."""
        return hypothesis
