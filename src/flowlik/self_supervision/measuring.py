"""Pairs of a sequence as a calibration without truth sees them: vectors of all textures, and the camera."""

from __future__ import annotations

from collections.abc import Iterable
from collections.abc import Sequence as Seq

import numpy as np

from flowlik.calibration import calibration_pixels
from flowlik.datasets.base import ImageSequence, frame_pairs, mask_of
from flowlik.datasets.selection import whole_pair
from flowlik.egomotion import Estimator
from flowlik.flow.base import FlowMethod, method_for_pair
from flowlik.image.texture import TextureDefinition
from flowlik.measurement.features import DENSE_PIXELS
from flowlik.measurement.masking import measure_clear
from flowlik.odometry.odometry import Odometry
from flowlik.odometry.self_calibration import Intrinsics, SelfCalibration
from flowlik.self_supervision.cross_fit import SeenPair

GRID_PIXELS = 1500
"""Pixels of a jittered grid, besides a sparse method's corners."""


def spread_firsts(sequence: ImageSequence, most: int) -> list[int]:
    """First frames of at most so many pairs, evenly spread over a sequence."""
    firsts = frame_pairs(sequence)
    chosen = np.linspace(0, len(firsts) - 1, min(most, len(firsts))).astype(int)
    return [firsts[i] for i in chosen]


def seen_pairs(
    sequence: ImageSequence,
    firsts: Iterable[int],
    method: FlowMethod,
    texture: TextureDefinition,
    signals: tuple[str, ...],
    depth: bool = False,
    seed: int = 0,
) -> Iterable[SeenPair]:
    """Measure pairs of a sequence at corners and a jittered grid, or at 4000 pixels of a dense method.

    Raises
    ------
    DataError
        If a frame cannot be read or does not fit.
    """
    for k in firsts:
        images, rng = (sequence.image(k), sequence.image(k + 1)), np.random.default_rng([seed, k])
        own = method_for_pair(method, *whole_pair(sequence, k))
        pixels = calibration_pixels(images[0], method, rng, DENSE_PIXELS, GRID_PIXELS)
        m = measure_clear(images, own, texture, mask_of(sequence, k), pixels, signals)
        yield SeenPair(m, sequence.camera, sequence.depth(k) if depth else None)


def self_calibrated(
    pairs: Seq[SeenPair], method: FlowMethod, estimator: Estimator, seed: int = 0
) -> tuple[list[SeenPair], Intrinsics]:
    """Pairs of one camera as its refined self would have seen them, and what was found of it.

    The intrinsics are those after all pairs; every pair is rectified by them.
    """
    robot = Odometry(pairs[0].camera, method, estimator, seed, self_calibration=SelfCalibration())
    for pair in pairs:
        robot.advance(pair.measurements)
    found = robot.intrinsics[-1]
    return [SeenPair(found.rectified(p.measurements), found.camera, p.depth) for p in pairs], found
