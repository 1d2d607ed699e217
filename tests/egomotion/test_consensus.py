"""What counts in a consensus without depth."""

from dataclasses import replace

import numpy as np
import pytest

from flowlik.egomotion import Epipolar, Status, lcmsac, mle
from flowlik.geometry.motion import h, inverse_range
from tests.helpers import CAMERA, lcm_likelihood, make_scene, normalised, random_motion, tangent_error

MODEL = lcm_likelihood()


@pytest.mark.parametrize("estimator", [lcmsac(MODEL), mle(MODEL)], ids=lambda e: e.name)
def test_vectors_that_know_little_do_not_outvote_those_that_know(estimator):
    """Two thirds follow another motion, and say by their texture that they may be pixels off."""
    rng = np.random.default_rng(0)
    T, other = random_motion(rng, 1.0, 0.5), random_motion(rng, 6.0, 0.5)
    scene = make_scene(T, rng, n=600)
    m, vague = scene.measurements, np.arange(600) >= 200
    astray = h(other, CAMERA, m.pixels, inverse_range(CAMERA, m.pixels, scene.depth))
    texture = np.where(vague[:, None], 0.1, 2000.0) * np.ones((600, 2))
    flow = np.where(vague[:, None], astray + rng.normal(0, 1.0, (600, 2)), m.flow)
    found = estimator.estimate(Epipolar.of(replace(m, t=texture, flow=flow), CAMERA), seed=1)
    assert found.status is Status.SOLVED
    truth = normalised(scene.epipolar, T.as_matrix()[:3])
    error = tangent_error(found.T_k_prev, found.T_k_prev.from_matrix(np.vstack([truth, [0, 0, 0, 1]])))
    assert np.abs(error).max() < 0.01


def test_where_none_knows_all_count():
    rng = np.random.default_rng(1)
    scene = make_scene(random_motion(rng, 2.0, 0.5), rng, n=400, likelihood=MODEL)
    m = replace(scene.measurements, t=np.full((400, 2), 0.1))
    assert lcmsac(MODEL).estimate(Epipolar.of(m, CAMERA), seed=0).inliers > 200
