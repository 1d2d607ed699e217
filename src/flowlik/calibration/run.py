"""Calibration over data sets: pairs to sketches through an injected map, sketches to likelihoods."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from collections.abc import Sequence as Seq
from typing import Any

import numpy as np

from flowlik.calibration._fit import choose_smoothing, fit, fit_constant
from flowlik.calibration._pairs import calibration_pixels, pair_errors
from flowlik.calibration.cache import SketchCache
from flowlik.calibration.sketch import ErrorSketch, merge_all
from flowlik.calibration.tasks import Block, Task
from flowlik.datasets.base import ImageSequence, frame_pairs
from flowlik.errors import CalibrationError
from flowlik.flow.base import FlowMethod, describe
from flowlik.image.texture import TextureDefinition
from flowlik.likelihood.covariates import of_components
from flowlik.likelihood.families import ErrorFamily
from flowlik.likelihood.likelihood import FlowLikelihood
from flowlik.support.arrays import Array
from flowlik.support.versions import versions

BOOTSTRAP_BLOCKS = 40


def split_blocks(sequence: ImageSequence, seed: int, frames: int = 10) -> list[Block]:
    """Blocks of at most `frames` image pairs each."""
    firsts = frame_pairs(sequence)
    return [Block(sequence, firsts[i : i + frames], seed + firsts[i]) for i in range(0, len(firsts), frames)]


def _sketch_block(block: Block, tasks: Seq[Task]) -> list[ErrorSketch]:
    """Sketches of a block of frames: for each task, one an index."""
    sketches = [ErrorSketch.empty(index, task.covariates) for task in tasks for index in task.indices]
    for k in block.firsts:
        found = [
            sketch
            for i, task in enumerate(tasks)
            for sketch in _sketch_pair(block.sequence, k, task, np.random.default_rng([block.seed, k, i]))
        ]
        sketches = [sketch.merge(pair) for sketch, pair in zip(sketches, found)]
    return sketches


def _sketch_pair(sequence: ImageSequence, k: int, task: Task, rng: np.random.Generator) -> list[ErrorSketch]:
    pixels = calibration_pixels(sequence.image(k), task.method, rng, task.pixels)
    e = pair_errors(sequence, k, task.method, task.texture, pixels, task.signals)
    values = {name: of_components(name, e.measurements) for name in task.covariates}
    seed = rng.integers(2**32)
    return [
        ErrorSketch.of(index, values, e.z, e.sign, np.random.default_rng(seed), e.excluded)
        for index in task.indices
    ]


def sketch_blocks(
    blocks: Seq[Block],
    tasks: Seq[Task],
    map: Callable[..., Iterable[list[ErrorSketch]]] = map,
    cache: SketchCache | None = None,
) -> Iterator[list[ErrorSketch]]:
    """Sketches of blocks through any `map`: serial, that of a process pool, or a cluster's.

    Parameters
    ----------
    blocks, tasks : sequence
        What to sketch.
    map : callable
        From `flowlik.calibration.executors.executor`, or like the built-in one.
    cache : SketchCache, optional
        Where each block's sketches are saved as they come, and from which they are read if they are there.

    Yields
    ------
    list of ErrorSketch
        For each block in order, what `_sketch_block` gives.

    Raises
    ------
    DataError
        If data cannot be read, or the cache belongs to another calibration.
    """

    def measured(blocks: Seq[Block]) -> Iterator[list[ErrorSketch]]:
        yield from map(_sketch_block, blocks, [tuple(tasks)] * len(blocks))

    if cache is None:
        yield from measured(blocks)
        return
    cache.open(blocks, tasks)
    saved = [cache.has(i) for i in range(len(blocks))]
    missing = measured([block for block, there in zip(blocks, saved) if not there])
    for i, (block, there) in enumerate(zip(blocks, saved)):
        found = cache.load(i) if there else None
        if found is None:
            found = next(measured([block]) if there else missing)
            cache.save(i, found)
        yield found


def gather(
    sketches: Iterable[list[ErrorSketch]], total: int, most: int = BOOTSTRAP_BLOCKS
) -> list[list[ErrorSketch]]:
    """Merge neighbouring blocks' sketches until so many are left of each kind, for the bootstrap.

    Memory thus does not grow with the number of frames.

    Parameters
    ----------
    sketches : iterable of list of ErrorSketch
        From `sketch_blocks`.
    total : int
        How many blocks there are.
    most : int
        How many to leave.

    Returns
    -------
    list of list of ErrorSketch
        For each kind (task and index), its blocks in order.
    """
    kinds: list[list[ErrorSketch]] = []
    group_of_last = -1
    for i, found in enumerate(sketches):
        group = i * min(most, total) // total
        if not kinds:
            kinds = [[] for _ in found]
        for kind, sketch in zip(kinds, found):
            if group == group_of_last:
                kind[-1] = kind[-1].merge(sketch)
            else:
                kind.append(sketch)
        group_of_last = group
    return kinds


def fit_likelihood(
    sketches: Seq[ErrorSketch],
    family: ErrorFamily,
    method: FlowMethod,
    texture: TextureDefinition | None = None,
    provenance: dict[str, Any] | None = None,
    knots: Array | None = None,
    smoothing: float | None = None,
    constant: bool = False,
) -> FlowLikelihood:
    """Likelihood of a flow method from the sketches of its errors.

    Parameters
    ----------
    sketches : sequence of ErrorSketch
        Of blocks of frames.
    family : ErrorFamily
        Density.
    method : FlowMethod
        What was measured.
    texture : TextureDefinition, optional
        What the sketches' texture means.
    provenance : dict, optional
        Data, seeds and whatever else the model file should tell.
    knots : array (M,), optional
        Knots of x; by default placed by the data.
    smoothing : float, optional
        Smoothness prior [nat]; by default chosen by held-out score between blocks.
    constant : bool
        Whether one set of parameters shall hold for all components.

    Raises
    ------
    CalibrationError
        If there is too little data, or the fit fails.
    """
    if not sketches:
        raise CalibrationError("nothing to calibrate from: no image pairs")
    merged = merge_all(sketches)
    if constant:
        schedule, convergence = fit_constant(merged, family)
    else:
        if smoothing is None:
            smoothing = choose_smoothing(sketches, family, knots)
        schedule, convergence = fit(merged, family, knots, smoothing)
    record = {
        **(provenance or {}),
        "components": merged.total,
        "pairs": merged.pairs,
        "excluded": merged.excluded,
        "versions": versions(),
    }
    return FlowLikelihood(
        family, schedule, texture or TextureDefinition(), describe(method), record, {"fit": convergence}
    )
