"""Data with truth, opened as the options of a command say, with what its run should tell of it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from flowlik.commands._shared_options import Data
from flowlik.datasets import masked, open_sequence, resized
from flowlik.datasets.agreement import flow_doubt, motion_doubt, time_doubt
from flowlik.datasets.base import ImageSequence, notes_of
from flowlik.datasets.selection import usable, whole_pair
from flowlik.flow import FlowFiles
from flowlik.flow.base import FlowMethod
from flowlik.results.runs import RunFolder


def read_data(folder: Path, options: Data, run: RunFolder, flow: FlowMethod) -> ImageSequence:
    """Sequence of a folder: masked, resized, without frames that cannot be used; the run warns of these.

    It warns too where the data test finds that images do not move as the truth or flow on disk says.

    Raises
    ------
    DataError
        If the folder is no data set, or mask, size or frames do not fit.
    """
    whole = open_sequence(folder, options.format, options.camera, None, options.skip_bad_frames)
    sequence = resized(masked(whole, options.mask), options.resize)
    if options.skip_bad_frames:
        sequence, skipped = usable(sequence)
        for bad in skipped:
            run.warn(f"{sequence.name}: frame {bad.frame} skipped: {bad.reason}")
    for note in notes_of(sequence):
        run.warn(note)
    warn_of_doubts(run, sequence, flow)
    return sequence


def warn_of_doubts(run: RunFolder, sequence: ImageSequence, flow: FlowMethod) -> bool:
    """Let a run warn of truth, or flow on disk, that is not that of the images; tell if truth is not."""
    moves = motion_doubt(sequence)
    of_flow = flow_doubt(sequence, _on_disk(sequence, flow)) if isinstance(flow, FlowFiles) else None
    for doubt in filter(None, (moves, time_doubt(sequence), of_flow)):
        run.warn(doubt)
    return moves is not None


def _on_disk(sequence: ImageSequence, flow: FlowFiles) -> Callable[[int], NDArray[np.float32]]:
    """Flow (H, W, 2) [px] from frame k to k + 1, as files say."""
    return lambda k: flow.for_pair(*whole_pair(sequence, k)).dense(sequence.image(k), sequence.image(k + 1))
