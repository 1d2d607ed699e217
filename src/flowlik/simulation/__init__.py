"""The virtual environment: worlds, trajectories, a sensor, and sequences rendered from them."""

from flowlik.simulation.flight import (
    IDEAL_SENSOR,
    PAPER_CAMERA,
    TRAJECTORIES,
    WORLDS,
    Flight,
    Sensor,
    SimulatedSequence,
    camera_of,
    lap_frames,
    simulate,
    write_sequence,
)
from flowlik.simulation.worlds.planes import GridWorld, PlanesWorld

__all__ = [
    "IDEAL_SENSOR",
    "PAPER_CAMERA",
    "TRAJECTORIES",
    "WORLDS",
    "Flight",
    "GridWorld",
    "PlanesWorld",
    "Sensor",
    "SimulatedSequence",
    "camera_of",
    "lap_frames",
    "simulate",
    "write_sequence",
]
