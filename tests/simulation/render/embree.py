"""Depth by Intel's ray tracer Embree, from the embreex wheel: an independent oracle for the rasteriser."""

import numpy as np
from scipy.spatial.transform import RigidTransform

from flowlik.geometry.camera import Pinhole


def cast(triangles: np.ndarray, T_n_c: RigidTransform, camera: Pinhole) -> np.ndarray:
    """Depth (H, W) [m] along z at the pixel centres of triangles (F, 3, 3) in {n} [m]; inf where none is hit.

    Embree says in float32 which triangle is hit first; where the ray meets its plane is solved in float64.
    """
    from embreex.mesh_construction import TriangleMesh
    from embreex.rtcore_scene import EmbreeScene

    local = T_n_c.inv().apply(triangles.reshape(-1, 3)).reshape(-1, 3, 3)
    scene = EmbreeScene(robust=True)
    TriangleMesh(scene, local.astype(np.float32))
    rays = camera.rays(camera.pixel_grid())
    found = scene.run(np.zeros(rays.shape, np.float32), rays.astype(np.float32), output=True)["primID"]
    depth, hit = np.full(len(rays), np.inf), found >= 0
    a, b, c = np.moveaxis(local[found[hit]], 1, 0)
    normal = np.cross(b - a, c - a)
    depth[hit] = (normal * a).sum(axis=1) / (normal * rays[hit]).sum(axis=1)
    return depth.reshape(camera.height, camera.width)


def agreement(depth: np.ndarray, expected: np.ndarray, relative: float = 1e-4) -> float:
    """Share of pixels whose depths agree, or where both see nothing."""
    with np.errstate(invalid="ignore"):
        close = np.abs(depth - expected) <= relative * expected
    return float(np.where(np.isinf(expected), np.isinf(depth), close).mean())
