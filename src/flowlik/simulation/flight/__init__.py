"""Flights through a world: trajectories, the sensor, sequences, and what is written of them."""

from flowlik.simulation.flight._scenario import WORLDS, camera_of, simulate
from flowlik.simulation.flight._sensor import IDEAL_SENSOR, Sensor
from flowlik.simulation.flight._sequence import PAPER_CAMERA, SimulatedSequence
from flowlik.simulation.flight._trajectories import TRAJECTORIES, Flight, lap_frames
from flowlik.simulation.flight._write import write_sequence

__all__ = [
    "IDEAL_SENSOR",
    "PAPER_CAMERA",
    "TRAJECTORIES",
    "WORLDS",
    "Flight",
    "Sensor",
    "SimulatedSequence",
    "camera_of",
    "lap_frames",
    "simulate",
    "write_sequence",
]
