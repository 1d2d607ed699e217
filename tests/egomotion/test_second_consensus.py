"""Vectors that agree on a motion of their own are no errors: both motions are in the result."""

from dataclasses import replace

import numpy as np
import pytest

from flowlik.egomotion import KnownDepth, Status, lcmsac
from tests.helpers import CAMERA, make_scene, random_motion, tangent_error

from .test_estimator import MODEL


def two_motions(share, seed):
    """Scene of one motion, a share of whose vectors follows another; both motions."""
    motions = [random_motion(np.random.default_rng(10 * seed + i), 1.5, 0.4) for i in (0, 1)]
    first, second = (make_scene(T, np.random.default_rng(seed), 600, MODEL) for T in motions)
    flow = first.measurements.flow.copy()
    other = np.random.default_rng(seed).random(600) < share
    flow[other] = second.measurements.flow[other]
    return replace(first.measurements, flow=flow), first.depth, first.T, second.T


@pytest.mark.parametrize(("share", "seed"), [(0.4, 1), (0.6, 2)])
def test_the_true_motion_is_one_of_two(share, seed):
    m, depth, T, other = two_motions(share, seed)
    result = lcmsac(MODEL).estimate(KnownDepth.of(m, CAMERA, depth))
    assert result.status is Status.AMBIGUOUS
    assert "two motions" in result.reason
    for truth in (T, other):
        errors = [tangent_error(found.T_k_prev, truth) for found in (result, result.alternative)]
        nearest = min(errors, key=np.linalg.norm)
        assert np.linalg.norm(nearest[:3]) < np.deg2rad(0.2)
        assert np.linalg.norm(nearest[3:]) < 0.02


@pytest.mark.parametrize("kind", ["depth", "epipolar"])
def test_errors_do_not_agree(kind):
    rng = np.random.default_rng(5)
    scene = make_scene(random_motion(rng, 1.5, 0.4), rng, 600, MODEL, outliers=0.45)
    residual = scene.known_depth if kind == "depth" else scene.epipolar
    result = lcmsac(MODEL).estimate(residual)
    assert (result.status, result.alternative) == (Status.SOLVED, None)
