import numpy as np
import pytest

from flowlik.egomotion import mle
from flowlik.likelihood.likelihood import FlowLikelihood
from flowlik.measurement.halves import halves
from flowlik.self_supervision import errors_against, half_motions
from tests.helpers import CAMERA, random_motion
from tests.self_supervision.scenes import SIZE_PX, seen_pair


def distances(T, m):
    """Signed distances of end points to their epipolar lines, by the fundamental matrix."""
    t = T.translation
    cross = np.array([[0, -t[2], t[1]], [t[2], 0, -t[0]], [-t[1], t[0], 0]])
    K = np.array([[CAMERA.fx, 0, CAMERA.cx], [0, CAMERA.fy, CAMERA.cy], [0, 0, 1]])
    F = np.linalg.inv(K).T @ cross @ T.rotation.as_matrix() @ np.linalg.inv(K)
    begin, end = (np.column_stack([p, np.ones(len(p))]) for p in (m.pixels, m.pixels + m.flow))
    lines = begin @ F.T
    return (end * lines).sum(axis=1) / np.linalg.norm(lines[:, :2], axis=1)


def test_each_half_is_held_against_the_motion_given_for_it():
    rng = np.random.default_rng(0)
    pair, motions = seen_pair(rng, 300), [random_motion(rng), random_motion(rng)]
    found = errors_against(pair.residuals(), motions, ("texture", "flow-along"))
    m = pair.measurements
    parts = [(T, m.select(half)) for T, half in zip(motions, halves(m.pixels))]
    expected = np.concatenate([distances(T, part) for T, part in parts])
    np.testing.assert_allclose(np.abs(found.z), np.abs(expected), rtol=1e-6, atol=1e-9)
    np.testing.assert_array_equal(found.measurements.pixels, np.concatenate([p.pixels for _, p in parts]))
    along = (found.measurements.flow * found.directions).sum(axis=1)
    np.testing.assert_allclose(found.values["flow-along"], np.abs(along))
    np.testing.assert_array_equal(found.sign, np.where(along < 0, -1, 1))


def test_known_depth_gives_both_components_of_a_vector():
    rng = np.random.default_rng(1)
    T = random_motion(rng, 1.0, 0.6)
    pair = seen_pair(rng, 300, T, depth=True)
    found = errors_against(pair.residuals(), (T, T), ("texture",))
    m = found.measurements
    assert found.z.shape == (2 * len(m),)
    np.testing.assert_allclose(found.values["texture"].reshape(-1, 2), m.t)
    # the law of the errors is isotropic
    size = np.abs(found.z).reshape(-1, 2) / m.signals["residual"][:, None]
    assert size.mean() == pytest.approx(SIZE_PX, rel=0.3)


def test_errors_in_and_out_of_fit_bracket_the_true_ones():
    """With few vectors a motion bends towards its own, and away from the others."""
    rng = np.random.default_rng(2)
    estimator = mle(FlowLikelihood.constant_gaussian(0.3))
    squares = []
    for number in range(30):
        T = random_motion(rng, 1.0, 0.6)
        pair = seen_pair(rng, 60, T)
        residuals = pair.residuals()
        first, second = (m.T_k_prev for m in half_motions(estimator, residuals, (0, number), (T, T)))
        unit = [
            errors_against(residuals, motions, ()).z for motions in ((first, second), (T, T), (second, first))
        ]
        squares.append([np.sum(z**2) for z in unit])
    own, true, crossed = np.median(squares, axis=0)
    assert own < 0.95 * true
    assert crossed > 1.05 * true
