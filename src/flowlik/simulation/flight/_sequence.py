"""A simulated flight as a data set: pictures rendered on demand, with exact truth."""

from __future__ import annotations

import hashlib
import json
from dataclasses import asdict
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform

from flowlik.datasets.base import frame_index, lacks
from flowlik.datasets.next_frame import (
    Movers,
    is_visible,
    motion_to_next,
    mover_motions,
    true_flow,
    visibility_next,
)
from flowlik.errors import DataError
from flowlik.geometry.camera import Pinhole
from flowlik.simulation._base import Frame, World
from flowlik.simulation.flight._sensor import DEFAULT_SENSOR, Light, Sensor, motion_blurred
from flowlik.simulation.flight._shutter import motions_between, pose_near
from flowlik.simulation.flight._trajectories import Flight

PAPER_CAMERA = Pinhole.from_fov(640, 360, 120.0)
"""The camera of the paper's simulation."""

MARGIN_M = 0.3
LEFT, RIGHT = 0, 1


class SimulatedSequence:
    """Frames seen by a camera that moves through a world; implements `flowlik.datasets.ImageSequence`.

    Parameters
    ----------
    world : World
        What is seen.
    flight : Flight
        Poses of the camera, with their times.
    camera : Pinhole
        The camera.
    sensor : Sensor
        From light to 8 bits.
    seed : int
        Seed of the sensor's noise; frame k has its own stream, the same however it is reached.
    baseline_m : float, optional
        Distance [m] of a second camera, to the right of the first.

    Raises
    ------
    DataError
        If a camera is outside the world or nearer than 0.3 m to a surface, or the baseline is not positive.
    """

    def __init__(
        self,
        world: World,
        flight: Flight,
        camera: Pinhole = PAPER_CAMERA,
        sensor: Sensor = DEFAULT_SENSOR,
        seed: int = 0,
        baseline_m: float | None = None,
    ) -> None:
        if baseline_m is not None and not 0 < baseline_m < np.inf:
            raise DataError(f"{world.name}: baseline {baseline_m} m must be positive")
        self.name = f"{world.name}-{flight.name.replace(' ', '-')}-{seed}"
        self.world, self.sensor, self.seed, self.baseline_m = world, sensor, seed, baseline_m
        self.poses, self.times_s = flight.poses, flight.times_s
        self.frames_per_second, self.trajectory = flight.frames_per_second, flight.name
        self.speed_mps, self._camera = flight.speed_mps, camera
        started_s = flight.clock_start_s
        self.clock_start_s = float(self.times_s[0]) if started_s is None else started_s
        _check_clearance(world, self.poses, self.name)
        if baseline_m is not None:
            _check_clearance(world, self.right_poses, self.name)

    @property
    def camera(self) -> Pinhole:
        """The camera of every frame."""
        return self._camera

    @property
    def right_poses(self) -> RigidTransform:
        """Poses (N,) of the second camera."""
        return self.poses * self._T_c_eye(RIGHT)

    @property
    def provenance(self) -> dict[str, Any]:
        """How these frames were made, as plain JSON values."""
        poses = hashlib.sha256(self.poses.as_matrix().tobytes() + self.times_s.tobytes())
        return {
            "world": self.world.name,
            "world_parameters": self.world.parameters(),
            "trajectory": self.trajectory,
            "speed_mps": self.speed_mps,
            "frames": len(self),
            "clock_start_s": self.clock_start_s,
            "seed": self.seed,
            "baseline_m": self.baseline_m,
            "sensor": asdict(self.sensor),
            "configuration_sha256": self.configuration_hash,
            "poses_sha256": poses.hexdigest(),
        }

    @property
    def configuration_hash(self) -> str:
        """SHA-256 of the canonical JSON of world, sensor and camera: equal settings have equal hashes."""
        configuration = {
            "world": {"name": self.world.name, **self.world.parameters()},
            "sensor": asdict(self.sensor),
            "camera": asdict(self.camera),
        }
        text = json.dumps(configuration, sort_keys=True, separators=(",", ":"), allow_nan=False)
        return hashlib.sha256(text.encode()).hexdigest()

    def __len__(self) -> int:
        """Return the number of frames."""
        return len(self.poses)

    def frame(self, k: int, eye: int = LEFT) -> Frame:
        """Light and depth of frame k before the sensor; read-only, the last few are kept."""
        pose = self.T_n_c(k) * self._T_c_eye(eye)
        # a world in which nothing moves looks the same at any time
        time_s = 0.0 if self.mover_poses(k) is None else self._world_time_s(k)
        return _rendered(self.world, self.camera, pose.as_matrix().tobytes(), time_s)

    def image(self, k: int) -> NDArray[np.uint8]:
        """Return the grey image (H, W) of frame k."""
        return self._image(k, LEFT)

    def right_image(self, k: int) -> NDArray[np.uint8]:
        """Return the grey image (H, W) that the second camera takes at the same time."""
        return self._image(k, RIGHT)

    def timestamp(self, k: int) -> float:
        """Return the time [s] of frame k."""
        return float(self.times_s[frame_index(self, k)])

    def T_n_c(self, k: int) -> RigidTransform:
        """Return the true pose of frame k: takes points in {c} to points in {n} [m]."""
        return self.poses[frame_index(self, k)]

    def depth(self, k: int) -> NDArray[np.float64]:
        """Return the true depth (H, W) [m] along z at pixel centres; inf at the sky."""
        return self.frame(k).depth.copy()

    def right_depth(self, k: int) -> NDArray[np.float64]:
        """Return the true depth (H, W) [m] along z in the second camera."""
        return self.frame(k, RIGHT).depth.copy()

    def mover_poses(self, k: int) -> RigidTransform | None:
        """Return the poses T_n_o (M,) of all moving objects in frame k; None if nothing ever moves."""
        return self.world.mover_poses(self._world_time_s(k))

    def flow(self, k: int) -> NDArray[np.float64]:
        """Return the true flow (H, W, 2) [px] from frame k to k + 1; occluded pixels keep theirs."""
        return true_flow(self.camera, self.frame(k).depth, motion_to_next(self, k), self._movers(k))

    def visibility(self, k: int) -> NDArray[np.uint8]:
        """Return what becomes of each pixel (H, W) in frame k + 1, a `Visibility`."""
        depth, later = self.frame(k).depth, self.frame(k + 1).depth
        return visibility_next(self.camera, depth, later, motion_to_next(self, k), self._movers(k))

    def visible(self, k: int) -> NDArray[np.bool_]:
        """Return which pixels (H, W) of frame k are seen in frame k + 1 too."""
        return is_visible(self.visibility(k))

    def _movers(self, k: int) -> Movers | None:
        """Objects that move from frame k to k + 1."""
        labels, here, there = self.frame(k).movers, self.mover_poses(k), self.mover_poses(k + 1)
        if labels is None or here is None or there is None:
            return None
        return Movers(labels, mover_motions(self.T_n_c(k), self.T_n_c(k + 1), here, there))

    def _world_time_s(self, k: int) -> float:
        return self.timestamp(k) - self.clock_start_s

    def _T_c_eye(self, eye: int) -> RigidTransform:
        if eye == RIGHT and self.baseline_m is None:
            raise lacks(self.name, "right image (no baseline_m was given)")
        return RigidTransform.from_translation([eye * (self.baseline_m or 0.0), 0.0, 0.0])

    def _image(self, k: int, eye: int) -> NDArray[np.uint8]:
        light = self.light(k, eye)
        return self.sensor.expose(light, self.camera, self.seed, k, self.timestamp(k), eye)

    def light(self, k: int, eye: int = LEFT) -> Light:
        """Return the light (H, W) that `Sensor.expose` takes, without the sensor's noise.

        It is gathered while the shutter is open, in the middle of which the frame's time lies.
        """
        frame, open_s, count = self.frame(k, eye), self.sensor.exposure_s, self.sensor.subframes
        if open_s == 0 or (len(self) == 1 and frame.movers is None):
            return frame.radiance
        if count:
            offsets_s = ((np.arange(count) + 0.5) / count - 0.5) * open_s
            lights = [self._rendered_near(k, eye, float(offset_s)).radiance for offset_s in offsets_s]
            return np.mean(lights, axis=0, dtype=np.float32)
        times_s = self._world_time_s(k) - open_s / 2, self._world_time_s(k) + open_s / 2
        cameras = [self._pose_near(k, eye, offset_s) for offset_s in (-open_s / 2, open_s / 2)]
        movers = [self.world.mover_poses(time_s) for time_s in times_s]
        return motion_blurred(frame, self.camera, motions_between(*cameras, *movers))

    def _pose_near(self, k: int, eye: int, offset_s: float) -> RigidTransform:
        return pose_near(self.poses, self.times_s, k, offset_s) * self._T_c_eye(eye)

    def _rendered_near(self, k: int, eye: int, offset_s: float) -> Frame:
        pose = self._pose_near(k, eye, offset_s)
        return self.world.render(pose, self.camera, self._world_time_s(k) + offset_s)


@lru_cache(maxsize=6)
def _rendered(world: World, camera: Pinhole, T_n_c: bytes, time_s: float) -> Frame:
    # one cache at module level: sequences stay picklable, and frames k and k + 1 are each rendered once
    pose = RigidTransform.from_matrix(np.frombuffer(T_n_c).reshape(4, 4))
    frame = world.render(pose, camera, time_s)
    for values in (frame.radiance, frame.depth, frame.movers):
        if values is not None:
            values.flags.writeable = False
    return frame


def _check_clearance(world: World, poses: RigidTransform, name: str) -> None:
    positions_m = np.asarray(poses.translation)
    clearance_m = world.clearance(positions_m)
    too_near = ~(clearance_m >= MARGIN_M)
    if not too_near.any():
        return
    k = int(np.argmax(too_near))
    place = np.array2string(positions_m[k], precision=2)
    how = "outside the world" if clearance_m[k] < 0 else f"{clearance_m[k]:.2f} m from a surface"
    raise DataError(
        f"{name}: frame {k} at {place} m is {how}, at least {MARGIN_M} m are needed; "
        "fly fewer frames or another path"
    )
