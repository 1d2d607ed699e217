"""True poses from a file of their own, for a sequence that has none or others."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform

from flowlik.datasets._euroc_files import read_T_b_c
from flowlik.datasets.base import NO_TIMES, ImageSequence, frame_index, notes_of
from flowlik.datasets.next_frame import motion_to_next, true_flow
from flowlik.datasets.selection import Selection
from flowlik.errors import DataError, MissingFieldError
from flowlik.geometry.pose_table import PoseTable, read_pose_table
from flowlik.geometry.times import check_times, mutual, time_text

TOLERANCE_S = 0.02
"""Image and pose further apart in time are not of one instant."""


class WithTruth(Selection):
    """The frames of a sequence that a file of poses knows, with these poses.

    Parameters
    ----------
    whole : ImageSequence
        The sequence.
    frames : int array (N,)
        Increasing frame numbers of it, at least one.
    poses : RigidTransform of N
        Their true poses.
    path : Path
        Where these are from.

    Raises
    ------
    DataError
        If the sequence has no such frames.
    """

    measured_truth = True

    def __init__(
        self, whole: ImageSequence, frames: NDArray[np.int64], poses: RigidTransform, path: Path
    ) -> None:
        super().__init__(whole, list(map(int, frames)))
        self._poses = poses
        self.notes = notes_of(whole)
        if left := len(whole) - len(frames):
            self.notes += (f"{path}: {left} of {len(whole)} images have no pose there and are left out",)

    def T_n_c(self, k: int) -> RigidTransform:
        """Return the true pose of frame k, which takes points in {c} to points in {n} [m].

        Raises
        ------
        DataError
            If there is no such frame.
        """
        return self._poses[frame_index(self, k)]

    def flow(self, k: int) -> NDArray[np.float64]:
        """Return the flow (H, W, 2) [px] of depth and these poses, or without depth the sequence's own."""
        try:
            depth = self.depth(k)
        except MissingFieldError:
            return super().flow(k)
        return true_flow(self.camera, depth, motion_to_next(self, k))


def with_truth(sequence: ImageSequence, path: Path, lenient: bool = False) -> WithTruth:
    """Give a sequence the poses of a file; frames without a pose are left out.

    Poses with times are matched to the images' times, each to one, within 0.02 s. Poses without are those of
    the images of their numbers, as in the images' names or counted from the first one, whichever more images
    have; or of all images, of which there must be as many, or as many with those missing in between.
    EuRoC's poses of the body become the left camera's by ``cam0/sensor.yaml`` beside their folder.

    Parameters
    ----------
    sequence : ImageSequence
        The sequence.
    path : Path
        File of poses, see `flowlik.geometry.pose_table`.
    lenient : bool
        Sort rows whose times or numbers go back, and leave double ones out.

    Raises
    ------
    DataError
        If the file cannot be read, does not fit the sequence, or has poses of a body that no file takes to a
        camera.
    """
    table = read_pose_table(path, lenient)
    if table.of_body:
        table = _of_camera(table, path)
    frames, rows = _matched(sequence, table, path)
    if len(frames) < 2:
        raise DataError(f"{path}: poses of {len(frames)} of the {len(sequence)} images of {sequence.name}")
    return WithTruth(sequence, frames, table.poses[rows], path)


def _matched(
    sequence: ImageSequence, table: PoseTable, path: Path
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Frames that have a pose, and its row."""
    count = len(sequence)
    if table.times_s is not None:
        if getattr(sequence, "times_source", None) == NO_TIMES:
            raise DataError(f"{path}: poses have times, but the images of {sequence.name} have none: --fps")
        times_s = np.array([sequence.timestamp(k) for k in range(count)])
        check_times(times_s, sequence.name)
        found = mutual(times_s, table.times_s, TOLERANCE_S)
        frames = np.flatnonzero(found >= 0)
        if not len(frames):
            spans = (f"{time_text(t[0])} to {time_text(t[-1])} s" for t in (times_s, table.times_s))
            text = "images are of {}, poses of {}".format(*spans)
            raise DataError(f"{path}: no pose within {TOLERANCE_S} s of an image of {sequence.name}: {text}")
        return frames, found[frames]
    every = np.arange(count)
    places = getattr(sequence, "places", every)
    if table.frames is not None:
        by_number, by_place = (
            np.intersect1d(numbers, table.frames, return_indices=True)[1:]
            for numbers in (getattr(sequence, "frame_numbers", places), places)
        )
        return by_number if len(by_number[0]) >= len(by_place[0]) else by_place
    if len(table) not in (count, places[-1] + 1):
        raise DataError(f"{path}: {len(table)} poses for the {count} images of {sequence.name}")
    return every, every if len(table) == count else places


def _of_camera(table: PoseTable, path: Path) -> PoseTable:
    sensor = path.resolve().parent.parent / "cam0" / "sensor.yaml"
    if not sensor.is_file():
        raise DataError(
            f"{path}: poses of the robot's body, and no {sensor} says where the camera is on it; "
            "give the camera's poses (TUM format)"
        )
    return replace(table, poses=table.poses * read_T_b_c(sensor), of_body=False)
