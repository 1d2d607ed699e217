import numpy as np
import pytest

from epipolar_refinement import (
    log_convolution,
    profile_depths,
    refine_convolution,
    refine_profile,
)
from flowlik.egomotion import mle
from flowlik.geometry import motion
from tests.helpers import CAMERA, lcm_likelihood, make_scene, normalised, random_motion

MODEL = lcm_likelihood()


@pytest.mark.parametrize("angle", [0.0, 0.3, 0.8, 1.4, np.pi / 2])
def test_the_convolution_is_the_density_of_the_sum(angle):
    rng = np.random.default_rng(0)
    x, c = np.log([800.0, 2.0]), np.array([np.cos(angle), np.sin(angle)])
    z = MODEL.sample(np.tile(x, (400_000, 1)), rng) @ c
    edges = np.concatenate([[0.0], np.geomspace(0.01, 50, 30)])
    found = np.histogram(np.abs(z), edges)[0]
    # the mean density over a bin by Gauss-Legendre in it
    node, weight = np.polynomial.legendre.leggauss(8)
    at = (edges[:-1, None] + edges[1:, None]) / 2 + np.diff(edges)[:, None] / 2 * node
    flat = at.ravel()
    p = np.exp(log_convolution(MODEL, flat, np.tile(x, (len(flat), 1)), np.tile(c, (len(flat), 1))))
    expected = len(z) * np.diff(edges) * (p.reshape(at.shape) @ weight)
    error = (found - expected) / np.sqrt(np.maximum(expected, 1.0))
    assert np.abs(error).max() < 4.5


def test_the_profile_finds_the_true_depths_of_exact_flow():
    rng = np.random.default_rng(1)
    scene = make_scene(random_motion(rng), rng, n=200)
    T = normalised(scene.epipolar, scene.T.as_matrix()[:3])
    x = MODEL.schedule.index.of(scene.measurements)
    rho, z = profile_depths(scene.epipolar, MODEL, T, x)
    true = motion.inverse_range(CAMERA, scene.measurements.pixels, scene.depth)
    true = true * np.linalg.norm(scene.T.translation)
    np.testing.assert_allclose(rho, true, rtol=1e-3)
    np.testing.assert_allclose(z, 0, atol=1e-3)


@pytest.mark.parametrize("refine", [refine_convolution, refine_profile])
def test_the_other_likelihoods_end_near_the_truth(refine):
    rng = np.random.default_rng(2)
    scene = make_scene(random_motion(rng), rng, n=400, likelihood=MODEL)
    truth = normalised(scene.epipolar, scene.T.as_matrix()[:3])
    begin = mle(MODEL).estimate(scene.epipolar).T_k_prev.as_matrix()[:3]
    away = normalised(
        scene.epipolar, (random_motion(rng, 0.05, 0.005).as_matrix() @ np.vstack([begin, [0, 0, 0, 1]]))[:3]
    )
    found = refine(scene.epipolar, MODEL, away)
    noise = np.abs(begin - truth).max()
    assert np.abs(found - truth).max() < 3 * noise + 1e-3
