"""What the simulation asks of a world: pictures with exact depth, and how near geometry is."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform

from flowlik.camera import Pinhole

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Frame:
    """One rendered picture before the sensor.

    Attributes
    ----------
    radiance : array (H, W) float32
        Light averaged over each pixel [grey levels, 0 to 255].
    depth : array (H, W) float64
        Depth along z at the pixel centres [m]; inf where the ray meets nothing.
    """

    radiance: NDArray[np.float32]
    depth: Array


class World(Protocol):
    """A static scene. Worlds are hashable, and equal worlds render equal bytes: frames are cached by world.

    World axes {n} are x right, y down, z forward. Every world keeps the neighbourhood of the centre
    lines in `flowlik.simulation.paths` free of geometry, so that every trajectory can be flown in it.
    """

    @property
    def name(self) -> str:
        """Short name used in results and file provenance."""
        ...

    def render(self, T_n_c: RigidTransform, camera: Pinhole) -> Frame:
        """Picture and exact depth seen from one pose."""
        ...

    def clearance(self, positions: Array) -> Array:
        """Distance (N,) [m] of positions (N, 3) in {n} to the nearest surface; negative outside the world."""
        ...

    def __hash__(self) -> int:
        """Hash of the world's parameters."""
        ...

    def parameters(self) -> dict[str, Any]:
        """Everything needed to build this world again, as plain JSON values."""
        ...
