"""Ellipses of two independent error components that hold a given share of their errors."""

from __future__ import annotations

import numpy as np

from flowlik.likelihood.families.base import ErrorFamily
from flowlik.support.arrays import Array

QUANTILES = 400
WIDEST = 32.0
BISECTIONS = 18
LN_OVER_BOUND = np.linspace(np.log(1e-6), np.log(1e3), 1200)


def ellipse_factors(family: ErrorFamily, theta: Array, bounds: Array, level: float) -> Array:
    """Half-axes over bounds (K, K) of the ellipses that hold a share of errors (z1, z2).

    The half-axes f b1 and f b2 hold ``P((z1 / b1)^2 + (z2 / b2)^2 <= f^2)``; f is where that is the level.
    It is above 1, since at 1 each component alone holds no more than the level.

    Parameters
    ----------
    family : ErrorFamily
        Family of both components.
    theta : array (P, K)
        Parameters at K coordinates.
    bounds : array (K,)
        Bounds b [px] of one component's magnitude there, of the same level.
    level : float
        Share, between 0 and 1.
    """
    over_bound = np.exp(LN_OVER_BOUND)
    cdf = family.magnitude_cdf(over_bound * bounds[:, None], theta[..., None])
    u = (np.arange(QUANTILES) + 0.5) / QUANTILES
    square = np.stack([np.exp(np.interp(u, row, LN_OVER_BOUND)) ** 2 for row in cdf])
    factors = np.empty((len(bounds), len(bounds)))
    for k, row in enumerate(cdf):
        low, high = np.ones(k + 1), np.full(k + 1, WIDEST)
        for _ in range(BISECTIONS):
            f = np.sqrt(low * high)
            left = np.maximum(f[:, None] ** 2 - square[: k + 1], 0.0)
            held = np.interp(np.sqrt(left), over_bound, row, left=0.0).mean(axis=1)
            low, high = np.where(held < level, f, low), np.where(held < level, high, f)
        factors[k, : k + 1] = factors[: k + 1, k] = np.sqrt(low * high)
    return factors
