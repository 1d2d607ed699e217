"""A closed hall with rectangles in it: the common ground of the worlds `planes` and `grid`."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import asdict, dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform, Rotation

from flowlik.geometry.camera import Pinhole
from flowlik.simulation._base import Frame, SentAsParameters
from flowlik.simulation.worlds.paths import FREE_RADIUS_M, keep_free
from flowlik.simulation.worlds.planes._kernels import render_rectangles
from flowlik.simulation.worlds.planes._rectangles import (
    Rectangles,
    box,
    distances_m,
    pixel_bounds,
    ray_equations,
)
from flowlik.simulation.worlds.planes._textures import CONTRAST_PX, Textures
from flowlik.support.arrays import Array
from flowlik.support.threads import in_bands

HALL_LOW_M = np.array([-16.0, -7.0, -10.0])
HALL_HIGH_M = np.array([16.0, 2.5, 115.0])
"""Corners of the hall in {n}; y points down, so the ground is at y = 2.5 m, below a camera at y = 0."""

SIDES = 6
DISPLAY_GAMMA = 2.2
"""Textures are drawn as grey levels that the default sensor shows; light is their power of this."""

_ROWS_PER_BAND = 12


@dataclass(frozen=True, eq=False)
class Paint:
    """What is painted on the rectangles of a hall.

    Attributes
    ----------
    textures : Textures
        Tiles and contrast maps.
    tiles : array (R, 2) int
        Tile and contrast map of each rectangle.
    looks : array (R, 8)
        As `flowlik.simulation.worlds.planes._kernels.render_rectangles` takes them.
    """

    textures: Textures
    tiles: NDArray[np.int64]
    looks: Array


@dataclass(frozen=True)
class HallWorld(SentAsParameters):
    """Part that worlds in the hall share: they say what is painted, this says the rest."""

    seed: int = 0
    rectangles: int = 70
    samples: int = 8

    @property
    @abstractmethod
    def _paint(self) -> Paint:
        """What is painted on each of `surfaces`."""

    def parameters(self) -> dict[str, Any]:
        """Everything needed to build this world again, as plain JSON values."""
        return asdict(self)

    def render(self, T_n_c: RigidTransform, camera: Pinhole, time_s: float = 0.0) -> Frame:
        """Anti-aliased picture and exact depth from one pose; at any time the same."""
        return _render_hall(self.surfaces, self._paint, self.samples, T_n_c, camera)

    def mover_poses(self, time_s: float) -> None:
        """Return None: nothing moves."""
        return None

    def clearance(self, positions: Array) -> Array:
        """Distance (N,) [m] of positions (N, 3) in {n} to the nearest surface; negative outside the hall."""
        return _hall_clearance(positions, self.surfaces)

    @property
    def surfaces(self) -> Rectangles:
        """The six sides of the hall followed by the rectangles, which keep clear of the centre lines."""
        return _furnished_hall(self.seed, self.rectangles)


@lru_cache(maxsize=8)
def _furnished_hall(seed: int, rectangles: int) -> Rectangles:
    """Sides of the hall followed by random rectangles, which keep clear of the centre lines."""
    rng = np.random.default_rng([seed, 1])
    surfaces, free_m = box(HALL_LOW_M, HALL_HIGH_M, overlap_m=1.0), keep_free()
    while len(surfaces) < SIDES + rectangles:
        candidate = _random_rectangle(rng)
        if distances_m(free_m, candidate).min() > FREE_RADIUS_M:
            surfaces = surfaces.joined(candidate)
    return surfaces


def _hall_clearance(positions: Array, surfaces: Rectangles) -> Array:
    """Distance (N,) [m] of positions (N, 3) in {n} to the nearest surface; negative outside the hall."""
    positions = np.atleast_2d(np.asarray(positions, dtype=np.float64))
    nearest_m = distances_m(positions, surfaces).min(axis=1)
    inside = ((positions > HALL_LOW_M) & (positions < HALL_HIGH_M)).all(axis=1)
    return np.where(inside, nearest_m, -nearest_m)


def _render_hall(
    surfaces: Rectangles, paint: Paint, samples: int, T_n_c: RigidTransform, camera: Pinhole
) -> Frame:
    """Anti-aliased picture and exact depth from one pose.

    Parameters
    ----------
    surfaces : Rectangles
        R rectangles, the sides of the hall first.
    paint : Paint
        What is on them.
    samples : int
        Rays averaged in a pixel; they lie on a lattice of `samples` rows and columns, one in each.
    T_n_c : RigidTransform
        One pose, camera (x right, y down, z forward) to world [m].
    camera : Pinhole
        The camera.

    Returns
    -------
    Frame
        Linear radiance (H, W) float32, of which the default sensor shows the painted grey; depth along z
        [m] (H, W) float64 by closed-form intersection.
    """
    shape = (camera.height, camera.width)
    grey, depth = np.empty(shape, np.float32), np.empty(shape, np.float64)
    textures = paint.textures
    inputs = (
        np.array([camera.fx, camera.fy, camera.cx, camera.cy]),
        _lattice(samples),
        ray_equations(surfaces, T_n_c),
        surfaces.half_sizes_m,
        pixel_bounds(surfaces, T_n_c, camera),
        paint.tiles,
        paint.looks,
        textures.tile_px,
        textures.pyramids,
        textures.level_offsets,
        CONTRAST_PX,
        textures.contrasts,
    )
    in_bands(
        lambda first, last: render_rectangles((first, last), *inputs, grey, depth),
        camera.height,
        _ROWS_PER_BAND,
    )
    return Frame((grey / np.float32(255)) ** np.float32(DISPLAY_GAMMA), depth)


def _random_rectangle(rng: np.random.Generator) -> Rectangles:
    """One rectangle: half of them stand upright on the ground, the others hang turned in any way."""
    half_sizes_m = np.exp(rng.uniform(np.log(0.4), np.log(2.5), 2))
    centre_m = rng.uniform(HALL_LOW_M + 0.5, HALL_HIGH_M - 0.5)
    if rng.random() < 0.5:
        turn = Rotation.from_euler("y", rng.uniform(0, 2 * np.pi))
        centre_m[1] = HALL_HIGH_M[1] - half_sizes_m[1]
    else:
        turn = Rotation.random(rng=rng)
    axes = turn.apply(np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]))
    return Rectangles(centre_m[None], axes[None], half_sizes_m[None])


def _lattice(samples: int) -> Array:
    """Offsets (samples, 2) [px] around the pixel centre, one in each of `samples` columns and rows."""
    index = np.arange(samples)
    near_root = range(max(1, round(samples**0.5)), samples + 1)
    step = next(s for s in near_root if np.gcd(s, samples) == 1)
    return (np.column_stack([index, index * step % samples]) + 0.5) / samples - 0.5
