"""Trees, undergrowth, rocks and houses beside a track."""

from flowlik.simulation.worlds.forest._world import ForestWorld

__all__ = [
    "ForestWorld",
]
