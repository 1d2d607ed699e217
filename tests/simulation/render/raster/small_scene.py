"""A small scene of each kind of thing that the rasteriser draws."""

import numpy as np
from numpy.typing import NDArray

from flowlik.geometry.camera import Pinhole
from flowlik.simulation.render import (
    Daylight,
    Foliage,
    Instances,
    Layer,
    LeafShape,
    Material,
    Mesh,
    Prototype,
    Scene,
    Surface,
    box,
    lattice,
    placed,
    tube,
)
from flowlik.support.arrays import Array

CAMERA = Pinhole.from_fov(96, 64, 100.0)

MATERIALS = [
    Material(
        (Surface(0.3, (Layer("litter", 2.0, 0.8),), 0.03), Surface(0.2, (Layer("grass", 1.0, 0.5),))),
        fray=Layer("macro", 7.0, 0.5),
    ),
    Material((Surface(0.2, (Layer("bark", 0.8, 0.8),), 0.02),)),
    Material((Surface(0.25, (Layer("leaf", 0.2, 0.5),)),), translucency=0.4, variation=0.4),
]

LEAF = LeafShape(
    np.array(
        [[-1, 0, 0], [0, 1, 0.1], [0.4, 0.7, 0.1], [1, 0, -0.1], [0.4, -0.7, 0.1], [0, -1, 0.1]], np.float32
    ),
    np.array([[0, 1, 5], [1, 2, 5], [2, 4, 5], [2, 3, 4]], np.int32),
)


def tree(leaves: int = 300) -> Prototype:
    rng = np.random.default_rng(0)
    directions = rng.standard_normal((3, leaves, 3))
    along = directions[0] / np.linalg.norm(directions[0], axis=1, keepdims=True)
    across = np.cross(along, directions[1])
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    spread = directions[2]
    normals = spread / np.linalg.norm(spread, axis=1, keepdims=True)
    foliage = Foliage(
        (0.8 * spread + [0, -4, 0]).astype(np.float32),
        (0.15 * along).astype(np.float32),
        (0.08 * across).astype(np.float32),
        normals.astype(np.float32),
        np.full(leaves, 0.8, np.float32),
        LEAF,
        2,
    )
    return Prototype(tube([[0, 0.5, 0], [0.1, -2, 0], [0, -5, 0]], [0.3, 0.2, 0.05], 9, 1), foliage)


def height_field(
    x: Array, z: Array, y: Array, material: int | NDArray[np.integer], paint: float | Array = 0.0
) -> Mesh:
    """Terrain over columns x (X,) and rows z (Z,) with heights y (Z, X) [m, down]; uv is (x, z)."""
    columns, rows = np.meshgrid(x, z)
    slope_z, slope_x = np.gradient(y, z, x)
    normals = np.stack([slope_x, -np.ones_like(y), slope_z], axis=-1)
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    return Mesh.of(
        np.stack([columns, y, rows], axis=-1).reshape(-1, 3),
        normals.reshape(-1, 3),
        np.column_stack([columns.ravel(), rows.ravel()]),
        lattice(len(z), len(x)),
        material,
        np.broadcast_to(paint, y.shape).ravel(),
    )


def make_scene(seed: int = 0, movers: tuple[int, ...] = ()) -> Scene:
    """Hilly ground, trees near and far, boxes."""
    rng = np.random.default_rng(seed)
    x = np.linspace(-40, 40, 41)
    hills = 1.8 + 0.4 * np.sin(x / 7)[:, None] * np.cos(x / 5)
    ground = height_field(x, x + 30, hills, 0, paint=(hills > 2).astype(float))
    things = [Prototype(ground), tree(), Prototype(box([-1, -2, -1], [1, 0.5, 1], 1))]
    places = [(0, placed(np.zeros(3)))]
    for k in range(40):
        side, far = rng.uniform(2.5, 25) * rng.choice([-1, 1]), rng.uniform(-5, 60)
        places.append(
            (1 + k % 2, placed(np.array([side, 1.8, far]), rng.uniform(0, 6), rng.uniform(0.6, 1.2)))
        )
    return Scene.of(
        things, Instances.of(places), MATERIALS, Daylight(), seed, movers, shadow_area=(0, 30, 45)
    )
