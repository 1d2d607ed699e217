"""A simulated flight as a data set: pictures rendered on demand, with exact truth."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform

from flowlik.camera import Pinhole
from flowlik.datasets.base import frame_index, motion_to_next, true_flow, visible_next
from flowlik.errors import DataError
from flowlik.simulation.base import Frame, World
from flowlik.simulation.planes import PlanesWorld
from flowlik.simulation.sensor import DEFAULT_SENSOR, Sensor
from flowlik.simulation.trajectories import TRAJECTORIES

WORLDS: dict[str, Callable[[int], World]] = {"planes": PlanesWorld}
"""Worlds by name; each is made from a seed."""

PAPER_CAMERA = Pinhole.from_fov(640, 360, 120.0)
"""The camera of the paper's simulation."""

MARGIN_M = 0.3

_T = TypeVar("_T")


class SimulatedSequence:
    """Frames seen by a camera that moves through a world; implements `flowlik.datasets.base.Sequence`.

    Parameters
    ----------
    world : World
        What is seen.
    poses : RigidTransform (N,)
        T_n_c of each frame: camera (x right, y down, z forward) to world [m].
    camera : Pinhole
        The camera.
    sensor : Sensor
        From light to 8 bits.
    seed : int
        Seed of the sensor's noise; frame k has its own stream, the same however it is reached.
    frames_per_second : float
        Frame rate [1/s].
    trajectory, speed_mps : str, float or None
        Where the poses come from, for provenance only.

    Raises
    ------
    DataError
        If there are no poses, the frame rate is not positive, or a pose lies outside the world or nearer
        than 0.3 m to a surface.
    """

    def __init__(
        self,
        world: World,
        poses: RigidTransform,
        camera: Pinhole = PAPER_CAMERA,
        sensor: Sensor = DEFAULT_SENSOR,
        seed: int = 0,
        frames_per_second: float = 60.0,
        trajectory: str = "given poses",
        speed_mps: float | None = None,
    ) -> None:
        if poses.single or len(poses) == 0:
            raise DataError(f"{world.name}: a sequence needs an array of at least one pose")
        if not frames_per_second > 0:
            raise DataError(f"{world.name}: frame rate {frames_per_second} must be positive")
        _check_clearance(world, poses, trajectory)
        self.name = f"{world.name}-{trajectory.replace(' ', '-')}-{seed}"
        self.world, self.poses, self.sensor, self.seed = world, poses, sensor, seed
        self.frames_per_second, self.trajectory, self.speed_mps = frames_per_second, trajectory, speed_mps
        self._camera = camera

    @property
    def camera(self) -> Pinhole:
        """The camera of every frame."""
        return self._camera

    @property
    def provenance(self) -> dict[str, Any]:
        """How these frames were made, as plain JSON values."""
        return {
            "world": self.world.name,
            "world_parameters": self.world.parameters(),
            "trajectory": self.trajectory,
            "speed_mps": self.speed_mps,
            "frames": len(self),
            "seed": self.seed,
            "sensor": {**vars(self.sensor)},
        }

    def __len__(self) -> int:
        """Return the number of frames."""
        return len(self.poses)

    def frame(self, k: int) -> Frame:
        """Radiance and depth of frame k before the sensor; read-only, the last few are kept."""
        pose = self.T_n_c(k)
        return _rendered(self.world, self.camera, pose.as_matrix().tobytes())

    def image(self, k: int) -> NDArray[np.uint8]:
        """Return the grey image (H, W) of frame k."""
        radiance = self.frame(k).radiance
        return self.sensor.expose(radiance, np.random.default_rng([self.seed, frame_index(self, k)]))

    def timestamp(self, k: int) -> float:
        """Return the time [s] of frame k."""
        return frame_index(self, k) / self.frames_per_second

    def T_n_c(self, k: int) -> RigidTransform:
        """Return the true pose of frame k: takes points in {c} to points in {n} [m]."""
        return self.poses[frame_index(self, k)]

    def depth(self, k: int) -> NDArray[np.float64]:
        """Return the true depth (H, W) [m] along z at pixel centres."""
        return self.frame(k).depth.copy()

    def flow(self, k: int) -> NDArray[np.float64]:
        """Return the true flow (H, W, 2) [px] from frame k to k + 1; occluded pixels keep theirs."""
        return true_flow(self.camera, self.frame(k).depth, motion_to_next(self, k))

    def visible(self, k: int) -> NDArray[np.bool_]:
        """Return which pixels (H, W) of frame k are seen in frame k + 1 too."""
        motion = motion_to_next(self, k)
        return visible_next(self.camera, self.frame(k).depth, self.frame(k + 1).depth, motion)


def simulate(
    world: str = "planes",
    trajectory: str = "straight",
    frames: int = 300,
    speed_mps: float = 6.0,
    seed: int = 0,
    camera: Pinhole = PAPER_CAMERA,
    sensor: Sensor = DEFAULT_SENSOR,
    frames_per_second: float = 60.0,
) -> SimulatedSequence:
    """Simulate a sequence by names; one seed draws world, trajectory and sensor noise.

    Parameters
    ----------
    world, trajectory : str
        Names in `WORLDS` and `TRAJECTORIES`.
    frames : int
        Number of frames.
    speed_mps : float
        Speed [m/s].
    seed : int
        Seed of everything random.
    camera, sensor, frames_per_second
        As in `SimulatedSequence`; the paper's camera is the default.

    Raises
    ------
    DataError
        If a name is unknown, or the flight leaves the world or comes too near to a surface.
    """
    if seed < 0:
        raise DataError(f"seed {seed} must not be negative")
    build = _named(WORLDS, world, "world")
    fly = _named(TRAJECTORIES, trajectory, "trajectory")
    poses = fly(frames, speed_mps, frames_per_second, seed)
    return SimulatedSequence(
        build(seed), poses, camera, sensor, seed, frames_per_second, trajectory, speed_mps
    )


@lru_cache(maxsize=6)
def _rendered(world: World, camera: Pinhole, T_n_c: bytes) -> Frame:
    # one cache at module level: sequences stay picklable, and frames k and k + 1 are each rendered once
    frame = world.render(RigidTransform.from_matrix(np.frombuffer(T_n_c).reshape(4, 4)), camera)
    frame.radiance.flags.writeable = frame.depth.flags.writeable = False
    return frame


def _named(known: dict[str, _T], name: str, kind: str) -> _T:
    if name not in known:
        raise DataError(f"unknown {kind} {name!r}: known are {', '.join(sorted(known))}")
    return known[name]


def _check_clearance(world: World, poses: RigidTransform, trajectory: str) -> None:
    positions_m = np.asarray(poses.translation)
    clearance_m = world.clearance(positions_m)
    too_near = ~(clearance_m >= MARGIN_M)
    if not too_near.any():
        return
    k = int(np.argmax(too_near))
    place = np.array2string(positions_m[k], precision=2)
    how = "outside the world" if clearance_m[k] < 0 else f"{clearance_m[k]:.2f} m from a surface"
    raise DataError(
        f"{world.name}, {trajectory}: frame {k} at {place} m is {how}, at least {MARGIN_M} m are needed; "
        "fly fewer frames or another path"
    )
