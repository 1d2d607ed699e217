"""A known motion must come back: the self-test that tells which convention of a network was said wrongly."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from flowlik.flow.base import Image
from flowlik.support.arrays import Array

SHIFT_PX = (4.0, -2.0)
WAVE_PX, WAVELENGTH_PX = 1.5, 64.0
MARGIN_PX = 16
SIGMAS_PX = (0.8, 1.6, 3.2, 6.4, 12.8)
CONTRAST = 45.0

SCALE_TOLERANCE = 0.15
UNEXPLAINED = 0.35
MOST = 100.0


@dataclass(frozen=True)
class KnownMotion:
    """An image pair of known flow (H, W, 2) [px] there and back: a shift that varies a little.

    Where it varies, flow from the previous image to the current one differs from the negative of the flow
    back: this tells a wrong sign from a wrong order of the images.
    """

    previous: Image
    current: Image
    flow: Array
    back: Array

    @classmethod
    def of(cls, size: tuple[int, int]) -> KnownMotion:
        """Pair of a size (H, W)."""
        height, width = size
        v, u = np.mgrid[0:height, 0:width].astype(np.float64)

        def moved(u: Array, v: Array) -> Array:
            turn = 2 * np.pi / WAVELENGTH_PX
            waves = np.stack([np.sin(turn * u), np.sin(turn * v)], axis=-1)
            return np.asarray(SHIFT_PX) + WAVE_PX * waves

        flow, back = moved(u, v), np.zeros((*size, 2))
        for _ in range(20):  # the wave's slope is 0.15: each step gains a digit
            back = -moved(u + back[..., 0], v + back[..., 1])
        wide = _texture((height + 2 * MARGIN_PX, width + 2 * MARGIN_PX))
        at = (np.stack([u, v], axis=-1) + flow + MARGIN_PX).astype(np.float32)
        previous = cv2.remap(wide, at, None, cv2.INTER_CUBIC)  # type: ignore[call-overload]
        current = wide[MARGIN_PX:-MARGIN_PX, MARGIN_PX:-MARGIN_PX]
        return cls(_grey(previous), _grey(current), flow, back)


def _texture(size: tuple[int, int]) -> NDArray[np.float32]:
    """Grey levels of noise of several octaves, like those of a natural image."""
    rng = np.random.default_rng(0)
    total = np.zeros(size)
    for sigma in SIGMAS_PX:
        octave = cv2.GaussianBlur(rng.standard_normal(size), (0, 0), sigma)
        total += octave / octave.std()
    return (127.5 + CONTRAST / total.std() * total).astype(np.float32)


def _grey(values: NDArray[np.float32]) -> Image:
    return np.clip(np.rint(values), 0, 255).astype(np.uint8)


@dataclass(frozen=True)
class Explanation:
    """What a flow is, of what it should be: which convention was taken for another, and its factor.

    ``error_px`` is the median error [px] that remains once these are mended.
    """

    convention: str
    factor: float
    error_px: float


EXPLAINED = {
    "": "",
    "axes": "u and v are swapped (`axes`: vu)",
    "scale": "the sign is the other one (`scale`: -1)",
    "order": "the images are in the other order (`order`: current-first)",
    "axes, scale": "u and v are swapped, and the sign is the other one (`axes`: vu, `scale`: -1)",
    "axes, order": "u and v are swapped, and the images are in the other order "
    "(`axes`: vu, `order`: current-first)",
}


def explain(flow: NDArray[np.floating], motion: KnownMotion) -> Explanation:
    """Explanation of a flow (H, W, 2) [px] of a known motion with the least error; NaN is left out."""
    inner = (slice(MARGIN_PX, -MARGIN_PX), slice(MARGIN_PX, -MARGIN_PX))
    measured = flow[inner].reshape(-1, 2).astype(np.float64)
    known = np.isfinite(measured).all(axis=1)
    candidates = {
        "": motion.flow,
        "axes": motion.flow[..., ::-1],
        "scale": -motion.flow,
        "order": motion.back,
        "axes, scale": -motion.flow[..., ::-1],
        "axes, order": motion.back[..., ::-1],
    }
    found = []
    for convention, candidate in candidates.items():
        expected = candidate[inner].reshape(-1, 2)[known]
        square = (expected**2).sum(axis=1)
        factor = float(np.median((measured[known] * expected).sum(axis=1) / square))
        error = np.linalg.norm(measured[known] - factor * expected, axis=1)
        # a factor below 0 is another candidate
        mended = float(np.median(error)) / factor if factor > 0 else np.inf
        found.append(Explanation(convention, factor, mended))
    return min(found, key=lambda e: e.error_px)


def complaint(flow: NDArray[np.floating], motion: KnownMotion) -> str:
    """What is wrong with a network's flow (H, W, 2) [px] of a known motion, in one line; empty if nothing."""
    if not np.isfinite(flow).all(axis=-1).any():
        return "its flow of a textured image is not finite anywhere"
    best = explain(flow, motion)
    middle = np.nanmedian(flow.reshape(-1, 2), axis=0)
    seen = f"a shift of {SHIFT_PX[0]:g}, {SHIFT_PX[1]:g} px comes back as {middle[0]:.2f}, {middle[1]:.2f} px"
    if best.error_px > UNEXPLAINED * float(np.hypot(*SHIFT_PX)) or not 1 < MOST * best.factor < MOST**2:
        return f"{seen}, and no order, sign or scale explains it (`range`, `normalise`, `output`?)"
    if best.convention:
        return f"{seen}: {EXPLAINED[best.convention]}"
    if abs(best.factor - 1) > SCALE_TOLERANCE:
        return f"{seen}: the scale is another (`scale`: times {1 / best.factor:.3g})"
    return ""
