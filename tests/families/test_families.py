from itertools import pairwise

import numpy as np
import pytest
from scipy import stats
from scipy.integrate import quad

from flowlik.errors import ModelError
from flowlik.families import FAMILIES, error_family
from tests.helpers import finite_difference

# parameters that calibrations give: sharp, usual, broad
THETA = {
    "lcm": [(2 / np.pi * np.arctan(40.0), 0.05, 0.8), (0.9, 0.3, 0.6), (0.4, 5.0, 0.2)],
    "log-logistic": [(0.02, 1.4), (0.2, 2.5), (3.0, 0.7)],
    "gaussian": [(0.05,), (0.5,), (8.0,)],
}
FLOOR_PX = 1e-4
Z = np.concatenate([-np.geomspace(1e-3, 1e3, 40), np.geomspace(1e-3, 1e3, 40)])

CASES = [
    pytest.param(family, np.array(theta), id=f"{name}{i}")
    for name, family in FAMILIES.items()
    for i, theta in enumerate(THETA[name])
]
every_case = pytest.mark.parametrize(("family", "theta"), CASES)


def by_scipy(family, theta):
    """Log-density and distribution function of abs(z) from scipy's distributions."""
    if family.name == "gaussian":
        parts = [(1.0, stats.halfnorm(scale=theta[0]))]
    elif family.name == "log-logistic":
        parts = [(1.0, stats.fisk(theta[1], scale=theta[0]))]
    else:
        rate, gamma, weight = np.tan(np.pi / 2 * theta[0]), theta[1], theta[2]
        parts = [(weight, stats.expon(scale=1 / rate)), (1 - weight, stats.halfcauchy(scale=gamma))]
    return (
        lambda z: np.logaddexp.reduce([np.log(w) + d.logpdf(z) for w, d in parts]),
        lambda z: sum(w * d.cdf(z) for w, d in parts),
    )


