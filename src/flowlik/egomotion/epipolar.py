"""Flow of points of unknown depth: the epipolar constraint."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, ClassVar

import cv2
import numpy as np
from numpy.typing import NDArray

from flowlik.egomotion import _kernels
from flowlik.egomotion.residual import (
    Bound,
    Chosen,
    Equations,
    InliersOf,
    Linearised,
    count_support,
    equations_of,
)
from flowlik.geometry.camera import Pinhole
from flowlik.geometry.motion import decompose_essential, in_front, skew
from flowlik.likelihood.schedule import Index
from flowlik.measurement.measurements import Measurements
from flowlik.support.arrays import Array

# nodes of the direction of an epipolar normal, over which bounds are tabulated
ANGLES = 17


@dataclass(frozen=True, eq=False)
class Epipolar:
    """Flow of points of unknown depth: one component a vector, orthogonal to its epipolar line.

    The translation is known up to scale and has unit length.
    """

    metric: ClassVar[bool] = False
    measurements: Measurements
    camera: Pinhole
    excluded: dict[str, int] = field(default_factory=dict)

    @classmethod
    def of(cls, measurements: Measurements, camera: Pinhole) -> Epipolar:
        """Residual of measurements by one camera."""
        return cls(measurements, camera, {"no flow": measurements.lost})

    def __post_init__(self) -> None:
        m, c = self.measurements, self.camera
        rays = (np.ascontiguousarray(c.rays(p)) for p in (m.pixels, m.pixels + m.flow))
        object.__setattr__(self, "_rays", tuple(rays))
        object.__setattr__(self, "_focal", (c.fx, c.fy))

    _rays: tuple[Array, Array] = field(init=False, repr=False)
    _focal: tuple[float, float] = field(init=False, repr=False)
    _isotropic: dict[int, tuple[Index, dict[str, Array]]] = field(
        init=False, repr=False, default_factory=dict
    )

    def __len__(self) -> int:
        """Return the number of flow vectors."""
        return len(self.measurements)

    @property
    def sampling(self) -> FivePoint:
        """Samples of five vectors."""
        return FivePoint(self)

    def at(self, T: Array, index: Index) -> Linearised:
        """Distances z (N,) [px] along the normals of the epipolar lines; NaN at the epipole."""
        z, normal, J = self.linearise(T)
        x = index.along(self.measurements, normal, self.isotropic(index))
        return Linearised(T, z, J, x, normal, observable(T))

    def linearise(self, T: Array) -> tuple[Array, Array, Array]:
        """Distances z (N,) [px], unit normals (N, 2) of the lines in {i}, and Jacobian (N, 6)."""
        return _kernels.linearise_epipolar(T, *self._rays, self._focal)

    def isotropic(self, index: Index) -> dict[str, Array]:
        """What of an index does not depend on the direction, kept."""
        # by identity: the hash of an index is that of all its terms
        if id(index) not in self._isotropic:
            self._isotropic[id(index)] = index, index.isotropic(self.measurements)
        return self._isotropic[id(index)][1]

    def equations(self, T: Array, chosen: Chosen, widened: float = 1.0) -> Equations:
        """Normal equations of the chosen components."""
        z, _, J = self.linearise(T)
        return equations_of(z, J, observable(T), chosen, widened)

    def total_scores(self, motions: Array, chosen: Chosen, bounds: Array) -> Array:
        """Gradients (K, 6) of the log-density of the chosen components within their bounds."""
        scores = []
        for T in motions:
            z, _, J = self.linearise(T)
            within = chosen._replace(used=chosen.used & (np.abs(z) <= bounds))
            scores.append(equations_of(z, J, observable(T), within).b)
        return np.array(scores)

    def retract(self, T: Array, step: Array) -> Array:
        """Motion after a step (6,), with a translation of unit length."""
        moved = _kernels.retract(T, step)
        return np.column_stack([moved[:, :3], moved[:, 3] / np.linalg.norm(moved[:, 3])])


@dataclass(frozen=True)
class FivePoint:
    """Five flow vectors: an essential matrix, which four motions share."""

    residual: Epipolar
    minimal: ClassVar[int] = 5

    def among(self, which: NDArray[np.bool_]) -> Epipolar:
        """Return the residual of some of the vectors (N,) alone."""
        r = self.residual
        return Epipolar(r.measurements.select(which), r.camera, r.excluded)

    def coordinates(self, index: Index) -> Array:
        """Coordinates x (N, 2) of the eigen-components."""
        return index.of(self.residual.measurements)

    def propose(self, samples: NDArray[np.intp], start: Array) -> Array:
        """Essential matrices (M, 3, 3) of five vectors each; a sample gives up to ten."""
        first, second = (np.ascontiguousarray(rays[:, :2]) for rays in self.residual._rays)
        solutions = [five_point(first[sample], second[sample]) for sample in samples]
        return np.concatenate([np.empty((0, 3, 3)), *solutions])

    def components(self, kept: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Vectors (N,) of which any eigen-component is kept."""
        return np.asarray(kept.any(axis=1))

    def bounds(self, bound: Bound, index: Index) -> Array:
        """Bounds (N, 17) [px] over nodes of the normal's pseudo-angle: they depend on its direction."""
        p = np.linspace(-1, 1, ANGLES)
        normals = np.stack([1 - np.abs(p), p], axis=-1)
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        m, held = self.residual.measurements, self.residual.isotropic(index)
        along = [index.along(m, np.tile(n, (len(m), 1)), held) for n in normals]
        return bound(np.stack(along, axis=-1))

    def support(self, hypotheses: Array, bounds: Array, by_vector: bool) -> NDArray[np.int64]:
        """Inlier components of each essential matrix; a vector has one."""
        inputs = (hypotheses, *self.residual._rays, self.residual._focal, bounds)
        return count_support(_kernels.support_epipolar, inputs, len(hypotheses))

    def resolve(self, hypothesis: Array, inliers_of: InliersOf) -> Array:
        """Of the four motions of an essential matrix, that with most inliers in front of both cameras.

        A motion (3, 4) stands for its own matrix.
        """
        E = hypothesis if hypothesis.shape == (3, 3) else skew(hypothesis[:, 3]) @ hypothesis[:, :3]
        candidates = decompose_essential(E)
        m = self.residual.measurements.select(inliers_of(candidates[0].as_matrix()[:3]))
        votes = [in_front(c, self.residual.camera, m.pixels, m.flow).sum() for c in candidates]
        return candidates[int(np.argmax(votes))].as_matrix()[:3]


def observable(T: Array) -> Array:
    """Tangent directions (6, 5) that epipolar errors observe: rotation, and translation across itself."""
    t = T[:, 3] / np.linalg.norm(T[:, 3])
    basis = np.zeros((6, 5))
    basis[:3, :3] = np.eye(3)
    # a reflection that takes the smallest axis to t takes the other two to a basis of its plane
    mirror = t - np.eye(3)[(axis := int(np.abs(t).argmin()))]
    plane = np.eye(3) - 2 * np.outer(mirror, mirror) / (mirror @ mirror)
    basis[3:, 3:] = np.delete(plane, axis, axis=1)
    return basis


def five_point(first: Array, second: Array) -> Array:
    """Essential matrices (M, 3, 3) through five matches of normalised points (5, 2), by OpenCV's solver."""
    try:
        stacked: Any = cv2.findEssentialMat(first, second, np.eye(3))[0]
    except cv2.error:
        return np.empty((0, 3, 3))
    if stacked is None or len(stacked) % 3:
        return np.empty((0, 3, 3))
    matrices = np.asarray(stacked).reshape(-1, 3, 3)
    return matrices[np.isfinite(matrices).all(axis=(1, 2))]
