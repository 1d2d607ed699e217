"""`flowlik simulate`: a data set on disk from the virtual environment."""

from __future__ import annotations

from pathlib import Path

from flowlik.commands.options import SimulateOptions
from flowlik.simulation import (
    IDEAL_SENSOR,
    InertialSensors,
    Sensor,
    check_inertial,
    gps_model,
    imu_model,
    spoofing,
    write_inertial,
    write_sequence,
)
from flowlik.simulation import simulate as simulate_sequence
from flowlik.support.progress import Progress, no_progress


def simulate(
    world: str,
    out: Path,
    options: SimulateOptions = SimulateOptions(),
    *,
    progress: Progress = no_progress,
) -> Path:
    """Render a flight and write it in TartanAir V2's layout, with IMU and GPS beside it if asked for.

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
    sensors = InertialSensors(
        None if options.imu is None else imu_model(options.imu),
        None if options.gps is None else gps_model(options.gps),
        tuple(spoofing(text) for text in options.spoof),
    )
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
    # before the long work, so that what cannot be is told at once
    inertial = check_inertial(sequence.poses, sequence.times_s, sensors, options.seed, out)
    write_sequence(sequence, out, lambda steps: progress(steps, f"frames of {world}", len(sequence)))
    write_inertial(inertial, out)
    return out
