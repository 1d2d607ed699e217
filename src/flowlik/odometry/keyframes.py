"""Frames far enough apart to tell a motion: those between which the image has moved."""

from __future__ import annotations

from collections.abc import Callable, Iterable

import numpy as np

from flowlik.datasets.base import mask_of
from flowlik.datasets.selection import Selection
from flowlik.errors import DataError
from flowlik.flow.base import FlowMethod, FlowOfPairs
from flowlik.image.sampling import at_nearest

Walk = Callable[[Iterable[int]], Iterable[int]]


def moving_frames(
    sequence: Selection, method: FlowMethod, parallax_px: float, walk: Walk = iter
) -> Selection:
    """Leave out the frames between which and the last one kept the median flow does not exceed a length.

    Every image is decoded and its flow measured once more for it.

    Parameters
    ----------
    sequence : Selection
        Frames to choose from; the first is kept.
    method : FlowMethod
        Flow.
    parallax_px : float
        Length [px] that the median flow must exceed.
    walk : callable
        Passes on the frames' numbers as they are looked at: progress.

    Raises
    ------
    DataError
        If the length is not positive, the flow stands on disk (where it is that of neighbours only), or
        nothing moves so far.
    """
    if not 0 < parallax_px < np.inf:
        raise DataError(f"--parallax must be a positive length [px], not {parallax_px}")
    if isinstance(method, FlowOfPairs):
        raise DataError("--parallax leaves frames out, but flow on disk is that of neighbouring frames")
    kept, last = [0], sequence.image(0)
    for k in walk(range(1, len(sequence))):
        image = sequence.image(k)
        pixels, flow = method.measure(last, image)
        usable = mask_of(sequence, kept[-1])
        if usable is not None:
            flow = flow[at_nearest(usable, pixels)]
        lengths = np.linalg.norm(flow, axis=-1)
        lengths = lengths[np.isfinite(lengths)]
        if len(lengths) and np.median(lengths) > parallax_px:
            kept.append(k)
            last = image
    if len(kept) < 2:
        raise DataError(f"{sequence.name}: in no frame the image has moved by {parallax_px:g} px")
    return Selection(sequence.whole, sequence.frames[kept].tolist())
