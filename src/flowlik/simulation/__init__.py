"""The virtual environment: worlds, trajectories, a sensor, and sequences rendered from them."""

from flowlik.simulation.planes import PlanesWorld
from flowlik.simulation.sensor import IDEAL_SENSOR, Sensor
from flowlik.simulation.sequence import PAPER_CAMERA, WORLDS, SimulatedSequence, simulate
from flowlik.simulation.trajectories import TRAJECTORIES
from flowlik.simulation.write import write_sequence

__all__ = [
    "IDEAL_SENSOR",
    "PAPER_CAMERA",
    "TRAJECTORIES",
    "WORLDS",
    "PlanesWorld",
    "Sensor",
    "SimulatedSequence",
    "simulate",
    "write_sequence",
]
