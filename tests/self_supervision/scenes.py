"""Image pairs whose flow errors follow a known law: Laplacian, in proportion to the photometric residual."""

from dataclasses import replace

import numpy as np

from flowlik.flow import LucasKanade, describe
from flowlik.self_supervision import SeenPair
from tests.helpers import CAMERA, make_scene, random_motion

SIZE_PX = 0.01
"""Mean magnitude of an error's component at a residual of 1."""


def seen_pair(rng: np.random.Generator, n: int, T=None, depth: bool = False, **scene) -> SeenPair:
    """Pair of n vectors; signals are drawn at random, and only the residual tells of errors."""
    T = random_motion(rng, 1.0, 0.6) if T is None else T
    drawn = make_scene(T, rng, n, **scene)
    m = drawn.measurements
    residual = np.exp(rng.uniform(0, 2.5, n))
    xx, yy = np.exp(rng.uniform(-9, -5, (2, n)))
    signals = {
        "discrepancy": 0.05 * rng.laplace(size=(n, 2)),
        "residual": residual,
        "standard-error": np.stack([xx, 0 * xx, yy], axis=-1),
    }
    flow = m.flow + SIZE_PX * residual[:, None] * rng.laplace(size=(n, 2))
    m = replace(m, flow=flow, signals=signals, method=describe(LucasKanade()))
    return SeenPair(m, CAMERA, drawn.depth if depth else None)
