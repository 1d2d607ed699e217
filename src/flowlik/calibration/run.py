"""Calibration over data sets: pairs to sketches through an injected map, sketches to likelihoods."""

from __future__ import annotations

import platform
from collections.abc import Callable, Iterable, Iterator
from collections.abc import Sequence as Seq
from dataclasses import dataclass
from importlib.metadata import version
from typing import Any

import numpy as np

from flowlik.calibration.fit import fit
from flowlik.calibration.sketch import ErrorSketch, merge_all
from flowlik.camera import Array
from flowlik.datasets.base import Sequence
from flowlik.errors import CalibrationError
from flowlik.families import ErrorFamily
from flowlik.flow.base import DenseFlow, FlowMethod, Image, describe
from flowlik.flow.lucas_kanade import detect_corners
from flowlik.likelihood import FlowLikelihood
from flowlik.measurements import Measurements, measure, stratified_pixels
from flowlik.schedule import Index
from flowlik.texture import TextureDefinition

GRID_PIXELS = 5000


@dataclass(frozen=True)
class Block:
    """A run of frames of one sequence: the unit of parallel work and of the bootstrap."""

    sequence: Sequence
    first: int
    last: int
    seed: int


@dataclass(frozen=True)
class PairErrors:
    """Errors of one image pair: measurements that have truth, z (N, 2) [px], signs, and what was left out."""

    measurements: Measurements
    z: Array
    sign: Array
    excluded: dict[str, int]


def split_blocks(sequence: Sequence, seed: int, frames: int = 10) -> list[Block]:
    """Blocks of at most `frames` image pairs each; the first frame of a pair numbers it."""
    pairs = len(sequence) - 1
    return [
        Block(sequence, first, min(first + frames, pairs), seed + first) for first in range(0, pairs, frames)
    ]


def calibration_pixels(previous: Image, method: FlowMethod, rng: np.random.Generator) -> Array | None:
    """Where to calibrate: every pixel of a dense method, else a jittered grid and corners."""
    if isinstance(method, DenseFlow):
        return None
    grid = stratified_pixels(previous.shape, GRID_PIXELS, rng)
    return np.unique(np.concatenate([grid, detect_corners(previous)]), axis=0)


def pair_errors(
    sequence: Sequence,
    k: int,
    method: FlowMethod,
    texture: TextureDefinition | None = None,
    pixels: Array | None = None,
) -> PairErrors:
    """Errors of the flow from frame k to k + 1 against the sequence's truth.

    Kept are pixels of known truth whose true end lies in the image; occluded ones stay.

    Parameters
    ----------
    sequence : Sequence
        Data with true flow.
    k : int
        First frame.
    method : FlowMethod
        Flow.
    texture : TextureDefinition, optional
        Definition of texture.
    pixels : array (N, 2), optional
        Whole pixels to measure at; by default where the method chooses.
    """
    m = measure(sequence.image(k), sequence.image(k + 1), method, texture, pixels)
    column, row = np.rint(m.pixels).astype(int).T
    truth = sequence.flow(k)[row, column]
    known = np.isfinite(truth).all(axis=1)
    stays = sequence.camera.contains(m.pixels + truth)
    kept = known & stays
    excluded = {
        "no flow": m.lost,
        "no truth": int((~known).sum()),
        "leaves the image": int((known & ~stays).sum()),
    }
    m = m.select(kept)
    along = np.einsum("nij,ni->nj", m.R_i_e, m.flow)
    return PairErrors(m, m.errors(truth[kept]), np.where(along < 0, -1.0, 1.0), excluded)


def sketch_block(
    block: Block, methods: Seq[FlowMethod], index: Index, texture: TextureDefinition
) -> list[ErrorSketch]:
    """One sketch a flow method of a block of frames."""
    sketches = [ErrorSketch.empty(index) for _ in methods]
    for k in range(block.first, block.last):
        rng = np.random.default_rng([block.seed, k])
        previous = block.sequence.image(k)
        for i, method in enumerate(methods):
            e = pair_errors(block.sequence, k, method, texture, calibration_pixels(previous, method, rng))
            pair = ErrorSketch.of(index, e.measurements.covariates, e.z, e.sign, rng, e.excluded)
            sketches[i] = sketches[i].merge(pair)
    return sketches


def sketch_blocks(
    blocks: Seq[Block],
    methods: Seq[FlowMethod],
    index: Index | None = None,
    texture: TextureDefinition | None = None,
    map: Callable[..., Iterable[list[ErrorSketch]]] = map,
) -> Iterator[list[ErrorSketch]]:
    """Sketches of blocks through any `map`: serial, or that of a process pool.

    Yields
    ------
    list of ErrorSketch
        For each block, one a method.
    """
    n = len(blocks)
    index, texture = index or Index(), texture or TextureDefinition()
    yield from map(sketch_block, blocks, [tuple(methods)] * n, [index] * n, [texture] * n)


def calibrate(
    sketches: Seq[ErrorSketch],
    family: ErrorFamily,
    method: FlowMethod,
    texture: TextureDefinition | None = None,
    provenance: dict[str, Any] | None = None,
) -> FlowLikelihood:
    """Likelihood of a flow method from the sketches of its errors.

    Parameters
    ----------
    sketches : sequence of ErrorSketch
        From `sketch_blocks`.
    family : ErrorFamily
        Density.
    method : FlowMethod
        What was measured.
    texture : TextureDefinition, optional
        What the sketches' texture means.
    provenance : dict, optional
        Data, seeds and whatever else the model file should tell.

    Raises
    ------
    CalibrationError
        If there is too little data, or the fit fails.
    """
    if not sketches:
        raise CalibrationError("nothing to calibrate from: no image pairs")
    merged = merge_all(sketches, sketches[0].index)
    schedule, convergence = fit(merged, family)
    versions = {name: version(name) for name in ("flowlik", "numpy", "scipy", "opencv-python-headless")}
    record = {
        **(provenance or {}),
        "components": merged.total,
        "pairs": merged.pairs,
        "excluded": merged.excluded,
        "versions": {"python": platform.python_version(), **versions},
    }
    return FlowLikelihood(
        family, schedule, texture or TextureDefinition(), describe(method), record, {"fit": convergence}
    )
