"""Vehicles that move: where each is at any time, in its lane, with its wheels on the ground."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import gaussian_filter1d
from scipy.spatial.transform import RigidTransform

from flowlik.errors import DataError
from flowlik.simulation.worlds.driving._ground import Ground
from flowlik.simulation.worlds.driving._kinds import Kinds
from flowlik.simulation.worlds.driving._places import standing
from flowlik.support.arrays import Array

AHEAD_M = 12.0
"""Nearest that a vehicle in the camera's lane comes to the camera."""

_SIDE_M = 2.7
_BETWEEN_M = 2.7
_LENGTH_M = 11.0
_TRIES = 300
_CHECK_S = 0.05


@dataclass(frozen=True, eq=False)
class _Vehicle:
    """One moving vehicle.

    Attributes
    ----------
    prototype : int
        Its drawing.
    lateral_m : float
        Its lane, to the right of the camera's.
    sense : float
        1 in the camera's direction, -1 against it.
    times_s, arc_m : arrays (K,)
        Length along the drive's line [m] at times [s]; straight in between, constant speed outside.
    """

    prototype: int
    lateral_m: float
    sense: float
    times_s: Array
    arc_m: Array

    def arc(self, time_s: Array) -> Array:
        """Length along the drive's line (N,) [m] at times (N,) [s]."""
        return np.interp(time_s, self.times_s, self.arc_m)


@dataclass(frozen=True, eq=False)
class Traffic:
    """All moving vehicles on the roads of a ground.

    Attributes
    ----------
    ground : Ground
        What they drive on.
    vehicles : tuple of Vehicle
        Those that move.
    """

    ground: Ground
    vehicles: tuple[_Vehicle, ...]

    @property
    def prototypes(self) -> list[int]:
        """Drawing of each vehicle."""
        return [vehicle.prototype for vehicle in self.vehicles]

    def transforms(self, time_s: float) -> Array:
        """Where the vehicles are (M, 3, 4), prototype to {n} [m]."""
        if not self.vehicles:
            return np.empty((0, 3, 4))
        plans = [_plan(self.ground, vehicle, np.array([time_s])) for vehicle in self.vehicles]
        points, along = (np.concatenate(parts) for parts in zip(*plans))
        return standing(points, self.ground.slope(points, along), self.ground.level(points), 0.0, False)

    def poses(self, time_s: float) -> RigidTransform:
        """Poses T_n_o (M,) of the vehicles: z forward, foot on the road."""
        transforms = self.transforms(time_s)
        matrices = np.tile(np.eye(4), (len(transforms), 1, 1))
        matrices[:, :3] = transforms
        return RigidTransform.from_matrix(matrices)


def make_traffic(
    ground: Ground, kinds: Kinds, count: int, seed: int, frames_per_second: float, positions_m: Array
) -> Traffic:
    """Set vehicles moving, every third in the camera's direction, so that they never meet the camera.

    Those in the camera's lane drive ahead of it, at least `AHEAD_M` away; the others pass it in their lanes,
    spread over the whole time.

    Raises
    ------
    DataError
        If there is no room for so many.
    """
    drive = ground.roads.drive
    frame_s = np.arange(len(drive.arc_m)) / frames_per_second
    times_s = np.arange(0.0, max(frame_s[-1], 1.0) + _CHECK_S, _CHECK_S)
    camera_m = np.interp(times_s, frame_s, drive.arc_m)
    camera = np.column_stack([np.interp(times_s, frame_s, positions_m[:, i]) for i in (0, 2)])
    rng = np.random.default_rng([seed, 61])
    usual_mps = max(6.0, float(np.median(np.diff(camera_m)) / _CHECK_S))
    vehicles: list[_Vehicle] = []
    tracks: list[tuple[Array, Array]] = []
    for i in range(count):
        for attempt in range(_TRIES):
            if i % 3 == 1:
                vehicle = _ahead(ground, kinds, times_s, camera_m, rng, attempt)
            else:
                share = (i + 0.5) / count + min(0.005 * attempt, 0.5) * rng.uniform(-1, 1)
                vehicle = _oncoming(ground, kinds, times_s, camera_m, rng, share, usual_mps)
            track = _plan(ground, vehicle, times_s)
            least_m = AHEAD_M if vehicle.lateral_m == 0.0 else _SIDE_M
            if np.linalg.norm(track[0] - camera, axis=1).min() < least_m:
                continue
            if all(_apart(track, other) for other in tracks):
                vehicles.append(vehicle)
                tracks.append(track)
                break
        else:
            raise DataError(f"no room for {count} moving vehicles on this road: ask for at most {i}")
    return Traffic(ground, tuple(vehicles))


def _ahead(
    ground: Ground, kinds: Kinds, times_s: Array, camera_m: Array, rng: np.random.Generator, attempt: int
) -> _Vehicle:
    """Vehicle in the camera's direction: its motion is the camera's, smoother and swaying, farther on."""
    smooth = gaussian_filter1d(camera_m, 2.0 / _CHECK_S, mode="nearest")
    sway = 3.0 * np.sin(2 * np.pi * times_s / rng.uniform(15, 40) + rng.uniform(0, 2 * np.pi))
    shortest = AHEAD_M + 9.0 + float((camera_m - smooth).max())
    # vehicles do not drive backwards
    arc = np.maximum.accumulate(smooth + sway + shortest + rng.uniform(0, 10) + 9.0 * attempt)
    kind = "car" if rng.random() < 0.75 else "van"
    return _Vehicle(kinds.pick(rng, kind), ground.roads.profile.lanes_m[1], 1.0, times_s, arc)


def _oncoming(
    ground: Ground,
    kinds: Kinds,
    times_s: Array,
    camera_m: Array,
    rng: np.random.Generator,
    share: float,
    usual_mps: float,
) -> _Vehicle:
    """Vehicle against the camera's direction, of constant speed; they meet at about a share of the time."""
    meeting_s = share * times_s[-1] + 1.0
    speed_mps = rng.uniform(0.96, 1.04) * usual_mps
    arc = np.interp(meeting_s, times_s, camera_m) - speed_mps * (times_s - meeting_s)
    kind = ("car", "van", "lorry")[rng.choice(3, p=(0.75, 0.15, 0.1))]
    return _Vehicle(kinds.pick(rng, kind), ground.roads.profile.lanes_m[0], -1.0, times_s, arc)


def _plan(ground: Ground, vehicle: _Vehicle, times_s: Array) -> tuple[Array, Array]:
    """Plan positions and unit directions (N, 2) of a vehicle; straight on where the road ends."""
    line, arc = ground.roads.drive.line, vehicle.arc(times_s)
    points, along = line.at(arc)
    beyond = arc - np.clip(arc, 0.0, line.arc_m[-1])
    right = along[:, ::-1] * [1.0, -1.0]
    return points + vehicle.lateral_m * right + beyond[:, None] * along, vehicle.sense * along


def _apart(track: tuple[Array, Array], other: tuple[Array, Array]) -> bool:
    """Whether two vehicles never meet: a length apart, or side by side in different lanes."""
    offset = track[0] - other[0]
    near = np.linalg.norm(offset, axis=1) < _LENGTH_M
    along = track[1][near]
    aside = np.abs(offset[near, 0] * along[:, 1] - offset[near, 1] * along[:, 0])
    return bool((aside > _BETWEEN_M).all())
