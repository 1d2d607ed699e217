"""A closed hall with rectangles in it, textured or patterned."""

from flowlik.simulation.worlds.planes._grid import GridWorld
from flowlik.simulation.worlds.planes._world import PlanesWorld

__all__ = [
    "GridWorld",
    "PlanesWorld",
]
