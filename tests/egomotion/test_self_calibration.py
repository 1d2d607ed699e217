from dataclasses import replace

import cv2
import numpy as np
import pytest

from flowlik.camera import Distortion
from flowlik.egomotion import Epipolar, mle
from flowlik.egomotion.self_calibration import Intrinsics, SelfCalibration
from tests.helpers import CAMERA, lcm_likelihood, make_scene, random_motion

MODEL = lcm_likelihood()
SETTINGS = SelfCalibration((("cx", 4.0), ("k1", 0.02)), temper=0.1)
TRUE = replace(CAMERA, cx=CAMERA.cx - 4)
DISTORTION = Distortion(-0.015)


def test_distortion_is_opencvs_and_undone():
    points = np.random.default_rng(0).uniform(-0.9, 0.9, (50, 2))
    d = Distortion(-0.05, 0.01)
    rays = np.column_stack([points, np.ones(50)])
    expected, _ = cv2.projectPoints(
        rays, np.zeros(3), np.zeros(3), np.eye(3), np.array([-0.05, 0.01, 0, 0.0])
    )
    np.testing.assert_allclose(d.distort(points), expected[:, 0], atol=1e-12)
    np.testing.assert_allclose(d.undistort(d.distort(points)), points, atol=1e-9)
    np.testing.assert_array_equal(Distortion().undistort(points), points)
    np.testing.assert_array_equal(d.undistort(np.zeros((1, 2))), 0)


def test_a_distance_is_stretched_as_it_is_seen():
    rng, d, step = np.random.default_rng(1), Distortion(-0.05, 0.01), 1e-6
    points, angle = rng.uniform(-0.9, 0.9, (50, 2)), rng.uniform(0, 2 * np.pi, 50)
    normals = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    along = np.stack([-np.sin(angle), np.cos(angle)], axis=-1)
    line = d.distort(points + step * along) - d.distort(points - step * along)
    away = d.distort(points + step * normals) - d.distort(points)
    expected = np.abs(line[:, 0] * away[:, 1] - line[:, 1] * away[:, 0]) / np.linalg.norm(line, axis=1) / step
    np.testing.assert_allclose(d.stretch(points, normals), expected, rtol=1e-5)


def as_seen(m):
    """Measurements of the nominal camera as a camera with other intrinsics sees them."""

    def seen(pixels):
        rays = CAMERA.rays(pixels)
        rays[:, :2] = DISTORTION.distort(rays[:, :2])
        return TRUE.v2p(rays)

    begin, end = seen(m.pixels), seen(m.pixels + m.flow)
    return replace(m, pixels=begin, flow=end - begin)


def test_rectified_measurements_are_those_of_a_pinhole():
    scene = make_scene(random_motion(np.random.default_rng(0)), np.random.default_rng(1), n=50)
    known = Intrinsics.prior(CAMERA, SETTINGS)
    known = replace(known, values=np.array([-4.0, -0.015]))
    assert (known.camera, known.distortion) == (TRUE, DISTORTION)
    m = known.rectified(as_seen(scene.measurements))
    expected = CAMERA.rays(scene.measurements.pixels)
    np.testing.assert_allclose(known.camera.rays(m.pixels), expected, atol=1e-9)


@pytest.fixture(scope="module")
def states():
    """Intrinsics after each of forty frames of a camera other than it is thought to be."""
    rng, estimator = np.random.default_rng(2), mle(MODEL)
    states = [Intrinsics.prior(CAMERA, SETTINGS)]
    for k in range(40):
        m = as_seen(make_scene(random_motion(rng, 2.0, 0.5), rng, n=300, likelihood=MODEL).measurements)
        state = states[-1]
        found = estimator.estimate(Epipolar.of(state.rectified(m), state.camera), seed=k)
        states.append(state.updated(m, found.T_k_prev.as_matrix()[:3], MODEL))
    return states


def test_intrinsics_are_found_from_flow_alone(states):
    last, truth = states[-1], np.array([-4.0, -0.015])
    assert last.frames == 40
    assert (np.abs(last.values - truth) < 0.3 * np.abs(truth)).all()
    assert (np.abs(last.values - truth) < 4 * last.sigma).all()


def test_they_become_more_certain_but_never_for_good(states):
    sigmas = np.array([s.sigma for s in states])
    assert (np.diff(sigmas[:20], axis=0) < 0).all()
    still = states[-1]._after(np.zeros((2, 2)), np.zeros(2))
    assert (still.sigma > states[-1].sigma).all()
    np.testing.assert_array_equal(still.values, states[-1].values)
