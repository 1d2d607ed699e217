"""Sequences by the names of a world and of a trajectory, or along the poses of a file."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from scipy.spatial.transform import RigidTransform

from flowlik.errors import DataError
from flowlik.geometry.camera import Pinhole
from flowlik.geometry.trajectory import FRAME_RATE, read_trajectory
from flowlik.simulation._base import World
from flowlik.simulation.flight._sensor import DEFAULT_SENSOR, Sensor
from flowlik.simulation.flight._sequence import PAPER_CAMERA, SimulatedSequence
from flowlik.simulation.flight._trajectories import TRAJECTORIES, Flight

# Imports stand inside the builders: each world compiles and loads much that the others do not need.


def _planes(seed: int, poses: RigidTransform) -> World:
    from flowlik.simulation.worlds.planes import PlanesWorld

    return PlanesWorld(seed)


def _grid(seed: int, poses: RigidTransform) -> World:
    from flowlik.simulation.worlds.planes import GridWorld

    return GridWorld(seed)


def _forest(seed: int, poses: RigidTransform) -> World:
    from flowlik.simulation.worlds.forest import ForestWorld

    return ForestWorld(seed)


def _small_forest(seed: int, poses: RigidTransform) -> World:
    from flowlik.simulation.worlds.forest import ForestWorld

    return ForestWorld.small(seed)


def _driving(seed: int, poses: RigidTransform, **parameters: Any) -> World:
    from flowlik.simulation.worlds.driving import DrivingWorld

    return DrivingWorld.along(poses, seed, **parameters)


WORLDS: dict[str, Callable[..., World]] = {
    "planes": _planes,
    "grid": _grid,
    "forest": _forest,
    "forest-small": _small_forest,
    "driving": _driving,
}
"""Worlds by name; each is made from a seed and the poses from which it will be seen."""

DEFAULT_FRAMES = 300

_T = TypeVar("_T")


def simulate(
    world: str = "planes",
    trajectory: str | Path = "straight",
    frames: int | None = None,
    speed_mps: float = 6.0,
    seed: int = 0,
    camera: Pinhole | None = None,
    sensor: Sensor = DEFAULT_SENSOR,
    frames_per_second: float | None = None,
    start: int = 0,
    baseline_m: float | None = None,
    traffic: int = 0,
) -> SimulatedSequence:
    """Simulate a sequence by names; one seed draws world, trajectory and sensor noise.

    Parameters
    ----------
    world : str
        Name in `WORLDS`.
    trajectory : str or Path
        Name in `TRAJECTORIES`, or a pose file in KITTI's or TUM's format.
    frames : int, optional
        Number of frames; by default 300, or all of a pose file. A file that holds fewer gives what it has.
    speed_mps : float
        Speed [m/s] of a named trajectory.
    seed : int
        Seed of everything random.
    camera : Pinhole, optional
        By default KITTI's in `driving`, else the paper's.
    sensor : Sensor
        From light to 8 bits.
    frames_per_second : float, optional
        Frame rate [1/s]; by default 10 in `driving`, else 60; of a pose file its own times, KITTI's being
        10 frames/s.
    start : int
        Frames left out at the beginning; time and the world are those of the whole flight.
    baseline_m : float, optional
        Distance [m] of a second camera to the right.
    traffic : int
        Number of moving vehicles in `driving`.

    Raises
    ------
    DataError
        If a name is unknown, a pose file is malformed, or the flight leaves the world or comes too near to
        a surface.
    """
    if seed < 0 or start < 0:
        raise DataError(f"seed {seed} and start {start} must not be negative")
    if frames is not None and frames < 1:
        raise DataError(f"impossible flight of {frames} frames: at least one is needed")
    build = _named(WORLDS, world, "world")
    if frames_per_second is not None and not 0 < frames_per_second < np.inf:
        raise DataError(f"impossible frame rate of {frames_per_second} frames/s: it must be positive")
    if str(trajectory) in TRAJECTORIES:
        rate = frames_per_second or (FRAME_RATE if world == "driving" else 60.0)
        flight = _named_flight(str(trajectory), start + (frames or DEFAULT_FRAMES), speed_mps, rate, seed)
    else:
        flight = _flight_of_file(trajectory, frames_per_second)
    if start >= len(flight.poses):
        raise DataError(f"{trajectory}: start {start} is beyond its {len(flight.poses)} poses")
    options: dict[str, Any] = {}
    if world == "driving":
        options = {"traffic": traffic, "frames_per_second": flight.frames_per_second}
    elif traffic:
        raise DataError(f"world {world!r} has no traffic, only 'driving' has")
    return SimulatedSequence(
        build(seed, flight.poses, **options),
        flight.part(start, frames),
        camera or _default_camera(world),
        sensor,
        seed,
        baseline_m,
    )


def _default_camera(world: str) -> Pinhole:
    """Camera of a world by name: KITTI's in `driving`, else the paper's."""
    if world != "driving":
        return PAPER_CAMERA
    from flowlik.simulation.worlds.driving import KITTI_CAMERA

    return KITTI_CAMERA


def camera_of(world: str, width: int | None, height: int | None, fov_deg: float | None) -> Pinhole:
    """Camera of a world by name, changed in size [px] or horizontal field of view [deg] where they are given.

    A changed camera has square pixels and a centred principal point.
    """
    camera = _default_camera(world)
    if width is None and height is None and fov_deg is None:
        return camera
    own_deg = np.rad2deg(2 * np.arctan(camera.width / 2 / camera.fx))
    return Pinhole.from_fov(
        camera.width if width is None else width,
        camera.height if height is None else height,
        float(own_deg) if fov_deg is None else fov_deg,
    )


def _named_flight(name: str, frames: int, speed_mps: float, rate: float, seed: int) -> Flight:
    return Flight.of(TRAJECTORIES[name](frames, speed_mps, rate, seed), rate, name, speed_mps)


def _flight_of_file(path: str | Path, frames_per_second: float | None) -> Flight:
    path = Path(path)
    if not path.is_file():
        known = ", ".join(sorted(TRAJECTORIES))
        raise DataError(f"unknown trajectory '{path}': known are {known}, or a pose file that exists")
    flown = read_trajectory(path)
    if frames_per_second is not None:
        return Flight.of(flown.poses, frames_per_second, path.stem)
    steps_s = np.diff(flown.timestamps)
    rate = round(1 / float(np.median(steps_s)), 6) if len(steps_s) else FRAME_RATE
    return Flight(flown.poses, flown.timestamps, rate, path.stem)


def _named(known: dict[str, _T], name: str, kind: str) -> _T:
    if name not in known:
        raise DataError(f"unknown {kind} {name!r}: known are {', '.join(sorted(known))}")
    return known[name]
