"""Public functions called from several threads at once give what they give one after another."""

from concurrent.futures import ThreadPoolExecutor

import cv2
import numpy as np
import pytest

import flowlik
from flowlik.datasets import open_sequence
from flowlik.image.texture import eigenbasis, structure_tensor
from tests.helpers import CAMERA, lcm_likelihood, make_scene, random_motion, textured_image

THREADS = 6


def in_threads(function, arguments):
    with ThreadPoolExecutor(THREADS) as pool:
        return list(pool.map(function, arguments))


@pytest.fixture(scope="module")
def pairs():
    return [
        (textured_image((60, 80), seed), textured_image((60, 80), seed, (0.7, -0.4))) for seed in range(6)
    ]


@pytest.mark.parametrize("method", [flowlik.LucasKanade(), flowlik.Farneback(), flowlik.DIS()])
def test_flow_and_texture(pairs, method):
    def measured(pair):
        m = flowlik.measure(*pair, method)
        return m.pixels, m.flow, m.t, eigenbasis(structure_tensor(pair[0]))[0]

    alone = [measured(pair) for pair in pairs]
    for found, expected in zip(in_threads(measured, pairs * 2), alone * 2):
        for mine, theirs in zip(found, expected):
            np.testing.assert_array_equal(mine, theirs)


def test_likelihood_and_estimation():
    model = lcm_likelihood()  # its tables are compiled by whoever comes first
    scenes = [make_scene(random_motion(np.random.default_rng(k)), np.random.default_rng(k)) for k in range(4)]

    def estimated(scene):
        motion = flowlik.lcmsac(model).estimate(scene.known_depth, seed=3)
        z, x = np.linspace(-3, 3, 50), np.linspace(-2, 7, 50)
        values = [f(z, x) for f in (model.log_prob, model.score, model.weight)]
        return [motion.T_k_prev.as_matrix(), motion.covariance, model.bound(x, 0.9), model.fisher(x), *values]

    in_parallel = in_threads(estimated, scenes * 2)
    alone = [estimated(scene) for scene in scenes] * 2
    for found, expected in zip(in_parallel, alone):
        for mine, theirs in zip(found, expected):
            np.testing.assert_array_equal(mine, theirs)


def test_one_sequence_read_by_many(tmp_path):
    for k in range(12):
        cv2.imwrite(str(tmp_path / f"{k}.png"), textured_image((48, 64), k))
    writer = cv2.VideoWriter(str(tmp_path / "walk.avi"), cv2.VideoWriter_fourcc(*"MJPG"), 20, (64, 48))
    for k in range(12):
        writer.write(cv2.cvtColor(textured_image((48, 64), k), cv2.COLOR_GRAY2BGR))
    writer.release()
    for path in (tmp_path, tmp_path / "walk.avi"):
        alone, shared = open_sequence(path), open_sequence(path)
        expected = [alone.image(k) for k in range(12)]
        order = [(7 * i) % 12 for i in range(48)]
        for k, image in zip(order, in_threads(shared.image, order)):
            np.testing.assert_array_equal(image, expected[k])


def test_odometries_side_by_side(pairs):
    def positions(seed):
        camera = flowlik.Pinhole(80, 60, 60.0, 60.0, 39.5, 29.5)
        robot = flowlik.Odometry(camera, flowlik.LucasKanade(), flowlik.ransac(), seed)
        for k, image in enumerate(pairs[seed]):
            robot.step(image, float(k), np.full((60, 80), 2.0))
        return robot.poses[-1].as_matrix()

    alone = [positions(seed) for seed in range(6)]
    np.testing.assert_array_equal(in_threads(positions, range(6)), alone)


def test_camera_is_immutable():
    with pytest.raises(AttributeError):
        CAMERA.fx = 1.0
