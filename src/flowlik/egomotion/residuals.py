"""Residuals: what turns a motion into error components (z, J, x) for a likelihood."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, ClassVar, Protocol

import cv2
import numpy as np
from numpy.typing import NDArray

from flowlik.camera import Array, Pinhole
from flowlik.egomotion import _kernels
from flowlik.errors import DataError
from flowlik.measurements import Measurements
from flowlik.motion import decompose_essential, in_front
from flowlik.schedule import Index
from flowlik.threads import in_bands

ANGLES = 17
SCORED_TOGETHER = 25
STILL_PX = 0.1
AMBIGUOUS_SHARE = 0.9

Bound = Callable[[Array], Array]
InliersOf = Callable[[Array], NDArray[np.bool_]]


class Residual(Protocol):
    """The four steps of an estimator need this much of a problem.

    Motions are (3, 4) matrices ``[R | t]`` of ``T_k_prev``. A hypothesis is what a minimal sample gives:
    a motion for known depth, an essential matrix for the epipolar residual.
    """

    minimal: ClassVar[int]
    components_per_vector: ClassVar[int]
    metric: ClassVar[bool]

    @property
    def measurements(self) -> Measurements:
        """Flow vectors in use."""
        ...

    @property
    def excluded(self) -> dict[str, int]:
        """Flow vectors left out, by reason."""
        ...

    def __len__(self) -> int:
        """Return the number of flow vectors."""
        ...

    def linearise(self, T: Array) -> tuple[Array, Array]:
        """Errors z (C,) [px] and their Jacobian (C, 6) at a motion; NaN errors where there is no image."""
        ...

    def coordinates(self, T: Array, index: Index) -> Array:
        """Schedule coordinates x (C,) of the errors at a motion."""
        ...

    def basis(self, T: Array) -> Array:
        """Observable directions (6, D) of the tangent at a motion."""
        ...

    def propose(self, samples: NDArray[np.intp], start: Array) -> Array:
        """Hypotheses (M, ...) of minimal samples (K, minimal) of vectors."""
        ...

    def bounds(self, bound: Bound, index: Index, kept: NDArray[np.bool_]) -> Array:
        """Bounds [px] in the form `score` takes; components not in ``kept`` (N, 2) are left out."""
        ...

    def score(self, hypotheses: Array, bounds: Array, by_vector: bool) -> NDArray[np.int64]:
        """Inliers of each hypothesis."""
        ...

    def motion(self, hypothesis: Array, inliers_of: InliersOf) -> tuple[Array, bool]:
        """Motion (3, 4) that a hypothesis stands for, and whether another explains the data as well."""
        ...

    def still(self) -> bool:
        """Whether nothing moves, so that the residual says nothing about a motion."""
        ...

    def rotation_share(self, T: Array, bound: Bound, index: Index) -> float:
        """Share of eigen-components that the motion's rotation alone explains within their bounds."""
        ...

    def kept_components(self, kept: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Which components (C,) a gate on eigen-components (N, 2) keeps."""
        ...

    def normalise(self, T: Array) -> Array:
        """Return the motion with what is unobservable set by convention."""
        ...


@dataclass(frozen=True, eq=False)
class KnownDepth:
    """Flow of points of known depth: two eigen-components a vector, z = R_e_i (y - h)."""

    minimal: ClassVar[int] = 3
    components_per_vector: ClassVar[int] = 2
    metric: ClassVar[bool] = True
    measurements: Measurements
    camera: Pinhole
    rho: Array
    excluded: dict[str, int] = field(default_factory=dict)

    @classmethod
    def of(cls, measurements: Measurements, camera: Pinhole, depth_z: Array) -> KnownDepth:
        """Residual of measurements with a depth map (H, W) [m] along z, or depths (N,) at their pixels.

        Vectors whose depth is NaN, zero, negative or infinite are left out and counted. A map is read
        at the nearest pixel: depth must not be interpolated across an edge.

        Raises
        ------
        DataError
            If the depth map's size is not the camera's.
        """
        if depth_z.ndim == 2:
            if depth_z.shape != (camera.height, camera.width):
                size = f"{camera.width}x{camera.height}"
                raise DataError(f"depth map of {depth_z.shape[1]}x{depth_z.shape[0]} for a camera of {size}")
            column, row = np.rint(measurements.pixels).astype(int).T
            depth_z = depth_z[row, column]
        elif depth_z.shape != (len(measurements),):
            raise DataError(f"{len(measurements)} measurements, but depths of shape {depth_z.shape}")
        usable = np.isfinite(depth_z) & (depth_z > 0)
        kept = measurements.select(usable)
        scale = np.linalg.norm(camera.rays(kept.pixels), axis=-1)
        excluded = {"no depth": int((~usable).sum()), "no flow": measurements.lost}
        return cls(kept, camera, 1.0 / (depth_z[usable] * scale), excluded)

    def __post_init__(self) -> None:
        m, c = self.measurements, self.camera
        arrays = (c.p2v(m.pixels), self.rho, m.pixels + m.flow, m.R_i_e)
        object.__setattr__(self, "_points", tuple(np.ascontiguousarray(a) for a in arrays))
        object.__setattr__(self, "_camera", (c.fx, c.fy, c.cx, c.cy))

    _points: tuple[Array, ...] = field(init=False, repr=False)
    _camera: tuple[float, ...] = field(init=False, repr=False)

    def __len__(self) -> int:
        """Return the number of flow vectors."""
        return len(self.rho)

    def linearise(self, T: Array) -> tuple[Array, Array]:
        """Errors z (2N,) [px] and Jacobian (2N, 6); NaN errors behind the camera."""
        return _kernels.linearise_depth(T, *self._points, self._camera)

    def coordinates(self, T: Array, index: Index) -> Array:
        """Coordinates x (2N,), the same at every motion."""
        return index.of(self.measurements.covariates).ravel()

    def basis(self, T: Array) -> Array:
        """All six directions are observable."""
        return np.eye(6)

    def propose(self, samples: NDArray[np.intp], start: Array) -> Array:
        """Motions (M, 3, 4) through three points each, those that converged from `start`."""
        directions, rho, ends, _ = self._points
        motions, converged = _kernels.three_point_motions(samples, start, directions, rho, ends, self._camera)
        return motions[converged]

    def bounds(self, bound: Bound, index: Index, kept: NDArray[np.bool_]) -> Array:
        """Bounds (N, 2) [px], -1 where left out."""
        return np.where(kept, bound(index.of(self.measurements.covariates)), -1.0)

    def score(self, hypotheses: Array, bounds: Array, by_vector: bool) -> NDArray[np.int64]:
        """Inlier components, or vectors, of each motion."""
        inputs = (hypotheses, *self._points, self._camera, bounds, by_vector)
        return _count(_kernels.score_depth, inputs, len(hypotheses))

    def motion(self, hypothesis: Array, inliers_of: InliersOf) -> tuple[Array, bool]:
        """Return the hypothesis, which is a motion."""
        return hypothesis, False

    def still(self) -> bool:
        """Return False: with known depth a standstill is a motion like any other."""
        return False

    def rotation_share(self, T: Array, bound: Bound, index: Index) -> float:
        """Return 0: with known depth a pure rotation is a motion like any other."""
        return 0.0

    def kept_components(self, kept: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Components (2N,) of kept eigen-components (N, 2)."""
        return kept.ravel()

    def normalise(self, T: Array) -> Array:
        """Return the motion unchanged: depth makes it metric."""
        return T


@dataclass(frozen=True, eq=False)
class Epipolar:
    """Flow of points of unknown depth: one component a vector, orthogonal to its epipolar line.

    The translation is known up to scale and has unit length.
    """

    minimal: ClassVar[int] = 5
    components_per_vector: ClassVar[int] = 1
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

    def __len__(self) -> int:
        """Return the number of flow vectors."""
        return len(self.measurements)

    def linearise(self, T: Array) -> tuple[Array, Array]:
        """Distances z (N,) [px] and Jacobian (N, 6); NaN at the epipole."""
        z, _, J = _kernels.linearise_epipolar(T, *self._rays, self._focal)
        return z, J

    def coordinates(self, T: Array, index: Index) -> Array:
        """Coordinates x (N,) along the normals of the epipolar lines."""
        _, normal, _ = _kernels.linearise_epipolar(T, *self._rays, self._focal)
        return index.along(self.measurements, normal)

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

    def bounds(self, bound: Bound, index: Index, kept: NDArray[np.bool_]) -> Array:
        """Bounds (N, 17) [px] over nodes of the normal's pseudo-angle: they depend on its direction."""
        p = np.linspace(-1, 1, ANGLES)
        normals = np.stack([1 - np.abs(p), p], axis=-1)
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        along = [index.along(self.measurements, np.tile(n, (len(self), 1))) for n in normals]
        return np.where(self.kept_components(kept)[:, None], bound(np.stack(along, axis=-1)), -1.0)

    def score(self, hypotheses: Array, bounds: Array, by_vector: bool) -> NDArray[np.int64]:
        """Inlier components of each essential matrix; a vector has one."""
        inputs = (hypotheses, *self._rays, self._focal, bounds)
        return _count(_kernels.score_epipolar, inputs, len(hypotheses))

    def motion(self, hypothesis: Array, inliers_of: InliersOf) -> tuple[Array, bool]:
        """Of an essential matrix's four motions, the one with most inliers in front of both cameras.

        It is ambiguous where the second has nearly as many.
        """
        candidates = decompose_essential(hypothesis)
        m = self.measurements.select(inliers_of(candidates[0].as_matrix()[:3]))
        votes = np.array([in_front(T, self.camera, m.pixels, m.flow).sum() for T in candidates])
        second, first = np.sort(votes)[-2:]
        return candidates[int(votes.argmax())].as_matrix()[:3], bool(second > AMBIGUOUS_SHARE * first)

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


def _count(kernel: Callable[..., None], inputs: tuple[Any, ...], hypotheses: int) -> NDArray[np.int64]:
    counts = np.zeros(hypotheses, np.int64)
    in_bands(lambda first, last: kernel(*inputs, first, last, counts), hypotheses, SCORED_TOGETHER)
    return counts


def five_point(first: Array, second: Array) -> Array:
    """Essential matrices (M, 3, 3) through five matches of normalised points (5, 2), by OpenCV's solver."""
    try:
        stacked: Any = cv2.findEssentialMat(first, second, np.eye(3))[0]
    except cv2.error:
        return np.empty((0, 3, 3))
    if stacked is None or len(stacked) % 3:
        return np.empty((0, 3, 3))
    return np.asarray(stacked).reshape(-1, 3, 3)
