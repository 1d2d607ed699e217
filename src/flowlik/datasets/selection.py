"""Chosen frames of a sequence as a sequence: a range of them, or those that can be read."""

from __future__ import annotations

from collections.abc import Callable
from collections.abc import Sequence as Seq
from contextlib import suppress
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform

from flowlik.datasets.base import ImageSequence, frame_index, lacks
from flowlik.datasets.next_frame import is_visible, motion_to_next, true_flow, visibility_next
from flowlik.errors import DataError, MissingFieldError
from flowlik.geometry.camera import Pinhole
from flowlik.geometry.times import time_text
from flowlik.support.arrays import Array

_T = TypeVar("_T", bound=np.generic)


class Skipped(NamedTuple):
    """A frame left out, by its number in the whole sequence, and why."""

    frame: int
    reason: str


class Selection:
    """Frames of a sequence, numbered anew, with everything that the sequence tells of them.

    Parameters
    ----------
    whole : ImageSequence
        The sequence.
    frames : sequence of int
        Increasing frame numbers of it, at least one.

    Raises
    ------
    DataError
        If the sequence has no such frames.
    AttributeError
        If what is asked for is neither here nor in the sequence.
    """

    def __init__(self, whole: ImageSequence, frames: Seq[int]) -> None:
        self.whole, self.frames, self.name = whole, np.array(frames, dtype=int), whole.name
        if not len(frames) or self.frames[0] < 0 or self.frames[-1] >= len(whole):
            raise DataError(f"{whole.name}: no such frames, there are {len(whole)}")

    @property
    def camera(self) -> Pinhole:
        """The camera of every frame."""
        return self.whole.camera

    @property
    def numbers(self) -> NDArray[np.int64]:
        """Frame numbers (N,) in the sequence that nothing was chosen from before."""
        return self.whole.numbers[self.frames] if isinstance(self.whole, Selection) else self.frames

    def __len__(self) -> int:
        """Return the number of frames chosen."""
        return len(self.frames)

    def image(self, k: int) -> NDArray[np.uint8]:
        """Grey image (H, W) of frame k."""
        return self.whole.image(self._of(k))

    def timestamp(self, k: int) -> float:
        """Time [s] of frame k."""
        return self.whole.timestamp(self._of(k))

    def T_n_c(self, k: int) -> RigidTransform:
        """Return the true pose of frame k, which takes points in {c} to points in {n} [m]."""
        return self.whole.T_n_c(self._of(k))

    def depth(self, k: int) -> NDArray[np.float64]:
        """Return the true depth (H, W) [m] of frame k."""
        return self.whole.depth(self._of(k))

    def flow(self, k: int) -> NDArray[np.float64]:
        """Return the true flow (H, W, 2) [px] to the next frame.

        Raises
        ------
        MissingFieldError
            If the sequence has no flow, or none over frames that were left out: only depth and poses tell it.
        """
        if self._whole_pair(k):
            return self.whole.flow(self._of(k))
        return self._over(k, "true flow", lambda depth, motion: true_flow(self.camera, depth, motion))

    def visible(self, k: int) -> NDArray[np.bool_]:
        """Return which pixels (H, W) of frame k are seen again in the next frame.

        Raises
        ------
        MissingFieldError
            As `flow`.
        """
        if self._whole_pair(k):
            whole: Any = self.whole
            return whole.visible(self._of(k))

        def seen(depth: Array, motion: RigidTransform) -> NDArray[np.bool_]:
            return is_visible(visibility_next(self.camera, depth, self.depth(k + 1), motion))

        return self._over(k, "visibility", seen)

    def _whole_pair(self, k: int) -> bool:
        """Whether the next frame is the whole sequence's next, or there is none."""
        return frame_index(self, k) + 1 == len(self) or self._of(k + 1) == self._of(k) + 1

    def _over(self, k: int, what: str, made: Callable[[Array, RigidTransform], NDArray[_T]]) -> NDArray[_T]:
        """What depth and poses tell over frames that were left out, if nothing else moves."""
        missing = f"{what} from frame {self._of(k)} to {self._of(k + 1)}"
        if getattr(self.whole, "has_movers", False):
            raise lacks(self.name, missing)
        try:
            return made(self.depth(k), motion_to_next(self, k))
        except MissingFieldError as error:
            raise lacks(self.name, missing) from error

    def __getattr__(self, name: str) -> Any:
        """What else the sequence has: right images and the GPS of these frames, a baseline."""
        if name.startswith("_") or name in ("whole", "frames"):
            raise AttributeError(name)
        value = getattr(self.whole, name)
        if name in ("gps_positions", "gps_accuracy_m"):
            return value[self.frames]
        return (lambda k: value(self._of(k))) if name in ("right_image", "mask") else value

    def _of(self, k: int) -> int:
        return int(self.frames[frame_index(self, k)])


