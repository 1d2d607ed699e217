"""The ground along roads: level beside them, rolling farther away, with hills around.

Heights are exact on a lattice of `CELL_M` and bilinear in between, so that coarse and fine triangles over the
same cell meet without gaps.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import NDArray

from flowlik.simulation.render import Mesh, lattice
from flowlik.simulation.worlds.driving._roads import Roads, height_samples, smooth_heights
from flowlik.support.arrays import Array

CELL_M = 4.0
SQUARE_M = 64.0
CELLS = 16
FAR_CELL_M = 32.0
FAR_SQUARES = 20
"""The land reaches this many squares beyond the camera's."""

Square = tuple[int, int]


def square_of(point: Array) -> Square:
    """Square (column, row) of `SQUARE_M` in which a point (x, z) [m] lies."""
    column, row = np.floor(np.asarray(point) / SQUARE_M).astype(int)
    return int(column), int(row)


@dataclass(frozen=True, eq=False)
class Ground:
    """Heights of the land around roads, drawn from a seed.

    Attributes
    ----------
    roads : Roads
        The roads.
    seed : int
        Draws hills and hollows.
    """

    roads: Roads
    seed: int

    def field(self, points: Array) -> Array:
        """Height y (N,) [m] of the land at points (N, 2), without kerbs."""
        heights, distance = smooth_heights(points, self._samples)
        banks = _ramp(self.roads.edge(points), self.roads.profile.verge_m + 1.0, 30.0)
        rolling = _ramp(distance, 25.0, 160.0)
        hills = _ramp(distance, 120.0, 900.0)
        waves = self.waves(points)
        size = self.roads.profile.banks_m
        return np.asarray(
            heights - size * banks * waves[0] - 3.0 * rolling * waves[1] - 28.0 * hills * (1.1 + waves[2])
        )

    def level(self, points: Array) -> Array:
        """Height y (N,) [m] of the drawn ground at points (N, 2), as if it were nowhere raised by kerbs."""
        place = np.asarray(points, np.float64) / CELL_M
        corner = np.floor(place).astype(np.int64)
        share = place - corner
        nodes = (corner[:, None] + np.array([(0, 0), (1, 0), (0, 1), (1, 1)])).reshape(-1, 2)
        distinct, which = np.unique(nodes, axis=0, return_inverse=True)
        values = self.field(distinct * CELL_M)[which.ravel()].reshape(-1, 2, 2)
        rows = values[:, :, 0] * (1 - share[:, [0]]) + values[:, :, 1] * share[:, [0]]
        return np.asarray(rows[:, 0] * (1 - share[:, 1]) + rows[:, 1] * share[:, 1])

    def surface(self, points: Array) -> Array:
        """Height y (N,) [m] of the drawn ground at points (N, 2), kerbs included."""
        return self.level(points) - self.roads.profile.kerb_m * (self.roads.edge(points) > 0)

    def slope(self, points: Array, along: Array) -> Array:
        """Unit directions (N, 3) in {n} that follow the ground along plan directions (N, 2)."""
        reach = 1.5
        rise = self.level(points + reach * along) - self.level(points - reach * along)
        directions = np.column_stack([along[:, 0], rise / (2 * reach), along[:, 1]])
        return np.asarray(directions / np.linalg.norm(directions, axis=1, keepdims=True))

    def has_road(self, square: Square) -> bool:
        """Whether a street passes through a square or near it."""
        return square in self._with_road

    def nodes(self, square: Square) -> tuple[Array, Array]:
        """Heights (17, 17) and unit normals (17, 17, 3) at a square's lattice points, row by row along z."""
        return _nodes(self, square)

    @cached_property
    def _with_road(self) -> frozenset[Square]:
        points = np.concatenate([street.points for street in self.roads.streets])
        reach = self.roads.profile.half_width_m + self.roads.profile.verge_m
        shifts = reach * np.array([(i, j) for i in (-1, 0, 1) for j in (-1, 0, 1)])
        return frozenset(square_of(point) for point in (points[:, None] + shifts).reshape(-1, 2))

    @cached_property
    def _samples(self) -> Array:
        return height_samples(self.roads.drive)

    def waves(self, points: Array) -> Array:
        """Three fields (3, N) of about -1 to 1, of wavelengths around 60, 200 and 700 m."""
        rng = np.random.default_rng([self.seed, 11])
        lengths_m = np.array([60.0, 200.0, 700.0])[:, None] * np.exp(rng.uniform(-0.5, 0.5, (3, 6)))
        headings, phases = rng.uniform(0, 2 * np.pi, (2, 3, 6))
        x, z = points.T
        turn = np.cos(headings)[..., None] * x + np.sin(headings)[..., None] * z
        return np.sin(2 * np.pi * turn / lengths_m[..., None] + phases[..., None]).sum(axis=1) / 2.5


