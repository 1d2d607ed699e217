"""Textured rectangles seen ray by ray: light and depth are exact, at every row's own pose."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import lru_cache

import numba
import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from flowlik.geometry.camera import Pinhole
from flowlik.support.arrays import Array

SIDE = 512
LEVELS = 5
TEXTURES = 4
FAR_M = 1e3


@dataclass(frozen=True, eq=False)
class Rectangle:
    """A textured rectangle in {n}.

    Attributes
    ----------
    centre : array (3,)
        Its middle [m].
    right, down : array (3,)
        Unit vectors along its sides, orthogonal.
    half_m : (float, float)
        Half its width and height [m].
    texel_m : float
        Size of a texture's element.
    texture : int
        Which of the scene's textures.
    contrast : float
        Standard deviation [grey levels] about the mean grey.
    """

    centre: Array
    right: Array
    down: Array
    half_m: tuple[float, float] = (FAR_M, FAR_M)
    texel_m: float = 0.01
    texture: int = 0
    contrast: float = 40.0


@dataclass(frozen=True, eq=False)
class Scene:
    """Rectangles, their textures (T, LEVELS, SIDE, SIDE) of unit variance, and the mean grey level."""

    rectangles: list[Rectangle]
    textures: Array = field(default_factory=lambda: natural_textures(0))
    mean: float = 128.0

    def view(self, camera: Pinhole, rows: RigidTransform) -> tuple[Array, Array]:
        """Grey levels and depth along z [m] (H, W), not yet seen by a sensor; inf where there is nothing.

        `rows` (H,) are the poses T_n_c at which the rows are read, or one for all.
        """
        height = camera.height
        R = np.broadcast_to(rows.rotation.as_matrix(), (height, 3, 3))
        c = np.broadcast_to(rows.translation, (height, 3))
        r = self.rectangles
        axes = np.array([[x.right, x.down, np.cross(x.right, x.down)] for x in r], np.float64)
        looks = np.array([[*x.half_m, x.texel_m, x.contrast] for x in r], np.float64)
        grey = np.empty((height, camera.width))
        depth = np.empty_like(grey)
        _cast(
            np.ascontiguousarray(R), np.ascontiguousarray(c), (camera.fx, camera.fy, camera.cx, camera.cy),
            np.array([x.centre for x in r], np.float64), axes, looks,
            np.array([x.texture for x in r]), self.textures, self.mean, grey, depth,
        )  # fmt: skip
        return grey, depth


@lru_cache(maxsize=2)
def natural_textures(seed: int) -> Array:
    """Periodic textures whose octaves are alike in contrast, each in ever coarser versions."""
    rng = np.random.default_rng([seed, 1])
    frequency = np.hypot(np.fft.fftfreq(SIDE)[:, None], np.fft.rfftfreq(SIDE))
    frequency[0, 0] = np.inf
    return np.array([
        _pyramid(np.fft.rfft2(rng.standard_normal((SIDE, SIDE))) / np.maximum(frequency, 0.01), frequency)
        for _ in range(TEXTURES)
    ])  # fmt: skip


def squares(period: int) -> Array:
    """One texture of bright squares on a lattice of a period [texels], in ever coarser versions."""
    v, u = np.mgrid[:SIDE, :SIDE] % period
    pattern = ((u < period // 2) & (v < period // 2)).astype(np.float64)
    frequency = np.hypot(np.fft.fftfreq(SIDE)[:, None], np.fft.rfftfreq(SIDE))
    return _pyramid(np.fft.rfft2(pattern - pattern.mean()), frequency)[None]


def _pyramid(spectrum: Array, frequency: Array) -> Array:
    """Versions (LEVELS, SIDE, SIDE) seen from 1, 2, 4 ... times as far; the first has unit variance."""
    finite = np.where(np.isfinite(frequency), frequency, 0.0)
    # a Gaussian of 0.8 texels leaves little that the cubic between texels cannot follow
    blurs = np.array([np.fft.irfft2(spectrum * _gaussian(finite, 0.8 * 2**k)) for k in range(LEVELS)])
    return (blurs / blurs[0].std()).astype(np.float32)


def _gaussian(frequency: Array, sigma: float) -> Array:
    return np.asarray(np.exp(-2 * (np.pi * sigma * frequency) ** 2))


def looking(direction: Array) -> tuple[Array, Array]:
    """Sides `right` and `down` of a rectangle whose normal (3,) points along a direction."""
    n = np.asarray(direction, np.float64) / np.linalg.norm(direction)
    helper = np.array([0.0, 1.0, 0.0]) if abs(n[1]) < 0.9 else np.array([0.0, 0.0, 1.0])
    right = np.cross(helper, n)
    right /= np.linalg.norm(right)
    return right, np.cross(n, right)


def plane(normal: Array, distance_m: float, texel_m: float, texture: int = 0) -> Rectangle:
    """Plane n . X = d in {n}, without end."""
    right, down = looking(normal)
    n = np.asarray(normal, np.float64) / np.linalg.norm(normal)
    return Rectangle(distance_m * n, right, down, texel_m=texel_m, texture=texture)


def gallery(rng: np.random.Generator, camera: Pinhole, near_m: float = 2.0, far_m: float = 9.0) -> Scene:
    """A far wall with a dozen tilted boards before it: parallax all over the image."""
    rectangles = [plane([0, 0, 1], far_m + 1, (far_m + 1) / camera.fx)]
    for _ in range(12):
        z = rng.uniform(near_m, far_m)
        reach = z * np.array([camera.width / camera.fx, camera.height / camera.fy]) / 2
        right, down = looking(np.array([*rng.normal(0, 0.35, 2), 1.0]))
        rectangles.append(
            Rectangle(
                np.array([*rng.uniform(-1, 1, 2) * reach, z]), right, down,
                tuple(rng.uniform(0.08, 0.25, 2) * z), z / camera.fx, int(rng.integers(TEXTURES)),
            )
        )  # fmt: skip
    return Scene(rectangles, natural_textures(int(rng.integers(2**31))))


def turn(yaw: float = 0.0, pitch: float = 0.0, roll: float = 0.0) -> Rotation:
    """Rotation by angles [deg] about y, x and z in turn: the camera's yaw to the right, pitch, roll."""
    return Rotation.from_euler("YXZ", [yaw, pitch, roll], degrees=True)


