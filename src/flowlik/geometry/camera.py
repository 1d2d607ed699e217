"""Camera models: pixels to directions (p2v) and back (v2p)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flowlik.errors import DataError
from flowlik.support.arrays import Array

NEWTON_STEPS = 4
LEAST_SLOPE = 0.1


@dataclass(frozen=True)
class Pinhole:
    """Distortion-free perspective camera; axes x right, y down, z forward.

    Pixels are ``(u, v)`` = (column, row) with the origin at the centre of the top-left pixel.

    Parameters
    ----------
    width, height : int
        Image size [px].
    fx, fy : float
        Focal lengths [px].
    cx, cy : float
        Principal point [px].

    Raises
    ------
    DataError
        If the size or a focal length is not positive, or a value is not finite.
    """

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float

    def __post_init__(self) -> None:
        finite = np.isfinite([self.fx, self.fy, self.cx, self.cy]).all()
        if not finite or min(self.width, self.height, self.fx, self.fy) <= 0:
            raise DataError(f"impossible camera {self}: size and focal lengths must be positive and finite")

    @classmethod
    def from_fov(cls, width: int, height: int, fov_x_deg: float) -> Pinhole:
        """Camera with square pixels, centred principal point and a horizontal field of view [deg].

        Raises
        ------
        DataError
            If the field of view does not lie between 0 and 180 degrees.
        """
        if not 0 < fov_x_deg < 180:
            raise DataError(f"impossible field of view {fov_x_deg} deg: must lie between 0 and 180")
        f = 0.5 * width / np.tan(np.deg2rad(fov_x_deg) / 2)
        return cls(width, height, float(f), float(f), (width - 1) / 2, (height - 1) / 2)

    @property
    def K(self) -> Array:
        """Camera matrix (3, 3) [px]."""
        return np.array([[self.fx, 0, self.cx], [0, self.fy, self.cy], [0, 0, 1]], dtype=np.float64)

    def rays(self, pixels: Array) -> Array:
        """Directions (N, 3) in {c} scaled to z = 1, so that a point is ``depth_z * ray``."""
        pixels = np.asarray(pixels, dtype=np.float64)
        x = (pixels[..., 0] - self.cx) / self.fx
        y = (pixels[..., 1] - self.cy) / self.fy
        return np.stack([x, y, np.ones_like(x)], axis=-1)

    def p2v(self, pixels: Array) -> Array:
        """Unit direction vectors (N, 3) in {c} of pixels (N, 2); p2v of the paper's Eq. (1)."""
        rays = self.rays(pixels)
        return rays / np.linalg.norm(rays, axis=-1, keepdims=True)

    def v2p(self, vectors: Array) -> Array:
        """Pixels (N, 2) of vectors (N, 3) in {c} of any length; NaN where a vector points backwards."""
        vectors = np.asarray(vectors, dtype=np.float64)
        z = np.where(vectors[..., 2] > 0, vectors[..., 2], np.nan)
        u = self.fx * vectors[..., 0] / z + self.cx
        v = self.fy * vectors[..., 1] / z + self.cy
        return np.stack([u, v], axis=-1)

    def v2p_jacobian(self, vectors: Array) -> Array:
        """Derivative (N, 2, 3) [px per unit of the vector] of `v2p`."""
        x, y, z = np.moveaxis(np.asarray(vectors, dtype=np.float64), -1, 0)
        zero = np.zeros_like(x)
        du = np.stack([self.fx / z, zero, -self.fx * x / z**2], axis=-1)
        dv = np.stack([zero, self.fy / z, -self.fy * y / z**2], axis=-1)
        return np.stack([du, dv], axis=-2)

    def pixel_grid(self) -> Array:
        """All pixel centres (height * width, 2) in row-major order."""
        v, u = np.mgrid[0 : self.height, 0 : self.width]
        return np.stack([u.ravel(), v.ravel()], axis=-1).astype(np.float64)

    def contains(self, pixels: Array) -> NDArray[np.bool_]:
        """Whether pixels (N, 2) lie inside the image, between the outermost pixel centres; NaN is outside."""
        u, v = pixels[..., 0], pixels[..., 1]
        return (u >= 0) & (u <= self.width - 1) & (v >= 0) & (v <= self.height - 1)


@dataclass(frozen=True)
class Distortion:
    """Radial distortion of Brown and Conrady: a ray seen at ``x (1 + k1 r^2 + k2 r^4)`` for its true x.

    x are coordinates on the plane z = 1, r their distance from the optical axis; OpenCV's convention.

    Parameters
    ----------
    k1, k2 : float
        Coefficients; zero is a pinhole camera.
    """

    k1: float = 0.0
    k2: float = 0.0

    def distort(self, points: Array) -> Array:
        """Where true points (N, 2) on the plane z = 1 are seen."""
        square = (points**2).sum(axis=-1, keepdims=True)
        return np.asarray(points * (1 + square * (self.k1 + self.k2 * square)))

    @property
    def fold(self) -> float:
        """Radius of true points at which the radius seen stops growing; infinite where it never does."""
        # the slope 1 + 3 k1 q + 5 k2 q^2 is 0 at the smallest positive q = 2 / below
        discriminant = 9 * self.k1**2 - 20 * self.k2
        below = np.sqrt(discriminant) - 3 * self.k1 if discriminant >= 0 else 0.0
        return float(np.sqrt(2 / below)) if below > 1e-12 else np.inf

    def undistort(self, points: Array) -> Array:
        """True points (N, 2) on the plane z = 1 of seen ones, by Newton's method on the radius.

        Beyond what the fold shows there is no true point; such a point is put on the fold.
        """
        seen = np.linalg.norm(points, axis=-1, keepdims=True)
        fold = self.fold
        radius = np.minimum(seen, fold)
        for _ in range(NEWTON_STEPS):
            square = radius**2
            slope = 1 + square * (3 * self.k1 + 5 * self.k2 * square)
            excess = radius * (1 + square * (self.k1 + self.k2 * square)) - seen
            radius = np.clip(radius - excess / np.maximum(slope, LEAST_SLOPE), 0.0, fold)
        return np.asarray(points * np.divide(radius, seen, out=np.ones_like(seen), where=seen > 0))

    def stretch(self, points: Array, normals: Array) -> Array:
        """How much longer (N,) the distance to a line is where it is seen, for lines through true points.

        `normals` (N, 2) are those of the lines, of unit length.
        """
        square = (points**2).sum(axis=-1)
        scale = 1 + square * (self.k1 + self.k2 * square)
        bend = 2 * self.k1 + 4 * self.k2 * square
        # the inverse of scale I + bend x x^T
        along = (points * normals).sum(axis=-1) * bend / np.maximum(scale + bend * square, LEAST_SLOPE)
        return np.asarray(scale / np.linalg.norm(normals - along[..., None] * points, axis=-1))

    def ideal_pixels(self, camera: Pinhole, pixels: Array) -> Array:
        """Where a pinhole camera would have seen what this distortion shows at pixels (N, 2)."""
        rays = camera.rays(pixels)
        rays[..., :2] = self.undistort(rays[..., :2])
        return camera.v2p(rays)
