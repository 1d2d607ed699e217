"""The virtual environment: worlds, trajectories, a sensor, and sequences rendered from them."""

from flowlik.simulation.flight.scenario import WORLDS, simulate
from flowlik.simulation.flight.sensor import IDEAL_SENSOR, Sensor
from flowlik.simulation.flight.sequence import PAPER_CAMERA, SimulatedSequence
from flowlik.simulation.flight.trajectories import TRAJECTORIES, Flight, lap_frames
from flowlik.simulation.flight.write import write_sequence
from flowlik.simulation.worlds.planes.grid import GridWorld
from flowlik.simulation.worlds.planes.world import PlanesWorld

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
    "lap_frames",
    "simulate",
    "write_sequence",
]
