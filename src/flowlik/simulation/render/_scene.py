"""A scene: copies of prototypes under the sun, ready to be rendered."""

from __future__ import annotations

import zlib
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform

from flowlik.geometry.camera import Pinhole
from flowlik.simulation._base import Frame
from flowlik.simulation.render._daylight import Daylight
from flowlik.simulation.render._detail import THIN_PX, drawn_leaves, drawn_wood
from flowlik.simulation.render._materials import Material
from flowlik.simulation.render._prototypes import Instances, Prototype
from flowlik.simulation.render._raster.distances import distances_m
from flowlik.simulation.render._raster.frame import render_frame, triangles_of
from flowlik.simulation.render._raster.packed import Drawn, Looks, Shapes, pack_looks, pack_shapes, tile_names
from flowlik.simulation.render._raster.shadows import TEXELS, Shadows, no_shadows, shadow_map
from flowlik.simulation.render._textures.tiles import make_tiles
from flowlik.support.arrays import Array

FAR_M = 10.0
"""Clearances are measured up to this distance."""


@dataclass(frozen=True, eq=False)
class Scene:
    """Prototypes, their copies, materials, light and shadows, laid out for the rasteriser.

    Attributes
    ----------
    shapes, looks : Shapes, Looks
        Prototypes and materials.
    instances : Instances
        The static copies, followed by one for each moving object.
    identities : array (N,) int64
        The same for the same copy wherever it stands in the list.
    spheres : array (N, 4)
        Bounding spheres of the static copies: centre in {n} and radius [m].
    movers : array (M,) int64
        Prototype of each moving object.
    light : Daylight
        Daylight.
    shadows : Shadows
        Where the sun is hidden; moving objects cast none.
    """

    shapes: Shapes
    looks: Looks
    instances: Instances
    identities: NDArray[np.int64]
    spheres: Array
    movers: NDArray[np.int64]
    light: Daylight
    shadows: Shadows

    @classmethod
    def of(
        cls,
        prototypes: Sequence[Prototype],
        instances: Instances,
        materials: Sequence[Material],
        light: Daylight,
        seed: int,
        movers: Sequence[int] = (),
        shadow_area: tuple[float, float, float] | None = None,
    ) -> Scene:
        """Pack a scene, make its textures and cast its shadows.

        Parameters
        ----------
        prototypes : sequence of Prototype
            Things of which copies may stand in the scene.
        instances : Instances
            The copies that stand still.
        materials : sequence of Material
            What the prototypes' material numbers mean.
        light : Daylight
            Daylight.
        seed : int
            Seed of the textures.
        movers : sequence of int
            Prototype of each moving object; where they are is said when rendering.
        shadow_area : tuple of three float or None
            Centre x, z and half size [m] of the square in which shadows fall; None for no shadows.
        """
        shapes = pack_shapes(prototypes)
        spheres = bounding_spheres(shapes, instances)
        shadows = no_shadows(light)
        if shadow_area is not None:
            # every fourth leaf, twice as large, casts the same expected shadow
            leaves = np.diff(shapes.leaf_starts)[instances.prototypes]
            least_m = np.full(len(instances), THIN_PX * 2 * shadow_area[2] / TEXELS)
            casting = _standing(shapes, instances, least_m, leaves=-(-leaves // 4), scale=2.0)
            shadows = shadow_map(shapes, casting, spheres, light, shadow_area)
        looks = pack_looks(materials, make_tiles(seed, tile_names(materials)))
        moving = np.asarray(movers, np.int64)
        return cls(shapes, looks, instances, _identities(instances), spheres, moving, light, shadows)

    def render(
        self, T_n_c: RigidTransform, camera: Pinhole, samples: int = 16, mover_transforms: Array | None = None
    ) -> Frame:
        """Anti-aliased picture and exact depth seen from one pose.

        Parameters
        ----------
        T_n_c : RigidTransform
            One pose, camera (x right, y down, z forward) to world [m].
        camera : Pinhole
            The camera.
        samples : int
            Visibility samples a pixel: 16, or 0 for depth alone (the radiance is then 0).
        mover_transforms : array (M, 3, 4) or None
            Where the moving objects are, prototype to {n} [m].
        """
        drawn = self.drawn(T_n_c, camera, mover_transforms)
        return render_frame(
            self.shapes, drawn, self.looks, self.light, self.shadows, T_n_c, camera, samples > 0
        )

    def drawn(self, T_n_c: RigidTransform, camera: Pinhole, mover_transforms: Array | None = None) -> Drawn:
        """Copies in view from a pose, near to far, with the leaves that are drawn of each."""
        instances, spheres, identities = self.instances, self.spheres, self.identities
        static = len(instances)
        if mover_transforms is not None and len(self.movers):
            moving = Instances(self.movers, np.asarray(mover_transforms, np.float64))
            instances = Instances.joined([instances, moving])
            spheres = np.concatenate([spheres, bounding_spheres(self.shapes, moving)])
            identities = np.concatenate([identities, np.arange(len(moving))])
        seen = _in_view(spheres, T_n_c, camera)
        distance_m = np.linalg.norm(spheres[seen, :3] - T_n_c.translation, axis=1) - spheres[seen, 3]
        order = np.argsort(distance_m, kind="stable")
        seen, distance_m = seen[order], np.maximum(distance_m[order], 0)
        shown = Instances(instances.prototypes[seen], instances.transforms[seen])
        focal_px = max(camera.fx, camera.fy)
        fine, leaves, scale = drawn_leaves(self.shapes, shown, distance_m, focal_px)
        parts, points = drawn_wood(self.shapes, shown, THIN_PX * distance_m / focal_px)
        return Drawn(
            shown.prototypes,
            np.ascontiguousarray(shown.transforms),
            identities[seen],
            np.where(seen < static, -1, seen - static),
            parts,
            points,
            fine,
            leaves,
            scale,
        )

    def drawn_triangles(
        self, T_n_c: RigidTransform, camera: Pinhole, mover_transforms: Array | None = None
    ) -> Array:
        """Corners (F, 3, 3) in {n} [m] of all triangles drawn from a pose, for other renderers."""
        return triangles_of(self.shapes, self.drawn(T_n_c, camera, mover_transforms))

    def clearance(self, positions_m: Array) -> Array:
        """Distance (N,) [m], at most 10, from positions (N, 3) in {n} to the nearest static surface."""
        return clearance(self.shapes, self.instances, self.spheres, positions_m)


def clearance(shapes: Shapes, instances: Instances, spheres: Array, positions_m: Array) -> Array:
    """Distance (N,) [m], at most 10, from positions (N, 3) in {n} to copies that stand still.

    Parameters
    ----------
    shapes, instances
        Prototypes, and which of them stand where.
    spheres : array (M, 4)
        What `bounding_spheres` says of the copies.
    positions_m : array (N, 3)
        The positions [m].
    """
    positions = np.ascontiguousarray(np.atleast_2d(positions_m), np.float64)
    low, high = positions.min(axis=0), positions.max(axis=0)
    gap = np.maximum(np.maximum(low - spheres[:, :3], spheres[:, :3] - high), 0)
    near = np.flatnonzero(np.linalg.norm(gap, axis=1) < spheres[:, 3] + FAR_M)
    standing = Instances(instances.prototypes[near], instances.transforms[near])
    drawn = _standing(shapes, standing, np.zeros(len(near)))
    return distances_m(positions, shapes, drawn, spheres[near], FAR_M)


def _standing(
    shapes: Shapes,
    instances: Instances,
    least_width_m: Array,
    leaves: NDArray[np.int64] | int = 0,
    scale: float = 1.0,
) -> Drawn:
    """Copies as they stand, from nowhere in particular; leaves as rhombi of some scale."""
    count = len(instances)
    none = np.zeros(count, np.int64)
    parts, points = drawn_wood(shapes, instances, least_width_m)
    return Drawn(
        instances.prototypes,
        np.ascontiguousarray(instances.transforms),
        none,
        none - 1,
        parts,
        points,
        none,
        none + leaves,
        np.full(count, scale),
    )


def _identities(instances: Instances) -> NDArray[np.int64]:
    """Numbers drawn from where the copies stand, so that they do not depend on what else is in the list."""
    places = np.ascontiguousarray(np.rint(instances.transforms[:, :, 3] * 1e4).astype(np.int64))
    return np.array([zlib.crc32(place.tobytes()) for place in places], np.int64)


def bounding_spheres(shapes: Shapes, instances: Instances) -> Array:
    """Bounding spheres (N, 4) of copies: centre in {n} and radius [m]."""
    mine, linear = shapes.spheres[instances.prototypes], instances.transforms[:, :, :3]
    centres = np.einsum("nij,nj->ni", linear, mine[:, :3]) + instances.transforms[:, :, 3]
    return np.column_stack([centres, mine[:, 3] * np.linalg.norm(linear[:, :, 0], axis=1)])


def _in_view(spheres: Array, T_n_c: RigidTransform, camera: Pinhole) -> NDArray[np.int64]:
    """Numbers of the spheres that reach into the picture."""
    x, y, z = T_n_c.inv().apply(spheres[:, :3]).T
    radius = spheres[:, 3]
    seen = z > -radius
    for along, centre, focal, size in (
        (x, camera.cx, camera.fx, camera.width),
        (y, camera.cy, camera.fy, camera.height),
    ):
        # signed distances to the planes through the picture's borders
        low, high = (-1.0 - centre) / focal, (size - centre) / focal
        seen &= along - low * z > -radius * np.hypot(1, low)
        seen &= high * z - along > -radius * np.hypot(1, high)
    return np.flatnonzero(seen)
