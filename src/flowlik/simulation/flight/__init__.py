"""Flights through a world: trajectories, the sensor, sequences, and what is written of them."""
