"""Cameras, rigid motions and trajectories."""
