"""Data with truth, opened as the options of a command say, with what its run should tell of it."""

from __future__ import annotations

from pathlib import Path

from flowlik.commands.options import Data
from flowlik.datasets import masked, open_sequence, resized
from flowlik.datasets.base import ImageSequence, notes_of
from flowlik.datasets.selection import usable
from flowlik.results.runs import RunFolder


def read_data(folder: Path, options: Data, run: RunFolder) -> ImageSequence:
    """Sequence of a folder: masked, resized, without frames that cannot be used; the run warns of these.

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
    return sequence
