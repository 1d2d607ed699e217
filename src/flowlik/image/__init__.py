"""Texture and samples of images."""

from flowlik.image.texture import TextureDefinition, eigenbasis, structure_tensor

__all__ = ["TextureDefinition", "eigenbasis", "structure_tensor"]
