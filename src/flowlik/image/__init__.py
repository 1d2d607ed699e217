"""Texture and samples of images."""

from flowlik.image.sampling import sample_flow
from flowlik.image.texture import TextureDefinition, eigenbasis, structure_tensor

__all__ = ["TextureDefinition", "eigenbasis", "sample_flow", "structure_tensor"]
