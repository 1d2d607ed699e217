"""The standard flights rendered once into a cache, and read from it as sequences with truth."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import fields
from pathlib import Path
from typing import NamedTuple

import numpy as np

from flowlik.calibration import Block
from flowlik.commands._shared_options import Data, StandardFlights
from flowlik.commands.options import CalibrateOptions
from flowlik.commands.standard_plan import CALIBRATION, DRIVING, REPORT, VALIDATION, StandardFlight
from flowlik.commands.standard_runs import FRAMES_PER_SECOND, Runs
from flowlik.datasets.base import ImageSequence
from flowlik.errors import DataError
from flowlik.simulation import IDEAL_SENSOR, Sensor, SimulatedSequence, simulate
from flowlik.support.files import atomic_write
from flowlik.support.progress import Progress, no_progress
from flowlik.support.threads import THREADS

DENSE_PIXELS = 20_000
"""Stratified pixels a pair on which dense methods are calibrated."""

# another camera's noise and sharpness: images scaled down from larger ones, and a phone's in the dark
SENSORS = {
    "default": Sensor(),
    "clean": IDEAL_SENSOR,
    "poor": Sensor(full_well_e=2_500.0, read_noise_e=12.0, psf_sigma_px=0.9),
}
FRAME_MB = {DRIVING: 6.1, "": 3.0}
"""Of a frame in the cache: image, depth and flow."""
FRAME_CPU_S = 2.0
"""Processor seconds to render a frame, about."""


class Flown(NamedTuple):
    """A sequence with the blocks of its image pairs."""

    sequence: ImageSequence
    blocks: list[Block]


def cached(flight: StandardFlight, cache: Path, places: Sequence[int]) -> Path:
    """File of some places of a flight in a cache; that of all places has the flight's name alone."""
    some = "" if len(places) == flight.places else f"-{len(places)}-of-{flight.places}"
    return cache / f"{flight.name}{some}.npz"


def rendered(flight: StandardFlight, cache: Path, kitti_poses: Path | None, share: float = 1.0) -> Runs:
    """Runs of a share of a flight, or of all of it, rendered unless the cache has them.

    Raises
    ------
    DataError
        If it follows a route of KITTI, and its file of poses is not there.
    """
    places = flight.shared(share)
    path, whole = cached(flight, cache, places), cached(flight, cache, range(flight.places))
    if whole.is_file():
        return Runs(whole)
    if not path.is_file():
        _render(flight, path, kitti_poses, places)
    return Runs(path, flight.name)


def _render(flight: StandardFlight, path: Path, kitti_poses: Path | None, places: Sequence[int]) -> None:
    sequence = _simulated(flight, kitti_poses)
    firsts = np.linspace(3, len(sequence) - flight.run - 1, flight.places).astype(int)[list(places)]
    images, depth, flow, pose = [], [], [], []
    for first in firsts.tolist():
        for k in range(first, first + flight.run):
            images.append(sequence.image(k))
            depth.append(sequence.depth(k).astype(np.float32))
            last = k == first + flight.run - 1
            flow.append(np.full((*depth[-1].shape, 2), np.nan) if last else sequence.flow(k))
            pose.append(sequence.T_n_c(k).as_matrix())
    c = sequence.camera
    with atomic_write(path, "wb") as file:
        np.savez(
            file, images=np.array(images), depth=np.array(depth), flow=np.array(flow, dtype=np.float32),
            pose=np.array(pose), run=flight.run, cam=[c.width, c.height, c.fx, c.fy, c.cx, c.cy],
        )  # fmt: skip


def _simulated(flight: StandardFlight, kitti_poses: Path | None) -> SimulatedSequence:
    sensor = SENSORS[flight.sensor]
    if flight.world == DRIVING:
        if kitti_poses is None:
            raise DataError(f"{flight.name}: its route is KITTI's, whose poses must be given (--kitti-poses)")
        poses = kitti_poses / f"{flight.trajectory}.txt"
        return simulate(DRIVING, poses, seed=flight.seed, traffic=6, sensor=sensor)
    length_m = 100.0 if flight.trajectory in ("straight", "curve") else 200.0
    frames = int(length_m * FRAMES_PER_SECOND / flight.speed_mps)
    return simulate(flight.world, flight.trajectory, frames, flight.speed_mps, flight.seed, sensor=sensor)


def default_cache() -> Path:
    """Folder of the standard flights in the user's cache folder."""
    base = os.environ.get("XDG_CACHE_HOME") or os.environ.get("LOCALAPPDATA")
    return (Path(base) if base else Path.home() / ".cache") / "flowlik" / "standard-flights"


