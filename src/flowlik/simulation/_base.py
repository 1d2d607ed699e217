"""What the simulation asks of a world: pictures with exact depth, and how near geometry is."""

from __future__ import annotations

from dataclasses import dataclass, fields
from functools import lru_cache
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform

from flowlik.geometry.camera import Pinhole
from flowlik.support.arrays import Array


@dataclass(frozen=True)
class Frame:
    """One rendered picture before the sensor.

    Attributes
    ----------
    radiance : array (H, W) float32
        Light averaged over each pixel, linear; 1 just saturates the default sensor.
    depth : array (H, W) float64
        Depth along z at the pixel centres [m]; inf where the ray meets nothing.
    movers : array (H, W) int16 or None
        Which moving object is seen at the pixel centre, -1 for the static world; None if nothing moves.
    """

    radiance: NDArray[np.float32]
    depth: Array
    movers: NDArray[np.int16] | None = None


class World(Protocol):
    """A scene, static but for its movers.

    World axes {n} are x right, y down, z forward. Worlds are hashable, and equal worlds render equal bytes:
    frames are cached by world. Every world keeps the neighbourhood of the centre lines in
    `flowlik.simulation.worlds.paths` free of geometry, so that every trajectory can be flown in it;
    `driving` is built along the poses it is given instead.
    """

    @property
    def name(self) -> str:
        """Short name used in results and file provenance."""
        ...

    def render(self, T_n_c: RigidTransform, camera: Pinhole, time_s: float = 0.0) -> Frame:
        """Picture and exact depth seen from one pose at one time."""
        ...

    def mover_poses(self, time_s: float) -> RigidTransform | None:
        """Poses T_n_o (M,) of all moving objects at one time; None if nothing moves."""
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


class SentAsParameters:
    """Part of a world, a frozen dataclass, that goes to another process as its parameters alone.

    What it has built stays here, and is built there when it is first needed, once for equal worlds.
    """

    def __reduce__(self) -> tuple[Any, ...]:
        """Return the call that makes an equal world."""
        return _received, (type(self), tuple(getattr(self, f.name) for f in fields(self)))  # type: ignore[arg-type]


@lru_cache(maxsize=2)
def _received(kind: type, parameters: tuple[Any, ...]) -> Any:
    return kind(*parameters)