def select_frames(
    sequence: ImageSequence,
    start: int = 0,
    count: int | None = None,
    skip_bad: bool = False,
    stride: int = 1,
) -> tuple[Selection, list[Skipped]]:
    """Choose a range of frames, and leave out of it what cannot be used where that is asked for.

    Parameters
    ----------
    sequence : ImageSequence
        The whole sequence.
    start : int
        First frame.
    count : int, optional
        Choose among so many frames from there, or as many as there are.
    skip_bad : bool
        Leave frames out that cannot be read, those that lack a pose where others have one, and those whose
        time does not advance. Every image is decoded once more for it.
    stride : int
        Only every so many-th frame.

    Returns
    -------
    chosen : Selection
        The frames.
    skipped : list of Skipped
        Those left out.

    Raises
    ------
    DataError
        If there is no such start or stride, or fewer than two frames are left.
    """
    if not 0 <= start < len(sequence):
        raise DataError(f"{sequence.name}: no frame {start} to start at, there are {len(sequence)} frames")
    if stride < 1:
        raise DataError(f"a stride must be at least 1 frame, not {stride}")
    frames = range(start, len(sequence) if count is None else min(start + count, len(sequence)), stride)
    numbers = sequence.numbers if isinstance(sequence, Selection) else np.arange(len(sequence))
    kept, skipped, last = [], [], -np.inf
    for k in frames:
        reason = _reason(sequence, k, last) if skip_bad else ""
        if reason:
            skipped.append(Skipped(int(numbers[k]), reason))
            continue
        with suppress(MissingFieldError):
            last = sequence.timestamp(k) if skip_bad else last
        kept.append(k)
    if skip_bad and len(kept) < 2:
        first = f" (frame {skipped[0].frame}: {skipped[0].reason})" if skipped else ""
        raise DataError(f"{sequence.name}: {len(kept)} of {len(frames)} frames can be used{first}")
    return Selection(sequence, kept), skipped


def usable(sequence: ImageSequence) -> tuple[ImageSequence, list[Skipped]]:
    """All frames of a sequence that can be used, and those left out; isolated pairs stay as they are.

    Raises
    ------
    DataError
        If fewer than two frames are left.
    """
    if getattr(sequence, "isolated_pairs", False):
        return sequence, []
    return select_frames(sequence, skip_bad=True)


def whole_pair(sequence: ImageSequence, k: int) -> tuple[ImageSequence, int]:
    """ImageSequence and frame that flow on disk is numbered by, for the pair of frames k and k + 1."""
    if not isinstance(sequence, Selection):
        return sequence, k
    first, second = (int(f) for f in sequence.frames[k : k + 2])
    return whole_pair(sequence.whole, first) if second == first + 1 else (sequence, k)


def _reason(sequence: ImageSequence, k: int, last: float) -> str:
    """Why a frame cannot be used, or nothing."""
    time = np.nan
    try:
        sequence.image(k)
        with suppress(MissingFieldError):
            sequence.T_n_c(k)
        with suppress(MissingFieldError):
            time = sequence.timestamp(k)
    except DataError as error:
        return str(error)
    if np.isnan(time) or last < time < np.inf:
        return ""
    return f"time does not advance: {time_text(time)} s after {time_text(last)} s"
