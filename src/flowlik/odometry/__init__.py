"""Ego-motion over a sequence: loop, scale, boresight, motion model, self-calibration, outputs."""
