"""The world `planes`: a closed hall with textured rectangles standing and hanging in it."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from functools import cached_property
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform, Rotation

from flowlik.camera import Pinhole
from flowlik.errors import DataError
from flowlik.simulation._kernels import render_rectangles
from flowlik.simulation.base import Frame
from flowlik.simulation.paths import FREE_RADIUS_M, keep_free
from flowlik.simulation.rectangles import Rectangles, box, distances_m, pixel_bounds, ray_equations
from flowlik.simulation.textures import CONTRAST_MAPS, CONTRAST_PX, TILE_PX, TILES, make_textures
from flowlik.threads import in_bands

Array = NDArray[np.float64]

HALL_LOW_M = np.array([-16.0, -7.0, -10.0])
HALL_HIGH_M = np.array([16.0, 2.5, 115.0])
"""Corners of the hall in {n}; y points down, so the ground is at y = 2.5 m, below a camera at y = 0."""

_ROWS_PER_BAND = 12


@dataclass(frozen=True)
class PlanesWorld:
    """Textured planes of exact depth: a hall of 32 x 9.5 x 125 m with rectangles in it.

    Parameters
    ----------
    seed : int
        Draws the rectangles and their textures.
    rectangles : int
        Number of rectangles in the hall.
    samples : int
        Rays averaged in a pixel; they lie on a lattice of `samples` rows and columns, one in each.

    Raises
    ------
    DataError
        If `seed` or `rectangles` is negative or `samples` is less than 1.
    """

    seed: int = 0
    rectangles: int = 70
    samples: int = 8

    name: ClassVar[str] = "planes"

    def __post_init__(self) -> None:
        if self.seed < 0 or self.rectangles < 0 or self.samples < 1:
            raise DataError(f"impossible {self}: seed and rectangles must be 0 or more, samples 1 or more")

    def parameters(self) -> dict[str, Any]:
        """Everything needed to build this world again, as plain JSON values."""
        return asdict(self)

    def render(self, T_n_c: RigidTransform, camera: Pinhole) -> Frame:
        """Anti-aliased picture and exact depth from one pose.

        Parameters
        ----------
        T_n_c : RigidTransform
            One pose, camera (x right, y down, z forward) to world [m].
        camera : Pinhole
            The camera.

        Returns
        -------
        Frame
            Radiance 0 to 255 (H, W) float32; depth along z [m] (H, W) float64 by closed-form intersection.
        """
        shape = (camera.height, camera.width)
        radiance, depth = np.empty(shape, np.float32), np.empty(shape, np.float64)
        textures = make_textures(self.seed)
        tiles, looks = self._paint
        inputs = (
            np.array([camera.fx, camera.fy, camera.cx, camera.cy]),
            _lattice(self.samples),
            ray_equations(self.surfaces, T_n_c),
            self.surfaces.half_sizes_m,
            pixel_bounds(self.surfaces, T_n_c, camera),
            tiles,
            looks,
            TILE_PX,
            textures.pyramids,
            textures.level_offsets,
            CONTRAST_PX,
            textures.contrasts,
        )
        in_bands(
            lambda first, last: render_rectangles((first, last), *inputs, radiance, depth),
            camera.height,
            _ROWS_PER_BAND,
        )
        return Frame(radiance, depth)

    def clearance(self, positions: Array) -> Array:
        """Distance (N,) [m] of positions (N, 3) in {n} to the nearest surface; negative outside the hall."""
        positions = np.atleast_2d(np.asarray(positions, dtype=np.float64))
        nearest_m = distances_m(positions, self.surfaces).min(axis=1)
        inside = ((positions > HALL_LOW_M) & (positions < HALL_HIGH_M)).all(axis=1)
        return np.where(inside, nearest_m, -nearest_m)

    @cached_property
    def surfaces(self) -> Rectangles:
        """The six sides of the hall followed by the rectangles, which keep clear of the centre lines."""
        rng = np.random.default_rng([self.seed, 1])
        surfaces, free_m = box(HALL_LOW_M, HALL_HIGH_M, overlap_m=1.0), keep_free()
        while len(surfaces) < 6 + self.rectangles:
            candidate = _random_rectangle(rng)
            if distances_m(free_m, candidate).min() > FREE_RADIUS_M:
                surfaces = surfaces.joined(candidate)
        return surfaces

    @cached_property
    def _paint(self) -> tuple[NDArray[np.int64], Array]:
        """Tiles (R, 2) and looks (R, 8) as the rendering kernel takes them."""
        rng, count = np.random.default_rng([self.seed, 2]), len(self.surfaces)
        tiles = np.column_stack([rng.permutation(count) % TILES, rng.permutation(count) % CONTRAST_MAPS])
        # so that the six sides of the hall, most of every picture, differ
        tiles[:6, 0] = rng.permutation(TILES)[:6]
        is_hall = np.arange(count) < 6
        contrast = np.exp(rng.uniform(np.log(np.where(is_hall, 50, 25)), np.log(125)))
        mean = rng.uniform(1 + contrast, 254 - contrast)
        tile_period_m = np.where(is_hall, rng.uniform(4, 8, count), rng.uniform(2, 7, count))
        contrast_period_m = np.where(is_hall, rng.uniform(22, 40, count), rng.uniform(10, 20, count))
        phases = rng.random((count, 4))
        looks = [mean, contrast, 1 / tile_period_m, phases[:, :2], 1 / contrast_period_m, phases[:, 2:]]
        return tiles, np.column_stack(looks)


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
