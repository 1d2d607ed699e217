"""Tileable grey textures by name, drawn from a seed."""
