"""Frames between which the image has moved."""

import numpy as np
import pytest

from flowlik.datasets._frames import Lacking
from flowlik.datasets.selection import select_frames
from flowlik.errors import DataError
from flowlik.flow import FlowFiles, LucasKanade
from flowlik.odometry.keyframes import moving_frames
from tests.datasets.fakes import picture


class Shifted(Lacking):
    """A picture that is shifted to the left by so many pixels in each frame."""

    name = "shifted"

    def __init__(self, shifts):
        self.shifts = shifts

    def __len__(self):
        return len(self.shifts)

    def image(self, k):
        return np.ascontiguousarray(picture(0, 200, 80)[:, self.shifts[k] : self.shifts[k] + 100])


def chosen(shifts, parallax_px):
    sequence, _ = select_frames(Shifted(shifts))
    return moving_frames(sequence, LucasKanade(), parallax_px).frames.tolist()


def test_frames_are_left_out_until_the_median_flow_exceeds_the_length():
    shifts = [0, 1, 2, 3, 4, 5, 6, 7, 8]
    assert chosen(shifts, 0.5) == list(range(9))
    assert chosen(shifts, 2.5) == [0, 3, 6]
    assert chosen(shifts, 3.5) == [0, 4, 8]


def test_a_standstill_is_passed_over():
    assert chosen([0, 0, 0, 2, 2, 2, 4, 4], 1.0) == [0, 3, 6]
    with pytest.raises(DataError, match="shifted: in no frame the image has moved by 1 px"):
        chosen([0, 0, 0], 1.0)


def test_frames_chosen_before_are_chosen_from():
    sequence, _ = select_frames(Shifted([0, 1, 2, 3, 4, 5, 6, 7, 8]), 1, stride=2)
    found = moving_frames(sequence, LucasKanade(), 2.5)
    assert (found.frames.tolist(), found.whole) == ([1, 5], sequence.whole)


def test_what_cannot_be_is_refused(tmp_path):
    sequence, _ = select_frames(Shifted([0, 1]))
    for parallax_px in (0, -1, float("nan"), float("inf")):
        with pytest.raises(DataError, match="must be a positive length"):
            moving_frames(sequence, LucasKanade(), parallax_px)
    with pytest.raises(DataError, match="flow on disk is that of neighbouring frames"):
        moving_frames(sequence, FlowFiles("a", tmp_path), 1.0)
