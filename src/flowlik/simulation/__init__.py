"""The virtual environment: worlds, trajectories, a sensor, and sequences rendered from them."""

from flowlik.simulation.grid import GridWorld
from flowlik.simulation.planes import PlanesWorld
from flowlik.simulation.scenario import WORLDS, simulate
from flowlik.simulation.sensor import IDEAL_SENSOR, Sensor
from flowlik.simulation.sequence import PAPER_CAMERA, SimulatedSequence
from flowlik.simulation.trajectories import TRAJECTORIES, lap_frames
from flowlik.simulation.write import write_sequence

__all__ = [
    "IDEAL_SENSOR",
    "PAPER_CAMERA",
    "TRAJECTORIES",
    "WORLDS",
    "GridWorld",
    "PlanesWorld",
    "Sensor",
    "SimulatedSequence",
    "lap_frames",
    "simulate",
    "write_sequence",
]