@numba.njit(cache=True, nogil=True)
def _cubic(texture, u, v):  # type: ignore[no-untyped-def]
    """Catmull-Rom interpolation of a periodic texture at column u and row v."""
    iu, iv = int(np.floor(u)), int(np.floor(v))
    a, b = u - iu, v - iv
    wa = (-a / 2 + a * a - a**3 / 2, 1 - 2.5 * a * a + 1.5 * a**3,
          a / 2 + 2 * a * a - 1.5 * a**3, -a * a / 2 + a**3 / 2)  # fmt: skip
    wb = (-b / 2 + b * b - b**3 / 2, 1 - 2.5 * b * b + 1.5 * b**3,
          b / 2 + 2 * b * b - 1.5 * b**3, -b * b / 2 + b**3 / 2)  # fmt: skip
    total = 0.0
    for j in range(4):
        for i in range(4):
            total += wb[j] * wa[i] * texture[(iv + j - 1) % SIDE, (iu + i - 1) % SIDE]
    return total


@numba.njit(cache=True, nogil=True)
def _cast(R, c, camera, centres, axes, looks, which, textures, mean, grey, depth):  # type: ignore[no-untyped-def]
    fx, fy, cx, cy = camera
    count = len(centres)
    slopes, offsets = np.empty((count, 3, 3)), np.empty((count, 3))
    for row in range(depth.shape[0]):
        # a ray (x, y, 1) at depth z is at z * slope . ray - offset along each axis of a rectangle
        for p in range(count):
            slopes[p] = axes[p] @ R[row]
            offsets[p] = axes[p] @ (centres[p] - c[row])
        y = (row - cy) / fy
        for column in range(depth.shape[1]):
            x = (column - cx) / fx
            nearest, best, bu, bv, cosine = np.inf, -1, 0.0, 0.0, 1.0
            for p in range(count):
                slope = slopes[p, 2, 0] * x + slopes[p, 2, 1] * y + slopes[p, 2, 2]
                if slope == 0.0:
                    continue
                z = offsets[p, 2] / slope
                if z <= 0 or z >= nearest:
                    continue
                u = z * (slopes[p, 0, 0] * x + slopes[p, 0, 1] * y + slopes[p, 0, 2]) - offsets[p, 0]
                v = z * (slopes[p, 1, 0] * x + slopes[p, 1, 1] * y + slopes[p, 1, 2]) - offsets[p, 1]
                if abs(u) <= looks[p, 0] and abs(v) <= looks[p, 1]:
                    nearest, best, bu, bv = z, p, u, v
                    cosine = abs(slope) / np.sqrt(x * x + y * y + 1)
            depth[row, column] = nearest
            if best < 0:
                grey[row, column] = mean
                continue
            texel, t = looks[best, 2], which[best]
            level = np.log2(nearest / (fx * texel)) - 0.5 * np.log2(cosine)
            level = min(max(level, 0.0), LEVELS - 1.001)
            low = int(level)
            u, v = bu / texel, bv / texel
            value = (1 - level + low) * _cubic(textures[t, low], u, v)
            value += (level - low) * _cubic(textures[t, low + 1], u, v)
            grey[row, column] = mean + looks[best, 3] * value