@every_case
def test_density_and_distribution_agree_with_scipy(family, theta):
    logpdf, cdf = by_scipy(family, theta)
    z = np.geomspace(FLOOR_PX * 1.01, 1e3, 100)
    np.testing.assert_allclose(family.logpdf(z, theta), logpdf(z) - np.log(2), rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(family.pdf(z, theta), np.exp(logpdf(z)) / 2, rtol=1e-9, atol=1e-300)
    np.testing.assert_allclose(family.magnitude_cdf(z, theta), cdf(z), rtol=1e-9)
    np.testing.assert_allclose(family.cdf(z, theta), 0.5 + cdf(z) / 2, rtol=1e-9)


@every_case
def test_the_density_is_symmetric_and_integrates_to_one(family, theta):
    np.testing.assert_array_equal(family.pdf(Z, theta), family.pdf(-Z, theta))
    np.testing.assert_allclose(family.cdf(Z, theta) + family.cdf(-Z, theta), 1, atol=1e-15)
    pieces = np.log([1e-12, FLOOR_PX, 1e-2, 1, 1e2, 1e6, 1e16])
    mass = [
        quad(lambda s: 2 * np.exp(s) * float(family.pdf(np.exp(s), theta)), a, b, epsabs=1e-10, limit=200)[0]
        for a, b in pairwise(pieces)
    ]
    assert sum(mass) == pytest.approx(1, abs=1e-7)


@every_case
def test_the_density_is_the_derivative_of_the_distribution(family, theta):
    z = np.geomspace(2e-6, 1e3, 80)
    step = 1e-5 * z
    slope = (family.magnitude_cdf(z + step, theta) - family.magnitude_cdf(z - step, theta)) / (2 * step)
    np.testing.assert_allclose(family.pdf(z, theta), slope / 2, rtol=1e-6, atol=1e-9)


def test_the_log_logistic_is_averaged_near_zero():
    family = FAMILIES["log-logistic"]
    for theta in np.array(THETA["log-logistic"]):
        z = np.array([0.0, 3e-5, 0.9999 * FLOOR_PX])
        average = by_scipy(family, theta)[1](FLOOR_PX) / FLOOR_PX
        np.testing.assert_allclose(family.pdf(z, theta), average / 2, rtol=1e-9)
        np.testing.assert_allclose(family.magnitude_cdf(z, theta), average * z, rtol=1e-9)
        np.testing.assert_array_equal(family.gradient(z, theta)[0], 0)


@every_case
def test_quantiles_invert_the_distribution(family, theta):
    p = np.array([1e-4, 0.05, 0.3, 0.5, 0.51, 0.9, 0.9999])
    np.testing.assert_allclose(family.cdf(family.ppf(p, theta), theta), p, atol=1e-12)
    confidence = np.array([0.0, 0.5, 0.9, 0.99])
    bound = family.magnitude_ppf(confidence, theta)
    np.testing.assert_allclose(family.magnitude_cdf(bound, theta), confidence, atol=1e-12)


@every_case
def test_samples_follow_the_distribution(family, theta):
    n = 20_000
    z = family.rvs(theta, n, np.random.default_rng(7))
    # 1.63 / sqrt(n) is exceeded once in a hundred seeds; this one is fixed
    assert stats.kstest(z, lambda z: family.cdf(z, theta)).statistic < 1.63 / np.sqrt(n)
    np.testing.assert_array_equal(z, family.rvs(theta, n, np.random.default_rng(7)))


@every_case
def test_gradients_are_derivatives_of_the_log_density(family, theta):
    by_z, by_theta = family.gradient(Z, theta)
    step = 1e-5 * np.abs(Z)
    numeric = (family.logpdf(Z + step, theta) - family.logpdf(Z - step, theta)) / (2 * step)
    np.testing.assert_allclose(by_z, numeric, rtol=1e-6, atol=1e-6)
    numeric = finite_difference(lambda e: family.logpdf(Z, theta * (1 + e)), np.zeros(len(theta)), 1e-6)
    np.testing.assert_allclose(by_theta * theta[:, None], numeric.T, rtol=1e-6, atol=1e-6)


@every_case
def test_gradients_by_parameters_hold_within_the_floor(family, theta):
    z = np.array([0.0, 1e-5, 9e-5])
    _, by_theta = family.gradient(z, theta)
    numeric = finite_difference(lambda e: family.logpdf(z, theta * (1 + e)), np.zeros(len(theta)), 1e-6)
    np.testing.assert_allclose(by_theta * theta[:, None], numeric.T, rtol=1e-6, atol=1e-6)


@every_case
def test_parameters_may_be_arrays(family, theta):
    stacked = np.stack([theta, 0.9 * theta], axis=1)[:, :, None]
    by_z, by_theta = family.gradient(Z, stacked)
    for i, one in enumerate((theta, 0.9 * theta)):
        np.testing.assert_allclose(family.logpdf(Z, stacked)[i], family.logpdf(Z, one), rtol=1e-12)
        np.testing.assert_allclose(family.cdf(Z, stacked)[i], family.cdf(Z, one), rtol=1e-12)
        np.testing.assert_allclose(by_z[i], family.gradient(Z, one)[0], rtol=1e-12)
        np.testing.assert_allclose(by_theta[:, i], family.gradient(Z, one)[1], rtol=1e-12)
        np.testing.assert_allclose(
            family.magnitude_ppf(0.9, stacked)[i, 0], family.magnitude_ppf(0.9, one), rtol=1e-12
        )


@every_case
def test_links_keep_to_the_bounds_and_are_inverted(family, theta):
    free = np.random.default_rng(0).uniform(-8, 8, (len(theta), 50))
    values = family.to_theta(free)
    for parameter, row in zip(family.parameters, values):
        assert ((row > parameter.lower) & (row < parameter.upper)).all()
    np.testing.assert_allclose(family.to_free(values), free, atol=1e-9)
    np.testing.assert_allclose(family.to_theta(family.to_free(theta)), theta, rtol=1e-12)
    numeric = (family.to_theta(free + 1e-5) - family.to_theta(free - 1e-5)) / 2e-5
    np.testing.assert_allclose(family.link_derivative(free), numeric, rtol=1e-6, atol=1e-10)


@every_case
def test_a_fit_starts_near_the_truth(family, theta):
    magnitude = np.sort(family.sample_magnitude(theta, 50_000, np.random.default_rng(1)))
    start = family.start(magnitude, np.ones(len(magnitude)))
    nll = [-family.logpdf(magnitude, t).mean() for t in (start, theta)]
    assert nll[0] - nll[1] < 0.02


@every_case
def test_a_start_weighs_magnitudes_by_their_counts(family, theta):
    magnitude = np.sort(family.sample_magnitude(theta, 200, np.random.default_rng(2)))
    count = np.random.default_rng(3).integers(1, 5, 200)
    repeated = np.repeat(magnitude, count)
    np.testing.assert_allclose(
        family.start(magnitude, count.astype(float)),
        family.start(repeated, np.ones(len(repeated))),
        rtol=1e-9,
    )


def test_families_are_found_by_name():
    assert all(error_family(name) is family and family.name == name for name, family in FAMILIES.items())
    with pytest.raises(ModelError, match="unknown error family 'student'"):
        error_family("student")
