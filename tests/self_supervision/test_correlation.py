import numpy as np
import pytest

from flowlik.likelihood.likelihood import FlowLikelihood
from flowlik.self_supervision import MotionErrors
from flowlik.self_supervision._correlation import scalar_correlation
from flowlik.self_supervision.readings import effective_number
from tests.helpers import make_scene, random_motion

SHARE, SCALE_PX = 0.4, 64.0


def errors_with_shared_part(rng, n=200):
    """Errors of unit variance along random directions, of which neighbours share a part of any direction."""
    m = make_scene(random_motion(rng), rng, n).measurements
    distance = np.linalg.norm(m.pixels[:, None] - m.pixels[None], axis=-1)
    root = np.linalg.cholesky(np.exp(-(distance**2) / (2 * SCALE_PX**2)) + 1e-9 * np.eye(n))
    shared = np.sqrt(SHARE) * root @ rng.standard_normal((n, 2))
    angle = rng.uniform(0, 2 * np.pi, n)
    directions = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    z = (shared * directions).sum(axis=1) + np.sqrt(1 - SHARE) * rng.standard_normal(n)
    return MotionErrors(z, directions, {"texture": m.t[:, 0]}, m)


def test_a_correlation_comes_back_from_scalar_errors():
    rng = np.random.default_rng(0)
    model = FlowLikelihood.constant_gaussian(1.0)
    found = scalar_correlation(
        model, (errors_with_shared_part(rng) for _ in range(60)), np.array([0.0, 0.01, 0.02]), seed=0
    )
    distance = np.array([10.0, 32.0, 64.0, 128.0])
    # what is of any direction, and half of what is of one, is what two random directions share
    isotropic, along, vertical = found.at(distance)
    expected = SHARE * np.exp(-(distance**2) / (2 * SCALE_PX**2)) + 0.5 * (0.01 + 0.02)
    np.testing.assert_allclose(isotropic + 0.5 * (along + vertical), expected, atol=0.05)
    # whole-image weights are those given, and the variance is that of the scores
    assert (found.along[-1], found.vertical[-1]) == (0.01, 0.02)
    own = found.at(np.zeros(1)).T @ [1, 0.5, 0.5]
    assert own == pytest.approx([1.0], abs=0.05)


def test_independent_numbers_of_a_series():
    rng = np.random.default_rng(1)
    white, rho = rng.standard_normal(4000), 0.8
    series = np.zeros(4000)
    for i in range(1, 4000):
        series[i] = rho * series[i - 1] + white[i]
    assert effective_number(white) == pytest.approx(4000, rel=0.15)
    assert effective_number(series) == pytest.approx(4000 * (1 - rho) / (1 + rho), rel=0.3)
    assert effective_number(np.ones(7)) == 7