@lru_cache(maxsize=512)
def _nodes(ground: Ground, square: Square) -> tuple[Array, Array]:
    steps = CELL_M * np.arange(-1, CELLS + 2)
    x, z = np.meshgrid(square[0] * SQUARE_M + steps, square[1] * SQUARE_M + steps)
    heights = ground.field(np.column_stack([x.ravel(), z.ravel()])).reshape(x.shape)
    along_z, along_x = np.gradient(heights, CELL_M)
    normals = np.stack([along_x, -np.ones_like(heights), along_z], axis=-1)
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    return heights[1:-1, 1:-1], normals[1:-1, 1:-1]


def far_land(ground: Ground, middle: Square, drawn: frozenset[Square], material: int) -> Mesh:
    """Coarse land around a square, in coordinates from that square's corner, where no square is drawn.

    Parameters
    ----------
    ground : Ground
        Heights.
    middle : (int, int)
        The camera's square.
    drawn : frozenset of (int, int)
        Squares to leave out.
    material : int
        Its first surface is open land, its second woods.
    """
    per_square = round(SQUARE_M / FAR_CELL_M)
    count = (2 * FAR_SQUARES + 1) * per_square
    steps = FAR_CELL_M * np.arange(-FAR_SQUARES * per_square - 1, count - FAR_SQUARES * per_square + 2)
    x, z = np.meshgrid(steps, steps)
    corner = np.array(middle) * SQUARE_M
    plan = np.column_stack([x.ravel(), z.ravel()]) + corner
    y = ground.field(plan).reshape(x.shape)
    along_z, along_x = np.gradient(y, FAR_CELL_M)
    normals = np.stack([along_x, -np.ones_like(y), along_z], axis=-1)
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    woods = np.clip(0.5 + 2.0 * ground.waves(plan)[1], 0, 1)
    vertices = np.stack([x, y, z], axis=-1)[1:-1, 1:-1].reshape(-1, 3)
    left_out = np.zeros((count, count), np.bool_)
    for column, row in drawn:
        i, j = ((np.array([row, column]) - middle[::-1]) + FAR_SQUARES) * per_square
        left_out[i : i + per_square, j : j + per_square] = True
    kept = np.tile(~left_out.ravel(), 2)
    inside = woods.reshape(x.shape)[1:-1, 1:-1].ravel()
    land = Mesh.of(
        vertices,
        normals[1:-1, 1:-1].reshape(-1, 3),
        vertices[:, [0, 2]],
        lattice(count + 1, count + 1)[kept],
        material,
        inside,
    )
    return Mesh.joined([land, _skirts(vertices.reshape(count + 1, count + 1, 3), left_out, material)])


def _skirts(points: Array, left_out: NDArray[np.bool_], material: int) -> Mesh:
    """Upright faces that hang down from the coarse land's inner borders and close the gaps below them."""
    parts = []
    for axis in (0, 1):
        # cells on both sides of each edge of the lattice
        grid = points if axis == 0 else points.transpose(1, 0, 2)
        cells = left_out if axis == 0 else left_out.T
        i, j = np.nonzero(cells[1:] != cells[:-1])
        parts.append(np.stack([grid[i + 1, j], grid[i + 1, j + 1]], axis=1))
    edges = np.concatenate(parts)
    if not len(edges):
        return Mesh.joined([])
    corners = np.concatenate([edges, edges[:, ::-1] + [0.0, 3.0, 0.0]], axis=1).reshape(-1, 3)
    first = 4 * np.arange(len(edges))[:, None]
    triangles = np.concatenate([first + np.array([0, 1, 2]), first + np.array([0, 2, 3])])
    up = np.tile([0.0, -1.0, 0.0], (len(corners), 1))
    return Mesh.of(corners, up, corners[:, [0, 2]], triangles, material)


def _ramp(values: Array, low: float, high: float) -> Array:
    """Smooth step from 0 at low to 1 at high."""
    share = np.clip((values - low) / (high - low), 0, 1)
    return np.asarray(share * share * (3 - 2 * share))
