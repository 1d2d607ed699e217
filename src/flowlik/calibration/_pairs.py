"""Errors of one image pair against the truth: what a calibration is made from."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from flowlik.datasets.base import ImageSequence, mask_of
from flowlik.datasets.selection import whole_pair
from flowlik.flow.base import DenseFlow, FlowMethod, Image, method_for_pair
from flowlik.flow.lucas_kanade import detect_corners
from flowlik.image.sampling import sample_flow
from flowlik.image.texture import TextureDefinition
from flowlik.measurement.masking import measure_clear
from flowlik.measurement.measurements import Measurements, stratified_pixels
from flowlik.support.arrays import Array

GRID_PIXELS = 5000


@dataclass(frozen=True)
class PairErrors:
    """Errors of one image pair: measurements that have truth, z (N, 2) [px], signs, and what was left out."""

    measurements: Measurements
    z: Array
    sign: Array
    excluded: dict[str, int]


def calibration_pixels(
    previous: Image,
    method: FlowMethod,
    rng: np.random.Generator,
    dense: int | None = None,
    grid: int = GRID_PIXELS,
) -> Array | None:
    """Where to calibrate: all or so many pixels of a dense method, else a jittered grid and corners.

    Raises
    ------
    DataError
        If the image is too small for so many pixels.
    """
    if isinstance(method, DenseFlow):
        return None if dense is None else stratified_pixels(previous.shape, dense, rng)
    jittered = stratified_pixels(previous.shape, grid, rng)
    return np.unique(np.concatenate([jittered, detect_corners(previous)]), axis=0)


def pair_errors(
    sequence: ImageSequence,
    k: int,
    method: FlowMethod,
    texture: TextureDefinition | None = None,
    pixels: Array | None = None,
    signals: Iterable[str] = (),
) -> PairErrors:
    """Errors of the flow from frame k to k + 1 against the sequence's truth.

    Kept are pixels of known truth whose true end lies in the image; occluded ones stay. Nothing is measured
    whose windows hold what is masked.

    Parameters
    ----------
    sequence : ImageSequence
        Data with true flow.
    k : int
        First frame.
    method : FlowMethod
        Flow.
    texture : TextureDefinition, optional
        Definition of texture.
    pixels : array (N, 2), optional
        Pixels to measure at; by default where the method chooses.
    signals : iterable of str
        Signals to measure besides.
    """
    method = method_for_pair(method, *whole_pair(sequence, k))
    images, usable = (sequence.image(k), sequence.image(k + 1)), mask_of(sequence, k)
    texture = texture or TextureDefinition()
    m = measure_clear(images, method, texture, usable, pixels, signals)
    truth = sample_flow(sequence.flow(k), m.pixels)
    known = np.asarray(np.isfinite(truth).all(axis=1))
    height, width = images[0].shape
    end = m.pixels + truth
    with np.errstate(invalid="ignore"):
        stays = ((end >= 0) & (end <= [width - 1, height - 1])).all(axis=1)
    kept = known & stays
    excluded = {
        "no flow": m.lost,
        "no truth": int((~known).sum()),
        "leaves the image": int((known & ~stays).sum()),
    }
    m = m.select(kept)
    along = np.einsum("nij,ni->nj", m.R_i_e, m.flow)
    return PairErrors(m, m.errors(truth[kept]), np.where(along < 0, -1.0, 1.0), excluded)
