"""`flowlik simulate`: a data set on disk from the virtual environment."""

from __future__ import annotations

from pathlib import Path

from flowlik.camera import Pinhole
from flowlik.progress import Progress, no_progress
from flowlik.simulation import IDEAL_SENSOR, Sensor, write_sequence
from flowlik.simulation import simulate as simulate_sequence


def simulate(
    world: str,
    trajectory: str,
    frames: int,
    out: Path,
    speed_mps: float = 6.0,
    seed: int = 0,
    width: int = 640,
    height: int = 360,
    fov_deg: float = 120.0,
    noise: bool = True,
    progress: Progress = no_progress,
) -> Path:
    """Render a flight and write it in TartanAir V2's layout.

    Parameters
    ----------
    world, trajectory : str
        Names of a world and of a trajectory.
    frames : int
        Number of images.
    out : Path
        Folder; an interrupted run of the same sequence is continued.
    speed_mps : float
        Speed [m/s], at 60 frames/s.
    seed : int
        Seed of world, trajectory and sensor noise.
    width, height, fov_deg
        Camera: size [px] and horizontal field of view [deg].
    noise : bool
        Whether the sensor blurs and adds noise.
    progress : Progress
        Told how far it is.
    """
    camera = Pinhole.from_fov(width, height, fov_deg)
    sensor = Sensor() if noise else IDEAL_SENSOR
    sequence = simulate_sequence(world, trajectory, frames, speed_mps, seed, camera, sensor)
    return write_sequence(sequence, out, lambda steps: progress(steps, f"frames of {world}", frames))
