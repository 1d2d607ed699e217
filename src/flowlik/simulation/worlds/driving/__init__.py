"""A road with everything beside it, along any route."""

from flowlik.simulation.worlds.driving._world import KITTI_CAMERA, DrivingWorld

__all__ = [
    "KITTI_CAMERA",
    "DrivingWorld",
]
