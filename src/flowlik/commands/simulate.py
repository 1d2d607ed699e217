"""`flowlik simulate`: a data set on disk from the virtual environment."""

from __future__ import annotations

from pathlib import Path

from flowlik.geometry.camera import Pinhole
from flowlik.simulation import IDEAL_SENSOR, Sensor, write_sequence
from flowlik.simulation import simulate as simulate_sequence
from flowlik.support.progress import Progress, no_progress


def simulate(
    world: str,
    trajectory: str,
    out: Path,
    frames: int | None = None,
    speed_mps: float = 6.0,
    seed: int = 0,
    camera: Pinhole | None = None,
    frames_per_second: float | None = None,
    start: int = 0,
    baseline_m: float | None = None,
    traffic: int = 0,
    sensor: bool = True,
    progress: Progress = no_progress,
) -> Path:
    """Render a flight and write it in TartanAir V2's layout.

    Parameters
    ----------
    world, trajectory, frames, speed_mps, seed, camera, frames_per_second, start, baseline_m, traffic
        As in `flowlik.simulation.simulate`.
    out : Path
        Folder; an interrupted run of the same sequence is continued.
    sensor : bool
        Whether the sensor blurs, adds noise and changes its exposure.
    progress : Progress
        Told how far it is.
    """
    sequence = simulate_sequence(
        world,
        trajectory,
        frames,
        speed_mps,
        seed,
        camera,
        Sensor() if sensor else IDEAL_SENSOR,
        frames_per_second,
        start,
        baseline_m,
        traffic,
    )
    return write_sequence(sequence, out, lambda steps: progress(steps, f"frames of {world}", len(sequence)))
