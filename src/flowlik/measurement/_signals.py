"""Signals: what a second look at the images says about a flow vector, at the price of more computation."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flowlik.errors import ModelError
from flowlik.flow.base import FlowAt, Image
from flowlik.flow.tracking import Pyramid, Tracker
from flowlik.image.texture import Gradients
from flowlik.measurement import _kernels
from flowlik.support.arrays import Array
from flowlik.support.threads import in_bands

RESIDUAL_WINDOW = 5
BACK = Tracker(window=9, iterations=30, epsilon_px=0.01)
SPREAD_RADIUS_PX = 4.0
ERROR_BLOCKS = 5
VECTORS = 20_000
PATCHES = 1_000


@dataclass(frozen=True)
class Pair:
    """An image pair, its flow there and back as functions of pixels (N, 2), and the vectors in question.

    ``gradients`` are those of the previous image; ``own_at`` are the method's own standard deviations (N, 2)
    [px], if it tells any.
    """

    previous: Image
    current: Image
    gradients: Gradients
    flow_at: FlowAt
    back_at: FlowAt
    pixels: Array
    flow: Array
    own_at: FlowAt | None = None


def _discrepancy(pair: Pair) -> Array:
    """Forward-backward discrepancy (N, 2) [px]: flow there and back again; NaN where there is no way back."""
    return pair.flow + pair.back_at(pair.pixels + pair.flow)


def _patch_discrepancy(pair: Pair) -> Array:
    """Distance (N, 2) [px] of a vector's start and where its end's patch is found again; NaN where lost.

    Lucas and Kanade's search in the previous image, at full size alone and from the vector's start on. It
    asks for no flow back, and so costs a fraction of a dense method's.
    """
    previous, current = (Pyramid.of(image, BACK.window, 0) for image in (pair.previous, pair.current))
    return pair.flow + BACK.track(current, previous, pair.pixels + pair.flow, -pair.flow)


def _residual(pair: Pair) -> Array:
    """Mean absolute grey difference (N,) of the 5x5 patches at a vector's ends, apart from their means."""
    r = np.empty(len(pair.pixels))
    in_bands(
        lambda first, last: _kernels.patch_residual(
            pair.previous, pair.current, pair.pixels, pair.flow, RESIDUAL_WINDOW, first, last, r
        ),
        len(r),
        VECTORS,
    )
    return r


def _spread(pair: Pair) -> Array:
    """Root mean square difference (N,) [px] of the flow to that of eight neighbours 4 px away."""
    height, width = pair.previous.shape
    total, count = np.zeros(len(pair.pixels)), np.zeros(len(pair.pixels))
    for du in (-SPREAD_RADIUS_PX, 0.0, SPREAD_RADIUS_PX):
        for dv in (-SPREAD_RADIUS_PX, 0.0, SPREAD_RADIUS_PX):
            if du or dv:
                near = np.clip(pair.pixels + np.array([du, dv]), 0, [width - 1, height - 1])
                square = ((pair.flow_at(near) - pair.flow) ** 2).sum(axis=1)
                total += np.where(np.isfinite(square), square, 0.0)
                count += np.isfinite(square)
    return np.sqrt(np.divide(total, count, out=np.full(len(total), np.nan), where=count > 0))


def _standard_error(pair: Pair) -> Array:
    """Sandwich covariance (N, 3) = (xx, xy, yy) [px^2] of least squares over 15x15 px at a vector's start.

    Lucas and Kanade's normal equations are S d = s, with the scores s = sum g r of gradients and residuals.
    Scores of 3x3 px blocks are taken for independent: S^-1 (sum_b s_b s_b^T + S / 12) S^-1, where 1/12 is the
    variance of rounding to whole grey levels (White, Econometrica 48, 1980; Liang and Zeger, Biometrika 73,
    1986). Where a patch holds two motions, its blocks disagree, however strong its texture is.
    """
    gx, gy = pair.gradients
    covariance = np.empty((len(pair.pixels), 3))
    in_bands(
        lambda first, last: _kernels.standard_errors(
            pair.previous, pair.current, gx, gy, pair.pixels, pair.flow, ERROR_BLOCKS, first, last, covariance
        ),
        len(covariance),
        PATCHES,
    )
    return covariance


def _own_uncertainty(pair: Pair) -> Array:
    """Standard deviations (N, 2) [px] along u and v that the flow method itself tells."""
    if pair.own_at is None:
        raise ModelError("the flow tells no uncertainty of its own, which the signal own-uncertainty is")
    return pair.own_at(pair.pixels)


SIGNALS: dict[str, Callable[[Pair], NDArray[np.float64]]] = {
    "discrepancy": _discrepancy,
    "own-uncertainty": _own_uncertainty,
    "patch-discrepancy": _patch_discrepancy,
    "residual": _residual,
    "spread": _spread,
    "standard-error": _standard_error,
}
"""Signals by name, each of N flow vectors: (N,), or in {i} (N, 2), or a symmetric matrix as (N, 3); NaN where
it cannot be measured."""


def signal(name: str) -> Callable[[Pair], Array]:
    """Signal of a name.

    Raises
    ------
    ModelError
        If there is none of that name.
    """
    if name not in SIGNALS:
        raise ModelError(f"unknown signal {name!r}: known are {', '.join(SIGNALS)}")
    return SIGNALS[name]
