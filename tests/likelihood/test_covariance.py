"""The Gaussian whose ellipse holds a level, held against errors drawn from the model."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from flowlik.errors import ModelError
from flowlik.flow import Farneback, describe
from flowlik.likelihood.likelihood import FlowLikelihood
from flowlik.measurement.measurements import Measurements, TextureDefinition
from tests.helpers import KNOTS, lcm_likelihood
from tests.likelihood.test_likelihood import MODELS, every_model


def drawn(count: int, rng: np.random.Generator) -> Measurements:
    """Measurements of random texture, within and beyond the knots, and random directions."""
    angle = rng.uniform(0, 2 * np.pi, count)
    c, s = np.cos(angle), np.sin(angle)
    R_i_e = np.moveaxis(np.array([[c, -s], [s, c]]), -1, 0)
    t = np.sort(np.exp(rng.uniform(KNOTS[0] - 1, KNOTS[-1] + 1, (count, 2))), axis=1)[:, ::-1]
    zero = np.zeros((count, 2))
    return Measurements(zero, zero, R_i_e, t, TextureDefinition(), describe(Farneback()))


def squared_distance(covariance, error):
    return (error * np.linalg.solve(covariance, error[..., None])[..., 0]).sum(axis=-1)


@every_model
@pytest.mark.parametrize("level", [0.5, 0.9, 0.99])
def test_the_ellipse_holds_its_share_of_errors_whatever_their_texture(model, level):
    rng = np.random.default_rng(7)
    m = drawn(20_000, rng)
    z = model.sample(model.coordinate(m), rng)
    error = np.einsum("nij,nj->ni", m.R_i_e, z)
    inside = squared_distance(model.covariance(m, level), error) <= stats.chi2(2).ppf(level)
    for some in np.array_split(np.argsort(m.t[:, 0] / m.t[:, 1]), 4):  # alike to far apart
        assert stats.binomtest(int(inside[some].sum()), len(some), level).pvalue > 1e-4


def test_of_a_gaussian_it_is_the_gaussians_own():
    m = drawn(50, np.random.default_rng(0))
    model = FlowLikelihood(MODELS[0].family, MODELS[0].schedule)
    gaussian = next(model for model in MODELS if model.family.name == "gaussian")
    sigma = gaussian.schedule.theta(gaussian.coordinate(m))[0]
    expected = np.einsum("nij,nj,nkj->nik", m.R_i_e, sigma**2, m.R_i_e)
    for level in (0.5, 0.9):
        np.testing.assert_allclose(gaussian.covariance(m, level), expected, rtol=1e-2, atol=1e-9)
    assert not np.allclose(model.covariance(m, 0.5), model.covariance(m, 0.9), rtol=0.1)


def test_it_is_the_images_and_not_the_eigenbasis():
    m = drawn(1, np.random.default_rng(0))
    turned = replace(m, R_i_e=np.array([[[0.0, -1.0], [1.0, 0.0]]]))
    upright = replace(m, R_i_e=np.eye(2)[None])
    model = lcm_likelihood(method=describe(Farneback()))
    (a,), (b,) = model.covariance(turned), model.covariance(upright)
    np.testing.assert_allclose(np.diag(a), np.diag(b)[::-1], rtol=1e-12)
    assert b[0, 0] < b[1, 1]  # more texture along e1


def test_a_model_of_epipolar_errors_alone_has_none():
    model = lcm_likelihood(method=describe(Farneback()), residual="epipolar")
    with pytest.raises(ModelError, match="across epipolar lines"):
        model.covariance(drawn(3, np.random.default_rng(0)))


@pytest.mark.parametrize("level", [0.0, 1.0, 90])
def test_an_impossible_level_is_refused(level):
    with pytest.raises(ModelError, match="between 0 and 1"):
        MODELS[0].covariance(drawn(3, np.random.default_rng(0)), level)


def test_a_constant_schedule_has_one_too():
    constant = FlowLikelihood.constant_gaussian(0.5).covariance(drawn(4, np.random.default_rng(1)))
    np.testing.assert_allclose(constant, np.tile(0.25 * np.eye(2), (4, 1, 1)), rtol=2e-3, atol=1e-9)
