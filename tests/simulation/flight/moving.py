"""A world with two moving things in which everything is known in closed form."""

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from flowlik.geometry.camera import Pinhole
from flowlik.simulation._base import Frame
from flowlik.support.arrays import Array

WALL_Z_M, WALL_TOP_M = 20.0, -4.0
HALF_SIZE_M = 1.2


@dataclass(frozen=True)
class MovingWorld:
    """A wall with sky above it; before it a square that flies to the right, and one that comes, rolling."""

    seed: int = 0
    name: ClassVar[str] = "moving"

    def parameters(self) -> dict[str, Any]:
        return {"seed": self.seed}

    def mover_poses(self, time_s: float) -> RigidTransform:
        places = np.array([[-1.5 + 3 * time_s, 0.3, 8.0], [1.0, -0.5, 12.0 - 4 * time_s]])
        return RigidTransform.from_components(places, Rotation.from_rotvec([[0, 0, 0], [0, 0, 0.8 * time_s]]))

    def clearance(self, positions: Array) -> Array:
        return WALL_Z_M - np.atleast_2d(positions)[:, 2]

    def render(self, T_n_c: RigidTransform, camera: Pinhole, time_s: float = 0.0) -> Frame:
        shape, rays = (camera.height, camera.width), camera.rays(camera.pixel_grid())
        wall = RigidTransform.from_translation([[0, 0, WALL_Z_M]])
        poses = [wall[0], *self.mover_poses(time_s)]
        depth, movers = np.full(len(rays), np.inf), np.full(len(rays), -1, np.int16)
        light = np.full(len(rays), 0.8)
        for body, T_n_o in enumerate(poses):
            T_o_c = T_n_o.inv() * T_n_c
            directions, origin = T_o_c.rotation.apply(rays), T_o_c.translation
            along = -origin[2] / directions[:, 2]
            x, y = (origin + along[:, None] * directions)[:, :2].T
            on_it = y > WALL_TOP_M if body == 0 else np.maximum(np.abs(x), np.abs(y)) < HALF_SIZE_M
            hit = on_it & (along > 0) & (along < depth)
            depth[hit], movers[hit] = along[hit], body - 1
            waves = np.sin(6 * x + body) * np.sin(7 * y) + np.sin(3 * x - 4 * y)
            light[hit] = (0.35 + 0.12 * waves)[hit]
        return Frame(light.reshape(shape).astype(np.float32), depth.reshape(shape), movers.reshape(shape))
