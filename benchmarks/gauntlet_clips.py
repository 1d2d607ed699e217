"""Clips of the gauntlet: frames with exact truth, from the simulator or of textured rectangles."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform, Rotation

from flowlik.geometry.camera import Pinhole
from flowlik.geometry.motion import relative_motion
from flowlik.simulation import TRAJECTORIES, Flight, PlanesWorld, SimulatedSequence
from flowlik.simulation.worlds.driving import DrivingWorld
from flowlik.simulation.worlds.forest import ForestWorld
from flowlik.support.arrays import Array
from flowlik.support.files import atomic_write
from gauntlet_scene import Scene

CAMERA = Pinhole.from_fov(400, 224, 65.0)
WIDE = Pinhole.from_fov(400, 224, 90.0)
FRAMES_PER_SECOND = 30.0
WORLD = 500
"""Seed of the first world; the models were calibrated in worlds of lower ones."""

NOISE = 1.5
"""Standard deviation of the noise of scenes of rectangles [grey levels]."""

DRIVE_FRAMES = 120

Grey = NDArray[np.uint8]


@dataclass(frozen=True, eq=False)
class Clip:
    """Frames of one situation; as much of `flowlik.datasets.base.ImageSequence` as is measured.

    Attributes
    ----------
    name : str
        Names the clip, and its measurements where they are kept.
    camera : Pinhole
        What the estimators are told.
    poses : RigidTransform (N,)
        True T_n_c.
    image, depth : callable
        Frame k: grey (H, W); depth along z [m] (H, W) as told.
    judged : array (N,) of bool
        Whether the motion from frame k - 1 to k is judged.
    pictures : str
        Name of the images: clips of the same name share measurements.
    """

    name: str
    camera: Pinhole
    poses: RigidTransform
    image: Callable[[int], Grey]
    depth: Callable[[int], Array]
    judged: NDArray[np.bool_]
    pictures: str = ""

    def __len__(self) -> int:
        return len(self.judged)

    def T_n_c(self, k: int) -> RigidTransform:
        return self.poses[k]

    def timestamp(self, k: int) -> float:
        return k / FRAMES_PER_SECOND

    def truth(self, k: int) -> RigidTransform:
        """True motion T_k_prev into frame k."""
        return relative_motion(self.poses[k - 1], self.poses[k])


def staged(
    name: str,
    seed: int,
    scene: Scene | Callable[[int], Scene],
    poses: RigidTransform,
    rows: Callable[[int], RigidTransform] | None = None,
) -> Clip:
    """Clip of rectangles; `rows` gives the poses (H,) of frame k's rows where they are not all alike."""

    @lru_cache(maxsize=256)
    def seen(k: int) -> tuple[Array, Array]:
        now = scene(k) if callable(scene) else scene
        return now.view(CAMERA, poses[k] if rows is None else rows(k))

    def image(k: int) -> Grey:
        noise = np.random.default_rng([seed, k]).normal(0, NOISE, (CAMERA.height, CAMERA.width))
        return grey(seen(k)[0] + noise)

    return Clip(name, CAMERA, poses, image, lambda k: seen(k)[1], all_but_first(len(poses)), f"{name}-{seed}")


def flown(
    name: str, seed: int, poses: RigidTransform, make: Callable[[], SimulatedSequence], cache: Path
) -> Clip:
    """Clip of a simulated flight along poses, each frame rendered once into the cache.

    The flight is one frame longer, so that a frame does not depend on where the clip ends.
    """
    folder, sequence = cache / "flights" / f"{name}-{seed}", lru_cache(maxsize=1)(make)

    @lru_cache(maxsize=4)
    def frame(k: int) -> tuple[Grey, Array]:
        path = folder / f"{k:04d}.npz"
        if not path.is_file():
            with atomic_write(path, "wb") as file:
                np.savez(file, image=sequence().image(k), depth=sequence().depth(k).astype(np.float32))
        with np.load(path) as data:
            return data["image"], data["depth"].astype(np.float64)

    return Clip(
        name, WIDE, poses[:-1], lambda k: frame(k)[0], lambda k: frame(k)[1], all_but_first(len(poses) - 1),
        f"{name}-{seed}",
    )  # fmt: skip


def hall(seed: int, frames: int, cache: Path, other: bool = False) -> Clip:
    """A flight in six freedoms through the hall of planes; `other`: the same flight in another hall."""
    poses = TRAJECTORIES["training"](frames + 1, 4.0, FRAMES_PER_SECOND, seed)
    world = PlanesWorld(WORLD + seed + (5000 if other else 0))

    def make() -> SimulatedSequence:
        return SimulatedSequence(world, Flight.of(poses, FRAMES_PER_SECOND), WIDE, seed=seed)

    return flown("other-hall" if other else "hall", seed, poses, make, cache)


def forest(seed: int, frames: int, cache: Path, trajectory: str = "curve") -> Clip:
    """A flight through the forest at 6 m/s and 60 frames/s, from a place of its own."""
    first = 37 * (seed % 20)
    poses = TRAJECTORIES[trajectory](first + frames + 1, 6.0, 60.0, seed)[first:]

    def make() -> SimulatedSequence:
        return SimulatedSequence(ForestWorld(WORLD + seed), Flight.of(poses, 60.0), WIDE, seed=seed)

    return flown(f"forest-{trajectory}", seed, poses, make, cache)


def drive(seed: int, frames: int, cache: Path) -> Clip:
    """A drive along a winding street with traffic, at 7 m/s and 10 frames/s.

    Raises
    ------
    ValueError
        If the street is too short for so many frames.
    """
    if frames >= DRIVE_FRAMES:
        raise ValueError(f"{frames} frames: a drive has fewer than {DRIVE_FRAMES}")
    rng = np.random.default_rng([seed, 1])
    along_m = 0.7 * np.arange(DRIVE_FRAMES)
    yaw = rng.uniform(0.1, 0.3) * np.sin(along_m / rng.uniform(10, 25))
    headings = np.column_stack([np.sin(yaw), np.zeros(DRIVE_FRAMES), np.cos(yaw)])
    route = RigidTransform.from_components(
        np.cumsum(0.7 * headings, axis=0), Rotation.from_euler("Y", yaw[:, None])
    )
    poses = route[: frames + 1]

    def make() -> SimulatedSequence:
        world = DrivingWorld.along(route, WORLD + seed, traffic=4)
        return SimulatedSequence(world, Flight.of(poses, 10.0), WIDE, seed=seed)

    return flown("drive", seed, poses, make, cache)


def grey(levels: Array) -> Grey:
    """Grey levels (H, W), rounded to 8 bits."""
    return np.clip(np.rint(levels), 0, 255).astype(np.uint8)


def all_but_first(frames: int) -> NDArray[np.bool_]:
    return np.arange(frames) > 0


def at_events(frames: int, events: NDArray[np.bool_], after: int = 1) -> NDArray[np.bool_]:
    """Motions judged: those into frames of an event and into so many frames after it."""
    near = np.convolve(events, np.ones(after + 1), "full")[:frames] > 0
    return np.asarray(near & all_but_first(frames))


def with_images(clip: Clip, name: str, image: Callable[[int], Grey]) -> Clip:
    """Return the clip with other pictures."""
    return replace(clip, name=name, image=image, pictures=f"{name}-{clip.pictures}")
