"""TartanAir V1 and V2: one camera of one trajectory, and the conversions of its file formats."""

from flowlik.datasets.tartanair._files import encode_depth, encode_flow, encode_poses
from flowlik.datasets.tartanair._reader import TartanAir

__all__ = ["TartanAir", "encode_depth", "encode_flow", "encode_poses"]
