"""The world `driving`: a road with everything beside it, built along any route in squares."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any, ClassVar

import numpy as np
from scipy.spatial.transform import RigidTransform

from flowlik.errors import DataError
from flowlik.geometry.camera import Pinhole
from flowlik.simulation._base import Frame, SentAsParameters
from flowlik.simulation.render import (
    FAR_M,
    Daylight,
    Instances,
    Mesh,
    Prototype,
    Scene,
    Shapes,
    bounding_spheres,
    clearance,
    pack_shapes,
    placed,
)
from flowlik.simulation.worlds.driving._ground import SQUARE_M, Ground, Square, far_land, square_of
from flowlik.simulation.worlds.driving._kinds import Kinds, make_kinds
from flowlik.simulation.worlds.driving._layout import Layout
from flowlik.simulation.worlds.driving._materials import MATERIALS, material
from flowlik.simulation.worlds.driving._profiles import profile_of
from flowlik.simulation.worlds.driving._roads import Roads
from flowlik.simulation.worlds.driving._route import Route, drive_of
from flowlik.simulation.worlds.driving._surface import GroundSurface
from flowlik.simulation.worlds.driving._traffic import Traffic, make_traffic
from flowlik.support.arrays import Array

KITTI_CAMERA = Pinhole(1242, 375, 721.5377, 721.5377, 609.5593, 172.854)
"""The rectified camera of KITTI's odometry sequence 03."""

RINGS = (2, 4, 5)
"""Rings of squares around the camera's with everything, without what is small, and with what is tall."""

ROAD_RINGS = 9
"""Rings of squares in which roads are drawn."""

SHADOW_RADIUS_M = 100.0

_LIGHT = Daylight(sun=2.5, sky=0.12, haze_per_m=0.0006, horizon=0.75, zenith=0.3)


@dataclass(frozen=True)
class DrivingWorld(SentAsParameters):
    """Streets, a country road or a motorway along a route, with everything beside it.

    The camera is taken to be 1.65 m above the road and to drive in the right-hand lane. What stands in a
    square of 64 m depends on seed and route alone; a scene holds the squares around the camera's square.

    Parameters
    ----------
    route : Route
        Where the camera drives.
    seed : int
        Draws everything beside the route.
    traffic : int
        Number of moving vehicles.
    scenery : str
        "street", "country", "motorway", or "auto" to choose by the route's median speed.
    frames_per_second : float
        Frame rate of the route's poses [1/s], from which speed and traffic follow.
    leaves : int
        Leaves of a street tree.
    samples : int
        Visibility samples a pixel: 16, or 0 for depth alone.
    light : Daylight
        Daylight.

    Raises
    ------
    DataError
        If a parameter is out of range or there is no room for the traffic.
    """

    route: Route
    seed: int = 0
    traffic: int = 0
    scenery: str = "auto"
    frames_per_second: float = 10.0
    leaves: int = 5000
    samples: int = 16
    light: Daylight = _LIGHT

    name: ClassVar[str] = "driving"

    def __post_init__(self) -> None:
        if min(self.seed, self.traffic, self.samples) < 0 or self.leaves < 10:
            raise DataError(
                f"impossible driving world: seed {self.seed}, traffic {self.traffic} and samples "
                f"{self.samples} must be 0 or more, leaves {self.leaves} at least 10"
            )
        if not self.frames_per_second > 0:
            raise DataError(f"driving: frame rate {self.frames_per_second} must be positive")
        # both complain of what they cannot build
        profile_of(self.scenery, self.route.positions_m, self.frames_per_second)
        drive_of(self.route)

    @classmethod
    def along(cls, poses: RigidTransform, seed: int = 0, **parameters: Any) -> DrivingWorld:
        """Build the world along camera poses T_n_c (N,); parameters are those of the class."""
        return cls(Route.of(poses), seed, **parameters)

    def parameters(self) -> dict[str, Any]:
        """Everything needed to build this world again, as plain JSON values; of the route, what names it."""
        steps_m = np.linalg.norm(np.diff(self.route.positions_m, axis=0), axis=1)
        return {
            "route": {
                "poses": len(self.route.positions_m),
                "length_m": float(steps_m.sum()),
                "sha256": self.route.digest,
            },
            "seed": self.seed,
            "traffic": self.traffic,
            "scenery": self._ground.roads.profile.name,
            "frames_per_second": self.frames_per_second,
            "leaves": self.leaves,
            "samples": self.samples,
            "light": {**vars(self.light)},
        }

    def render(self, T_n_c: RigidTransform, camera: Pinhole, time_s: float = 0.0) -> Frame:
        """Picture and exact depth seen from one pose at one time.

        Parameters
        ----------
        T_n_c : RigidTransform
            One pose, camera (x right, y down, z forward) to world [m].
        camera : Pinhole
            The camera.
        time_s : float
            Time [s] since the route's first pose; moves the traffic only.
        """
        scene = _scene(self, square_of(T_n_c.translation[[0, 2]]))
        moving = self._traffic.transforms(time_s) if self.traffic else None
        return scene.render(T_n_c, camera, self.samples, moving)

    def mover_poses(self, time_s: float) -> RigidTransform | None:
        """Poses T_n_o (M,) of the moving vehicles: z forward, foot on the road; None without traffic."""
        return self._traffic.poses(time_s) if self.traffic else None

    def clearance(self, positions: Array) -> Array:
        """Distance (N,) [m], at most 10, of positions (N, 3) to what stands still; negative below ground."""
        positions = np.atleast_2d(np.asarray(positions, np.float64))
        plan = positions[:, [0, 2]]
        above_m = self._ground.surface(plan) - positions[:, 1]
        distances = np.minimum(above_m, FAR_M)
        squares = np.floor(plan / SQUARE_M).astype(int)
        for column, row in np.unique(squares, axis=0):
            here = (squares == (column, row)).all(axis=1)
            nearest = self._things_near((int(column), int(row)), positions[here])
            distances[here] = np.where(above_m[here] > 0, np.minimum(distances[here], nearest), above_m[here])
        return distances

    def surface_m(self, points: Array) -> Array:
        """Height y (N,) [m] of the ground at plan points (N, 2) = (x, z), kerbs included."""
        return self._ground.surface(np.asarray(points, np.float64))

    @cached_property
    def _ground(self) -> Ground:
        profile = profile_of(self.scenery, self.route.positions_m, self.frames_per_second)
        return Ground(Roads.along(drive_of(self.route), profile), self.seed)

    @cached_property
    def _layout(self) -> Layout:
        surface = GroundSurface(self._ground, {name: material(name) for name in MATERIALS}, self.seed)
        kinds = _kinds(self.seed, self.leaves)
        return Layout.of(surface, kinds, self.seed, self.route.positions_m)

    @cached_property
    def _traffic(self) -> Traffic:
        kinds = _kinds(self.seed, self.leaves)
        return make_traffic(
            self._ground, kinds, self.traffic, self.seed, self.frames_per_second, self.route.positions_m
        )

    def _things_near(self, square: Square, positions: Array) -> Array:
        """Distances (N,) [m], at most 10, of positions (N, 3) in a square to the things around it."""
        plan = positions[:, [0, 2]]
        low, high = plan.min(axis=0) - 25.0, plan.max(axis=0) + 25.0
        reached = [near for near, _ in _around(square, 1) if _touches(near, low, high)]
        instances = Instances.joined([_things(self, near, 2) for near in reached])
        feet = instances.transforms[:, [0, 2], 3]
        close = ((feet > low) & (feet < high)).all(axis=1)
        if not close.any():
            return np.full(len(positions), FAR_M)
        standing = Instances(instances.prototypes[close], instances.transforms[close])
        shapes = _shapes(self.seed, self.leaves)
        return clearance(shapes, standing, bounding_spheres(shapes, standing), positions)


