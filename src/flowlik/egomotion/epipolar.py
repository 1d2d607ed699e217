"""Flow of points of unknown depth: the epipolar constraint."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, ClassVar

import cv2
import numpy as np
from numpy.typing import NDArray

from flowlik.egomotion import _kernels
from flowlik.egomotion.known_depth import KnownDepth
from flowlik.egomotion.residual import Bound, Chosen, Equations, InliersOf, count_inliers, equations_of
from flowlik.geometry.camera import Pinhole
from flowlik.geometry.motion import decompose_essential, in_front, skew
from flowlik.likelihood.schedule import Index
from flowlik.measurement.measurements import Measurements
from flowlik.support.arrays import Array

ANGLES = 17
STILL_PX = 0.1
AMBIGUOUS_SHARE = 0.9


@dataclass(frozen=True, eq=False)
class Epipolar:
    """Flow of points of unknown depth: one component a vector, orthogonal to its epipolar line.

    The translation is known up to scale and has unit length.
    """

    minimal: ClassVar[int] = 5
    components_per_vector: ClassVar[int] = 1
    metric: ClassVar[bool] = False
    counted_px: ClassVar[float] = 2.0
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
    _isotropic: dict[Index, dict[str, Array]] = field(init=False, repr=False, default_factory=dict)

    def __len__(self) -> int:
        """Return the number of flow vectors."""
        return len(self.measurements)

    def linearise(self, T: Array) -> tuple[Array, Array]:
        """Distances z (N,) [px] and Jacobian (N, 6); NaN at the epipole."""
        z, _, J = _kernels.linearise_epipolar(T, *self._rays, self._focal)
        return z, J

    def linearise_with_normal(self, T: Array) -> tuple[Array, Array, Array]:
        """Distances z (N,) [px], unit normals (N, 2) of the lines in {i}, and Jacobian (N, 6)."""
        return _kernels.linearise_epipolar(T, *self._rays, self._focal)

    def coordinates(self, T: Array, index: Index) -> Array:
        """Coordinates x (N,) along the normals of the epipolar lines."""
        return index.along(self.measurements, self.linearise_with_normal(T)[1], self._held(index))

    def eigen_coordinates(self, index: Index) -> Array:
        """Coordinates x (N, 2) of the eigen-components."""
        return index.of(self.measurements)

    def equations(self, T: Array, chosen: Chosen, widened: float = 1.0) -> Equations:
        """Normal equations of the chosen components."""
        return equations_of(*self.linearise(T), chosen, widened)

    def total_score(self, T: Array, chosen: Chosen, bounds: Array) -> Array:
        """Gradient of the log-density of the chosen components within their bounds."""
        z, J = self.linearise(T)
        within = chosen._replace(used=chosen.used & (np.abs(z) <= bounds))
        return equations_of(z, J, within, 1.0).b

    def directions(self, T: Array) -> Array:
        """Normals (N, 2) of the epipolar lines."""
        _, normal, _ = _kernels.linearise_epipolar(T, *self._rays, self._focal)
        return normal

    def basis(self, T: Array) -> Array:
        """Rotation, and translation orthogonal to its direction: (6, 5)."""
        t = T[:, 3] / np.linalg.norm(T[:, 3])
        basis = np.zeros((6, 5))
        basis[:3, :3] = np.eye(3)
        # a reflection that takes the smallest axis to t takes the other two to a basis of its plane
        mirror = t - np.eye(3)[(axis := int(np.abs(t).argmin()))]
        plane = np.eye(3) - 2 * np.outer(mirror, mirror) / (mirror @ mirror)
        basis[3:, 3:] = np.delete(plane, axis, axis=1)
        return basis

    def propose(self, samples: NDArray[np.intp], start: Array) -> Array:
        """Essential matrices (M, 3, 3) of five points each; a sample gives up to ten."""
        first, second = (np.ascontiguousarray(rays[:, :2]) for rays in self._rays)
        solutions = [five_point(first[sample], second[sample]) for sample in samples]
        return np.concatenate([np.empty((0, 3, 3)), *solutions])

    def hypothesis(self, T: Array) -> Array:
        """Essential matrix (3, 3) of a motion."""
        return np.asarray(skew(T[:, 3]) @ T[:, :3])

    def bounds(self, bound: Bound, index: Index, kept: NDArray[np.bool_]) -> Array:
        """Bounds (N, 17) [px] over nodes of the normal's pseudo-angle: they depend on its direction."""
        p = np.linspace(-1, 1, ANGLES)
        normals = np.stack([1 - np.abs(p), p], axis=-1)
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        held = self._held(index)
        along = [index.along(self.measurements, np.tile(n, (len(self), 1)), held) for n in normals]
        return np.where(self.kept_components(kept)[:, None], bound(np.stack(along, axis=-1)), -1.0)

    def _held(self, index: Index) -> dict[str, Array]:
        """What of an index does not depend on the direction, worked out once."""
        if index not in self._isotropic:
            self._isotropic[index] = index.isotropic(self.measurements)
        return self._isotropic[index]

    def score(self, hypotheses: Array, bounds: Array, by_vector: bool) -> NDArray[np.int64]:
        """Inlier components of each essential matrix; a vector has one."""
        inputs = (hypotheses, *self._rays, self._focal, bounds)
        return count_inliers(_kernels.score_epipolar, inputs, len(hypotheses))

    def motion(self, hypothesis: Array, inliers_of: InliersOf) -> tuple[Array, bool]:
        """Of an essential matrix's four motions, the one with most inliers in front of both cameras.

        It is ambiguous where the second has nearly as many.
        """
        candidates = decompose_essential(hypothesis)
        m = self.measurements.select(inliers_of(candidates[0].as_matrix()[:3]))
        votes = np.array([in_front(T, self.camera, m.pixels, m.flow).sum() for T in candidates])
        second, first = np.sort(votes)[-2:]
        return candidates[int(votes.argmax())].as_matrix()[:3], bool(second >= AMBIGUOUS_SHARE * first)

    def still(self) -> bool:
        """Whether half of the flow is below a tenth of a pixel: there is no direction to find."""
        return bool(np.median(np.linalg.norm(self.measurements.flow, axis=1)) < STILL_PX)

    def rotation_share(self, T: Array, bound: Bound, index: Index) -> float:
        """Share of eigen-components that points at infinity would explain: near 1 there is no parallax."""
        m, c = self.measurements, self.camera
        at_infinity = KnownDepth(m, c, np.zeros(len(m)))
        z, _ = at_infinity.linearise(T)
        return float(np.mean(np.abs(z) <= bound(at_infinity.coordinates(T, index))))

    def kept_components(self, kept: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Vectors (N,) of which any eigen-component is kept."""
        return np.asarray(kept.any(axis=1))

    def normalise(self, T: Array) -> Array:
        """Return the motion with a translation of unit length."""
        return np.column_stack([T[:, :3], T[:, 3] / np.linalg.norm(T[:, 3])])


def five_point(first: Array, second: Array) -> Array:
    """Essential matrices (M, 3, 3) through five matches of normalised points (5, 2), by OpenCV's solver."""
    try:
        stacked: Any = cv2.findEssentialMat(first, second, np.eye(3))[0]
    except cv2.error:
        return np.empty((0, 3, 3))
    if stacked is None or len(stacked) % 3:
        return np.empty((0, 3, 3))
    return np.asarray(stacked).reshape(-1, 3, 3)
