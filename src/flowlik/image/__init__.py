"""Texture and samples of images."""
