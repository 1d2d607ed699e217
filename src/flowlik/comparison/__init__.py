"""Rivals on the same input: baselines, drives, and their records."""
