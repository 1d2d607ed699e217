"""The world `forest`: trees, undergrowth, rocks and houses beside a track, in a ring of wooded hills."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from functools import cached_property, lru_cache
from typing import Any, ClassVar

import numpy as np
from scipy.spatial.transform import RigidTransform

from flowlik.errors import DataError
from flowlik.geometry.camera import Pinhole
from flowlik.simulation._base import Frame, SentAsParameters
from flowlik.simulation.render import Daylight, Instances, Prototype, Scene, placed
from flowlik.simulation.worlds.forest._hills import hills
from flowlik.simulation.worlds.forest._kinds import MATERIALS, make_kinds, material
from flowlik.simulation.worlds.forest._plan import planted
from flowlik.simulation.worlds.forest._terrain import CENTRE_M, Terrain, check_sizes
from flowlik.support.arrays import Array


@dataclass(frozen=True)
class ForestWorld(SentAsParameters):
    """A forest on rolling ground around the centre lines, which it keeps free by 2.2 m.

    Parameters
    ----------
    seed : int
        Draws everything.
    near_trees, far_trees : int
        How many trees stand within 11 m of the paths, and beyond.
    bushes, ferns, grass, rocks, houses : int
        How many of each stand in the world; grass in tufts.
    leaves : int
        Leaves of a tree beside the paths, if `foliage` is 1.
    foliage : float
        Number of leaves as a share of the usual; 0 is winter.
    extent_m : float
        Side of the square that is the world [m], a multiple of 32, at least 192; hills stand around it.
    cell_m : float
        Size of the ground's mesh beside the paths [m].
    light : Daylight
        Daylight.

    Raises
    ------
    DataError
        If a number is negative, a size impossible, or there is no room for everything.
    """

    seed: int = 0
    near_trees: int = 176
    far_trees: int = 624
    bushes: int = 550
    ferns: int = 450
    grass: int = 5000
    rocks: int = 220
    houses: int = 6
    leaves: int = 7000
    foliage: float = 1.0
    extent_m: float = 256.0
    cell_m: float = 0.5
    light: Daylight = field(default_factory=Daylight)

    name: ClassVar[str] = "forest"

    def __post_init__(self) -> None:
        counts = (*self._counts.values(), self.leaves)
        if self.seed < 0 or min(counts) < 0 or not 0 <= self.foliage <= 10:
            raise DataError(f"impossible {self}: seed and counts must be 0 or more, foliage 0 to 10")
        check_sizes(self.extent_m, self.cell_m)

    @classmethod
    def small(cls, seed: int = 0) -> ForestWorld:
        """Make a forest that is built and drawn quickly: fewer things, with fewer and larger leaves."""
        return cls(
            seed,
            near_trees=70,
            far_trees=110,
            bushes=90,
            ferns=80,
            grass=500,
            rocks=60,
            houses=3,
            leaves=2000,
            extent_m=192.0,
            cell_m=1.0,
        )

    def parameters(self) -> dict[str, Any]:
        """Everything needed to build this world again, as plain JSON values."""
        return asdict(self)

    def render(self, T_n_c: RigidTransform, camera: Pinhole, time_s: float = 0.0) -> Frame:
        """Picture and exact depth seen from one pose; nothing moves, so the time changes nothing."""
        return self._scene.render(T_n_c, camera)

    def mover_poses(self, time_s: float) -> RigidTransform | None:
        """None: nothing moves."""
        return None

    def clearance(self, positions: Array) -> Array:
        """Distance (N,) [m] of positions (N, 3) in {n} to the nearest surface, at most 10; negative outside.

        Outside is beyond the square and below the ground.
        """
        positions = np.atleast_2d(np.asarray(positions, np.float64))
        x, y, z = positions.T
        beyond = np.abs(positions[:, [0, 2]] - CENTRE_M).max(axis=1) - self.extent_m / 2
        outside = np.maximum(beyond, y - self._terrain.ground_m(x, z))
        return np.where(outside >= 0, -outside, self._scene.clearance(positions))

    @cached_property
    def _terrain(self) -> Terrain:
        return Terrain.of(self.seed, self.extent_m, self.cell_m)

    @cached_property
    def _scene(self) -> Scene:
        return _built(self)

    @property
    def _counts(self) -> dict[str, int]:
        return {
            "house": self.houses,
            "tree": self.near_trees,
            "far tree": self.far_trees,
            "rock": self.rocks // 3,
            "stone": self.rocks - self.rocks // 3,
            "bush": self.bushes,
            "fern": self.ferns,
            "grass": self.grass,
        }

    def _layout(self, kinds: dict[str, list[Prototype]]) -> dict[str, list[tuple[int, Array]]]:
        return planted(self.seed, self._terrain, self._counts, kinds)


# flights through one forest build it once
@lru_cache(maxsize=1)
def _built(world: ForestWorld) -> Scene:
    kinds = make_kinds(world.seed, world.leaves, world.foliage)
    ground = [
        *world._terrain.patches(material("ground")),
        *hills(world.seed, world._terrain, material("hills")),
    ]
    prototypes = [Prototype(mesh) for mesh in ground]
    copies = [(i, placed(np.zeros(3))) for i in range(len(prototypes))]
    stand = world._layout(kinds)
    for name, things in kinds.items():
        copies += [(len(prototypes) + which, transform) for which, transform in stand[name]]
        prototypes += things
    return Scene.of(
        prototypes,
        Instances.of(copies),
        list(MATERIALS.values()),
        world.light,
        world.seed,
        shadow_area=(*CENTRE_M, world.extent_m / 2),
    )
