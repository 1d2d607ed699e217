"""What errors of one image pair share: the correlation of scores, and the composite power it asks for."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from collections.abc import Sequence as Seq
from dataclasses import replace
from functools import reduce

import numpy as np

from flowlik.calibration._correlation import ScoreProducts, fit_correlation
from flowlik.calibration._pairs import pair_errors
from flowlik.calibration.tasks import Block
from flowlik.datasets.base import ImageSequence, frame_pairs
from flowlik.errors import CalibrationError
from flowlik.flow.base import DenseFlow, FlowMethod
from flowlik.flow.lucas_kanade import detect_corners
from flowlik.image.texture import TextureDefinition
from flowlik.likelihood.families import LaplaceCauchy
from flowlik.likelihood.likelihood import FlowLikelihood
from flowlik.likelihood.shared_errors import SharedErrors
from flowlik.measurement.features import DENSE_PIXELS
from flowlik.measurement.measurements import Measurements, stratified_pixels
from flowlik.support.arrays import Array

VECTORS = 1200
POWERS = np.arange(21) / 10
LEAST_PX = 1e-9
FEWEST = 20
"""Vectors of an image pair, and pairs for a composite power: fewer say nothing."""

Pairs = list[tuple[Measurements, Array]]
"""Measurements and errors z (N, 2) [px] of image pairs."""


def measured_pairs(
    blocks: Seq[Block],
    method: FlowMethod,
    texture: TextureDefinition,
    signals: tuple[str, ...] = (),
    map: Callable[..., Iterable[Pairs]] = map,
) -> Pairs:
    """Errors of 1200 random vectors of each pair of blocks, where an estimator takes them.

    Any `map` that keeps the order will do; ``signals`` are those of the likelihoods that are asked.
    """
    found = map(_pairs_of_block, blocks, *([each] * len(blocks) for each in (method, texture, signals)))
    return [pair for of_block in found for pair in of_block]


def with_shared_errors(likelihood: FlowLikelihood, pairs: Pairs) -> FlowLikelihood:
    """Likelihood that knows what errors of its flow method share, by image pairs with truth.

    The power is that with the least error of an affine motion field, whose logarithm is averaged over the
    pairs: cameras' motions move images smoothly, and this needs their flow alone. Fewer than 20 pairs ask for
    none; in the paper's likelihood, Laplace-Cauchy over texture, components count by their information alone.

    Raises
    ------
    CalibrationError
        If there are no pairs.
    """
    if not pairs:
        raise CalibrationError("no image pairs with flow vectors to take the correlation of scores from")
    correlation = fit_correlation(
        reduce(ScoreProducts.merge, (ScoreProducts.of(likelihood, m, z) for m, z in pairs))
    )
    power = 0.0
    paper = likelihood.family.name == LaplaceCauchy.name and likelihood.schedule.name == "texture"
    if not paper and len(pairs) >= FEWEST:
        logs = [np.log(_field_errors(likelihood, m, z)) for m, z in pairs]
        power = float(POWERS[np.argmin(np.mean(logs, axis=0))])
    return replace(likelihood, shared_errors=SharedErrors(correlation, power))


def _field_errors(likelihood: FlowLikelihood, m: Measurements, z: Array) -> Array:
    """Errors (E,) [px] of the affine motion field, at each of `POWERS`, where the true field is zero.

    One step of scoring from the truth, over errors z (N, 2) [px] in the eigenbasis; the field's RMS at the
    vectors.
    """
    x = likelihood.coordinate(m)
    score, fisher = -likelihood.score(z, x).ravel(), likelihood.fisher(x).ravel()
    centred = m.pixels - m.pixels.mean(axis=0)
    terms = np.column_stack([np.ones(len(m)), centred / max(np.abs(centred).max(), 1.0)])
    J = np.einsum("nci,nk->ncik", np.swapaxes(m.R_i_e, 1, 2), terms).reshape(x.size, -1)
    errors = []
    for power in POWERS:
        weight = (fisher / fisher.max()) ** power
        step, *_ = np.linalg.lstsq(
            J.T @ ((weight * fisher)[:, None] * J), J.T @ (weight * score), rcond=1e-12
        )
        field = terms @ step.reshape(2, -1).T
        errors.append(np.sqrt((field**2).sum(axis=1).mean()))
    return np.maximum(errors, LEAST_PX)


def spread_pairs(sequence: ImageSequence, most: int, seed: int) -> list[Block]:
    """At most so many pairs of a sequence, evenly spread, a block each."""
    firsts = frame_pairs(sequence)
    chosen = np.linspace(0, len(firsts) - 1, min(most, len(firsts))).astype(int).tolist()
    return [Block(sequence, firsts[i : i + 1], seed) for i in chosen]


def _pairs_of_block(
    block: Block, method: FlowMethod, texture: TextureDefinition, signals: tuple[str, ...]
) -> Pairs:
    found = []
    for k in block.firsts:
        rng = np.random.default_rng([block.seed, k])
        image = block.sequence.image(k)
        dense = isinstance(method, DenseFlow)
        pixels = stratified_pixels(image.shape, DENSE_PIXELS, rng) if dense else detect_corners(image)
        chosen = pixels[rng.permutation(len(pixels))[:VECTORS]]
        e = pair_errors(block.sequence, k, method, texture, chosen, signals)
        if len(e.z) >= FEWEST:
            found.append((e.measurements, e.z))
    return found
