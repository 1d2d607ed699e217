"""`flowlik simulate`: a data set on disk from the virtual environment."""

from __future__ import annotations

from pathlib import Path

from flowlik.commands.options import SimulateOptions
from flowlik.simulation import IDEAL_SENSOR, Sensor, write_sequence
from flowlik.simulation import simulate as simulate_sequence
from flowlik.support.progress import Progress, no_progress


def simulate(
    world: str,
    out: Path,
    options: SimulateOptions = SimulateOptions(),
    *,
    progress: Progress = no_progress,
) -> Path:
    """Render a flight and write it in TartanAir V2's layout.

    Parameters
    ----------
    world : str
        As in `flowlik.simulation.simulate`.
    out : Path
        Folder; an interrupted run of the same sequence is continued.
    options : SimulateOptions
        How.
    progress : Progress
        Told how far it is.

    Returns
    -------
    Path
        The folder.

    Raises
    ------
    DataError
        If the options contradict one another, or the folder holds something else.
    """
    sequence = simulate_sequence(
        world,
        options.trajectory,
        options.frames,
        options.speed_mps,
        options.seed,
        options.camera,
        Sensor() if options.sensor else IDEAL_SENSOR,
        options.frames_per_second,
        options.start,
        options.baseline_m,
        options.traffic,
    )
    return write_sequence(sequence, out, lambda steps: progress(steps, f"frames of {world}", len(sequence)))