@lru_cache(maxsize=2)
def _kinds(seed: int, leaves: int) -> Kinds:
    return make_kinds(seed, leaves)


@lru_cache(maxsize=1)
def _shapes(seed: int, leaves: int) -> Shapes:
    return pack_shapes(_kinds(seed, leaves).prototypes)


@lru_cache(maxsize=2)
def _scene(world: DrivingWorld, middle: Square) -> Scene:
    """Everything seen from a square."""
    layout = world._layout
    around = _around(middle, ROAD_RINGS)
    patches = [
        (square, ring <= RINGS[0])
        for square, ring in around
        if ring <= RINGS[1] or world._ground.has_road(square)
    ]
    kinds = layout.kinds.prototypes
    drawn = frozenset(square for square, _ in patches)
    land = far_land(world._ground, middle, drawn, material("land"))
    corners = [*(square for square, _ in patches), middle]
    meshes = [*(_patch(world, square, fine) for square, fine in patches), land]
    feet = [placed(np.array([column * SQUARE_M, 0.0, row * SQUARE_M])) for column, row in corners]
    grounds = Instances.of([(len(kinds) + i, foot) for i, foot in enumerate(feet)])
    things = [
        _things(world, square, sum(ring <= limit for limit in RINGS) - 1)
        for square, ring in around
        if ring <= RINGS[-1]
    ]
    centre = (np.array(middle) + 0.5) * SQUARE_M
    return Scene.of(
        [*kinds, *(Prototype(mesh) for mesh in meshes)],
        Instances.joined([grounds, *things]),
        list(MATERIALS.values()),
        world.light,
        world.seed,
        movers=world._traffic.prototypes if world.traffic else (),
        shadow_area=(float(centre[0]), float(centre[1]), SHADOW_RADIUS_M),
    )


@lru_cache(maxsize=160)
def _patch(world: DrivingWorld, square: Square, fine: bool) -> Mesh:
    """Ground of a square; kept, for the next scene holds most of them again."""
    return world._layout.surface.square(square, fine)


@lru_cache(maxsize=400)
def _things(world: DrivingWorld, square: Square, detail: int) -> Instances:
    """Copies that stand in a square; kept likewise."""
    return world._layout.square(square, detail)


def _touches(square: Square, low: Array, high: Array) -> bool:
    """Whether a square shares a point with the rectangle between two corners (2,) [m]."""
    corner = np.array(square) * SQUARE_M
    return bool(((corner < high) & (corner + SQUARE_M > low)).all())


def _around(middle: Square, rings: int) -> list[tuple[Square, int]]:
    """Squares around one, and in which ring each lies; the nearest first."""
    reach = range(-rings, rings + 1)
    found = [((middle[0] + i, middle[1] + j), max(abs(i), abs(j))) for i in reach for j in reach]
    return sorted(found, key=lambda square: square[1])