def standard_flights(
    cache: Path | None,
    share: float,
    kitti_poses: Path | None,
    warn: Callable[[str], object],
    progress: Progress = no_progress,
) -> dict[str, list[Flown]]:
    """Standard flights by population: ``calibration``, ``validation`` and ``held out``.

    What is not in the cache is rendered; an interrupted run goes on where it was. Flights along KITTI's
    routes are left out where its poses are not given, and said to be.

    Parameters
    ----------
    cache : Path, optional
        Folder; by default `default_cache`.
    share : float
        Share of each flight's places, at least one of each.
    kitti_poses : Path, optional
        Folder of KITTI odometry's poses.
    warn : callable
        Told what is left out.
    progress : Progress
        Told the size, the time it takes about, and how far it is.

    Raises
    ------
    DataError
        If the share is not above 0 and up to 1, or a file of poses is not there.
    """
    cache = cache or default_cache()
    if kitti_poses is None:
        warn("no --kitti-poses: the standard flights along roads are left out")
    flights = _plan(share, kitti_poses)
    missing = _missing(flights, cache, share)

    def render() -> Iterator[None]:
        for flight in missing:
            places = flight.shared(share)
            _render(flight, cached(flight, cache, places), kitti_poses, places)
            yield None

    if missing:
        cache.mkdir(parents=True, exist_ok=True)
        for _ in progress(render(), "standard flights rendered", len(missing)):
            pass
    found: dict[str, list[Flown]] = {}
    for name, some in flights.items():
        runs = [rendered(flight, cache, kitti_poses, share) for flight in some]
        found[name] = [Flown(r, _blocks(r, flight, share)) for r, flight in zip(runs, some)]
    return found


def _blocks(runs: Runs, flight: StandardFlight, share: float) -> list[Block]:
    """Blocks of a share of a flight, of its whole file or of that of the share."""
    places, whole = flight.shared(share), len(runs) == flight.run * flight.places
    return runs.blocks(flight.seed, places if whole else None)


def _plan(share: float, kitti_poses: Path | None) -> dict[str, list[StandardFlight]]:
    """Flights of each population; those along roads only with their poses."""
    if not 0 < share <= 1:
        raise DataError(f"a share of the standard flights is above 0 and up to 1, not {share}")
    plan = {"calibration": CALIBRATION, "validation": VALIDATION, "held out": tuple(REPORT.values())}
    if kitti_poses is None:
        return {name: [f for f in some if f.world != DRIVING] for name, some in plan.items()}
    for flight in (flight for some in plan.values() for flight in some if flight.world == DRIVING):
        if not (kitti_poses / f"{flight.trajectory}.txt").is_file():
            raise DataError(f"{kitti_poses}: no {flight.trajectory}.txt with the poses of a KITTI route")
    return {name: list(some) for name, some in plan.items()}


def _missing(
    flights: Mapping[str, Sequence[StandardFlight]], cache: Path, share: float
) -> list[StandardFlight]:
    every = (flight for some in flights.values() for flight in some)
    paths = {f: (cached(f, cache, f.shared(share)), cached(f, cache, range(f.places))) for f in every}
    return [flight for flight, files in paths.items() if not any(file.is_file() for file in files)]


def check_options(data: Sequence[Path], options: CalibrateOptions) -> None:
    """Refuse options of data beside the standard flights, and the other way round.

    Raises
    ------
    DataError
        If the options do not fit together.
    """
    if bool(data) == options.standard:
        raise DataError("calibrate on folders of data, or on the standard flights (--standard), one of them")
    kind = Data if options.standard else StandardFlights
    what = "folders of data" if options.standard else "the standard flights (--standard)"
    for field in fields(kind):
        if getattr(options, field.name) != field.default:
            raise DataError(f"--{field.name.replace('_', '-')} is an option of {what} only")


def rendering_cost(data: Sequence[Path], options: CalibrateOptions) -> str:
    """Size and time of the standard flights that a calibration has to render, in words; empty without any.

    Raises
    ------
    DataError
        If the options do not fit together, the share is not above 0 and up to 1, or a file of poses is not
        there.
    """
    check_options(data, options)
    cache, share = options.cache or default_cache(), options.share
    missing = _missing(_plan(share, options.kitti_poses), cache, share) if options.standard else []
    frames = {flight: flight.run * len(flight.shared(share)) for flight in missing}
    mb = sum(count * FRAME_MB.get(flight.world, FRAME_MB[""]) for flight, count in frames.items())
    minutes = sum(frames.values()) * FRAME_CPU_S / THREADS / 60
    if not missing:
        return ""
    return (
        f"{len(missing)} standard flights are rendered into {cache}: {sum(frames.values())} frames, "
        f"{mb / 1000:.1f} GB, about {minutes:.0f} minutes; an interrupted run goes on where it was"
    )
