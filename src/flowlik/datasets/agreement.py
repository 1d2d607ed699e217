"""The data test: whether the images of a data set move as its truth says, and its times as its poses."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform

from flowlik.datasets._tracks import epipolar_errors, even, in_common, track
from flowlik.datasets.base import ImageSequence, frame_pairs, mask_of
from flowlik.errors import FlowlikError, MissingFieldError
from flowlik.geometry.camera import Pinhole
from flowlik.geometry.motion import h, inverse_range, relative_motion
from flowlik.image.sampling import at_nearest
from flowlik.support.arrays import Array

PAIRS = 6

EXACT = 0.05, 0.02
"""Tolerance of exact true flow: so many pixels, and such a share of the motion."""

MEASURED = 1.5, 0.25
"""Tolerance of true flow that sensors measured, or of flow that was estimated."""

POSES = 0.8, 0.05
"""Tolerance of distances from epipolar lines."""

BETTER, LEAST_PX, LEAST_PAIRS = 0.5, 0.2, 3
OFFSETS = (-2, -1, 1, 2)
FOCALS = (1 / 3, 1 / 2, 2 / 3, 3 / 2, 2.0, 3.0)
DEPTHS = (1 / 5, 5.0)
SAME_SURFACE, SAME_FLOW_PX = 0.2, 0.5

TIMED_FRAMES, LEAST_STEPS = 300, 10
UNEVEN, ROUGHER, LEAST_ROUGH = 0.1, 2.0, 0.05


class Fit(NamedTuple):
    """How well images and truth of some pairs agree.

    Attributes
    ----------
    off_px : float
        How far they lie apart in common, the median over the pairs; NaN where too little could be tracked.
    moved_px : float
        How far the images move in common.
    pairs : int
        Of how many pairs.
    better : str
        What would explain the images far better, or nothing.
    better_px : float
        How far the images lie apart from that.
    """

    off_px: float
    moved_px: float
    pairs: int
    better: str = ""
    better_px: float = np.nan


def truth_doubts(sequence: ImageSequence, pairs: int = PAIRS) -> tuple[str, ...]:
    """What of a data set's truth does not agree with its images or times, a sentence each; as a rule nothing.

    Corners of a few image pairs are tracked and compared with the true flow, or where there is none with the
    epipolar lines of the true poses; times are compared with how far the poses advance. Half of the pairs,
    and half of the image in each, must disagree: moving objects and single bad frames do not make a doubt.

    Parameters
    ----------
    sequence : ImageSequence
        Data set; without truth there is nothing to doubt.
    pairs : int
        How many pairs to look at, spread over the sequence.
    """
    return tuple(doubt for doubt in (motion_doubt(sequence, pairs), time_doubt(sequence)) if doubt)


def motion_doubt(sequence: ImageSequence, pairs: int = PAIRS) -> str | None:
    """What to tell where images do not move as the truth says, as in `truth_doubts`; else None."""
    found = _looked_at(sequence, pairs, lambda k: _explained(sequence, k))
    flow = any("flow" in pair for pair in found)
    tolerance, what = (EXACT, "its true flow says") if flow else (POSES, "its poses say")
    if flow and getattr(sequence, "measured_truth", False):
        tolerance = MEASURED
    fit = _fit(found, "flow" if flow else "poses")
    return _fit_doubt(sequence.name, fit, tolerance, what)


def flow_doubt(
    sequence: ImageSequence, flow: Callable[[int], NDArray[np.floating]], pairs: int = PAIRS
) -> str | None:
    """What to tell of estimated flow that is not of these images, by pairs as in `truth_doubts`; else None.

    Parameters
    ----------
    sequence : ImageSequence
        Images.
    flow : callable
        Gives the flow (H, W, 2) [px] from frame k to k + 1.
    pairs : int
        How many pairs to look at.
    """

    def compared(k: int) -> dict[str, float]:
        return _compared(sequence.image(k), sequence.image(k + 1), flow(k), mask_of(sequence, k))

    fit = _fit(_looked_at(sequence, pairs, compared), "flow")
    return _fit_doubt(sequence.name, fit, MEASURED, "the flow on disk says")


def pair_doubt(
    name: str,
    images: tuple[NDArray[np.uint8], NDArray[np.uint8]],
    flow: NDArray[np.floating],
    exact: bool = True,
    usable: NDArray[np.bool_] | None = None,
) -> str | None:
    """What to tell of flow (H, W, 2) [px] that is not that of two grey images (H, W), else None.

    Parameters
    ----------
    name : str
        What the flow is, to begin with.
    images : pair of uint8 array (H, W)
        Images.
    flow : array (H, W, 2)
        Flow [px]; NaN where unknown.
    exact : bool
        Whether it is true flow, or estimated.
    usable : bool array (H, W), optional
        Usable pixels of both images; without it all are.
    """
    fit = _fit([_compared(*images, flow, usable)], "flow")
    return _fit_doubt(name, fit, EXACT if exact else MEASURED, "it says")


def _looked_at(
    sequence: ImageSequence, pairs: int, look: Callable[[int], dict[str, float]]
) -> list[dict[str, float]]:
    """What is found at pairs spread over the sequence; unreadable frames are told when they are used."""
    firsts = np.array(frame_pairs(sequence))
    spread = np.linspace(0, len(firsts) - 1, min(pairs, len(firsts)))
    found = []
    for k in firsts[np.unique(spread.round().astype(int))]:
        with suppress(FlowlikError):
            found.append(look(int(k)))
    return found


def _compared(
    previous: NDArray[np.uint8],
    current: NDArray[np.uint8],
    flow: NDArray[np.floating],
    usable: NDArray[np.bool_] | None,
) -> dict[str, float]:
    """How far two images move, and how far they lie from a flow where that is known."""
    tracks = track(previous, current, usable, even(flow, SAME_SURFACE, SAME_FLOW_PX))
    said = at_nearest(flow, tracks.pixels).astype(np.float64)
    others = {
        "flow": said, "the flow halved": said / 2, "the flow doubled": said * 2, "the flow reversed": -said,
        "u and v exchanged": said[:, ::-1],
    }  # fmt: skip
    found = {what: in_common(tracks.flow - other, tracks.cells) for what, other in others.items()}
    return {**found, "moved": in_common(tracks.flow, tracks.cells)}


def _fit_doubt(name: str, fit: Fit, tolerance: tuple[float, float], what: str) -> str | None:
    """What to tell of a fit beyond its tolerance, or than which something else is far better; else None."""
    least, share = tolerance
    if not (fit.off_px > least + share * fit.moved_px or fit.better):
        return None
    hint = f"; with {fit.better} it is {fit.better_px:.2g} px" if fit.better else ""
    return (
        f"{name}: the images do not move as {what}: {fit.off_px:.2g} px beside it, where they move by "
        f"{fit.moved_px:.2g} px (medians over {fit.pairs} image pairs){hint}. "
        "Is it of other frames, of another camera, or in other units?"
    )


def _explained(sequence: ImageSequence, k: int) -> dict[str, float]:
    """How far the images of frames k and k + 1 lie from the truth of the data set, and from other truths."""
    depth = _depth(sequence, k)
    flow = _own_flow(sequence, k) if depth is None else None
    if depth is None and flow is None:
        sequence.T_n_c(k)  # nothing to compare with: not worth tracking
    previous, current, usable = sequence.image(k), sequence.image(k + 1), mask_of(sequence, k)
    if flow is not None:
        return _compared(previous, current, flow, usable)
    known = None if depth is None else even(1 / np.where(depth > 0, depth, np.nan)[..., None], SAME_SURFACE)
    tracks = track(previous, current, usable, known)
    found = {"moved": in_common(tracks.flow, tracks.cells)}
    if depth is None:
        for what, camera, T in _posed(sequence, k):
            found[what or "poses"] = in_common(epipolar_errors(camera, tracks, T), tracks.cells)
        return found
    z = at_nearest(depth, tracks.pixels)
    said = [(what, camera, z, T) for what, camera, T in _posed(sequence, k)]
    _, camera, _, T = said[0]
    said += [(f"{factor:.2g} times the depth", camera, factor * z, T) for factor in DEPTHS]
    for what, camera, depths, T in said:
        errors = tracks.flow - h(T, camera, tracks.pixels, inverse_range(camera, tracks.pixels, depths))
        found[what or "flow"] = in_common(errors, tracks.cells)
    return found


def _depth(sequence: ImageSequence, k: int) -> Array | None:
    """Depth of frame k where it makes, with the poses, the true flow."""
    if getattr(sequence, "has_movers", False):
        return None
    with suppress(MissingFieldError):
        sequence.T_n_c(k)
        return sequence.depth(k)
    return None


def _own_flow(sequence: ImageSequence, k: int) -> Array | None:
    with suppress(MissingFieldError):
        return sequence.flow(k)
    return None


def _posed(sequence: ImageSequence, k: int) -> Iterator[tuple[str, Pinhole, RigidTransform]]:
    """Cameras and motions that might explain frames k and k + 1, what the data set says without a name."""
    camera = sequence.camera

    def motion(first: int) -> RigidTransform:
        return relative_motion(sequence.T_n_c(first), sequence.T_n_c(first + 1))

    own = motion(k)
    yield "", camera, own
    for offset in OFFSETS:
        if 0 <= k + offset < len(sequence) - 1:
            frames = f"{abs(offset)} frame{'s' * (abs(offset) > 1)}"
            yield f"the poses of {frames} {'later' if offset > 0 else 'before'}", camera, motion(k + offset)
    u, v = (camera.width - 1) / 2, (camera.height - 1) / 2
    for factor in FOCALS:
        other = replace(camera, fx=factor * camera.fx, fy=factor * camera.fy)
        yield f"{factor:.2g} times the focal length", other, own
        what = f"{factor:.2g} times the focal length and the principal point in the middle"
        yield what, replace(other, cx=u, cy=v), own


def _fit(pairs: Sequence[dict[str, float]], kind: str) -> Fit:
    """What all pairs say of the truth of a kind, and what explains them far better, if anything does."""
    usable = [pair for pair in pairs if np.isfinite(pair.get(kind, np.nan))]
    if not usable:
        return Fit(np.nan, np.nan, 0)
    off, moved = (float(np.nanmedian([pair[key] for pair in usable])) for key in (kind, "moved"))
    fit = Fit(off, moved, len(usable))
    if off < LEAST_PX:
        return fit
    others = {}
    for what in dict.fromkeys(
        what for pair in usable for what in pair if what not in ("flow", "poses", "moved")
    ):
        both = [(pair[what], pair[kind]) for pair in usable if np.isfinite(pair.get(what, np.nan))]
        if len(both) >= LEAST_PAIRS and np.median([a / b for a, b in both]) < BETTER:
            others[what] = float(np.median([a for a, _ in both]))
    if not others:
        return fit
    best = min(others, key=others.__getitem__)
    return fit._replace(better=best, better_px=others[best])


def time_doubt(sequence: ImageSequence) -> str | None:
    """What to tell where poses advance evenly by frames and unevenly by times; else None."""
    count = min(len(sequence), TIMED_FRAMES)
    if getattr(sequence, "isolated_pairs", False) or count <= LEAST_STEPS:
        return None
    try:
        times = np.array([sequence.timestamp(k) for k in range(count)])
        positions = np.array([sequence.T_n_c(k).translation for k in range(count)])
    except FlowlikError:
        return None
    seconds, metres = np.diff(times), np.linalg.norm(np.diff(positions, axis=0), axis=1)
    moving = (metres > np.median(metres) / 10) & (seconds > 0)
    if moving.sum() < LEAST_STEPS:
        return None
    seconds, metres = seconds[moving], metres[moving]
    uneven = np.median(np.abs(seconds / np.median(seconds) - 1))
    by_time, by_frame = (
        float(np.median(np.abs(np.diff(np.log(values))))) for values in (metres / seconds, metres)
    )
    if uneven < UNEVEN or by_time < max(ROUGHER * by_frame, LEAST_ROUGH):
        return None
    return (
        f"{sequence.name}: the poses do not advance as the times say: from frame to frame the speed changes "
        f"by {100 * by_time:.0f} %, the step by {100 * by_frame:.0f} % (medians). "
        "Are the times of other frames?"
    )
