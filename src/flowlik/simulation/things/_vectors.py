"""Upwards, and directions."""

from __future__ import annotations

import numpy as np

from flowlik.support.arrays import Array

UP = np.array([0.0, -1.0, 0.0])
"""Upwards (3,) in {n}, whose y points down."""


def unit(vectors: Array) -> Array:
    """Vectors (..., 3) of length 1."""
    return vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-12)
