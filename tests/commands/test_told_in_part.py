"""What the warnings of a run say of frames that the images did not tell whole."""

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import RigidTransform

from flowlik.commands._odometry_results import _told_in_part
from flowlik.egomotion import EgoMotion, Status

SOLVED = EgoMotion(RigidTransform.identity(), np.eye(6), np.eye(6), Status.SOLVED)


def test_each_kind_has_a_sentence_with_its_count():
    turned = replace(SOLVED, status=Status.DEGENERATE)
    lost = replace(turned, predicted=True)
    plane = replace(SOLVED, status=Status.AMBIGUOUS, alternative=SOLVED)
    predicted, rotations, planes = _told_in_part([SOLVED, turned, turned, lost, plane, plane, plane])
    assert predicted.startswith("1 of 7 frames could not be solved and were predicted")
    assert rotations.startswith("2 of 7 frames told their rotation alone")
    assert planes.startswith("3 of 7 frames have two motions")
    assert _told_in_part([SOLVED]) == []
