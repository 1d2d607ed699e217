from itertools import pairwise, product

import numpy as np
import pytest
from scipy import stats
from scipy.integrate import quad

from flowlik.errors import ModelError
from flowlik.likelihood.families import FAMILIES, error_family
from tests.helpers import finite_difference

# parameters that calibrations give: sharp, usual, broad
THETA = {
    "lcm": [(2 / np.pi * np.arctan(40.0), 0.05, 0.8), (0.9, 0.3, 0.6), (0.4, 5.0, 0.2)],
    "log-logistic": [(0.02, 1.4), (0.2, 2.5), (3.0, 0.7)],
    "gaussian": [(0.05,), (0.5,), (8.0,)],
    "laplace": [(0.05,), (0.5,), (8.0,)],
    "student-t": [(0.03, 1.3), (0.5, 4.0), (2.0, 0.7)],
    "glc": [(0.02, 0.06, 0.2, 0.3, 0.6), (0.1, 0.4, 2.0, 0.2, 0.7), (0.4, 3.0, 9.0, 0.1, 0.4)],
}
FLOOR_PX = 1e-4
Z = np.concatenate([-np.geomspace(1e-3, 1e3, 40), np.geomspace(1e-3, 1e3, 40)])

CASES = [
    pytest.param(family, np.array(theta), id=f"{name}{i}")
    for name, family in FAMILIES.items()
    for i, theta in enumerate(THETA[name])
]
every_case = pytest.mark.parametrize(("family", "theta"), CASES)


class HalfT:
    """Magnitude of scipy's Student-t."""

    def __init__(self, scale, nu):
        self.t = stats.t(nu, scale=scale)

    def logpdf(self, z):
        return np.log(2) + self.t.logpdf(z)

    def cdf(self, z):
        return 1 - 2 * self.t.sf(z)


# weights and scipy's distributions of abs(z)
PARTS = {
    "lcm": lambda beta, gamma, w: [
        (w, stats.expon(scale=1 / np.tan(np.pi / 2 * beta))),
        (1 - w, stats.halfcauchy(scale=gamma)),
    ],
    "log-logistic": lambda scale, shape: [(1.0, stats.fisk(shape, scale=scale))],
    "gaussian": lambda sigma: [(1.0, stats.halfnorm(scale=sigma))],
    "laplace": lambda scale: [(1.0, stats.expon(scale=scale))],
    "student-t": lambda scale, nu: [(1.0, HalfT(scale, nu))],
    "glc": lambda sigma, scale, gamma, w_G, v_L: [
        (w_G, stats.halfnorm(scale=sigma)),
        ((1 - w_G) * v_L, stats.expon(scale=scale)),
        ((1 - w_G) * (1 - v_L), stats.halfcauchy(scale=gamma)),
    ],
}


def by_scipy(family, theta):
    """Log-density and distribution function of abs(z) from scipy's distributions."""
    parts = PARTS[family.name](*theta)
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
def test_both_at_once_are_each_alone(family, theta):
    z = np.concatenate([Z, [0.0]])
    for stacked in (theta, np.stack([theta, 0.9 * theta], axis=1)[:, :, None]):
        logpdf, by_theta = family.logpdf_and_gradient(z, stacked)
        np.testing.assert_allclose(logpdf, family.logpdf(z, stacked), rtol=1e-13, atol=1e-14)
        np.testing.assert_allclose(by_theta, family.gradient(z, stacked)[1], rtol=1e-13, atol=1e-14)


@every_case
def test_far_from_the_usual_all_is_finite(family, theta):
    z = np.array([0.0, FLOOR_PX, -FLOOR_PX, 1e5, -1e5])
    # free variables of +-30 are where a fit stops
    corners = np.array(list(product((-30.0, 30.0), repeat=len(theta)))).T
    lengths = np.array([[p.unit == "px"] for p in family.parameters])
    # lengths as they are, then from the floor to 1 px
    for lengths_px in (theta[:, None], np.where(corners < 0, FLOOR_PX, 1.0)):
        extreme = np.where(lengths, lengths_px, family.to_theta(corners))[..., None]
        by_z, by_theta = family.gradient(z, extreme)
        assert np.isfinite(family.logpdf(z, extreme)).all()
        assert np.isfinite(by_z).all() and np.isfinite(by_theta).all()
        cdf = family.magnitude_cdf(np.abs(z), extreme)
        assert ((cdf >= 0) & (cdf <= 1)).all()


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


@pytest.mark.parametrize(("name", "tolerance"), [("laplace", 1e-3), ("student-t", 0.12), ("glc", 0.35)])
def test_a_start_recovers_the_parameters_of_a_histogram(name, tolerance):
    family, edges = FAMILIES[name], np.concatenate([[0], np.geomspace(1e-4, 1e3, 300)])
    for theta in np.array(THETA[name]):
        count = 1e6 * np.diff(family.magnitude_cdf(edges, theta))
        middle = 0.5 * (edges[1:] + edges[:-1])
        np.testing.assert_allclose(family.start(middle, count), theta, rtol=tolerance)


@pytest.mark.parametrize("family", FAMILIES.values(), ids=list(FAMILIES))
@pytest.mark.parametrize("magnitude", [3e-5, 0.3, 900.0])
def test_a_start_from_one_filled_bin_keeps_to_the_bounds(family, magnitude):
    theta = family.start(np.array([1e-5, magnitude, 2000.0]), np.array([0.0, 7.0, 0.0]))
    for parameter, value in zip(family.parameters, theta):
        assert np.isfinite(value)
        assert parameter.lower < value < parameter.upper


def test_a_mixture_starts_with_its_components_in_order():
    family = FAMILIES["glc"]
    for theta in np.array(THETA["glc"]):
        magnitude = np.sort(family.sample_magnitude(theta, 50_000, np.random.default_rng(4)))
        sigma, scale, gamma = family.start(magnitude, np.ones(len(magnitude)))[:3]
        assert sigma < scale < gamma


@pytest.mark.parametrize("part", range(3))
def test_a_mixture_of_one_part_is_that_part(part):
    family, theta = FAMILIES["glc"], np.array([0.3, 0.5, 0.8, *((1.0, 0.5), (0.0, 1.0), (0.0, 0.0))[part]])
    alone, z = family.components[part], np.linspace(-3, 3, 61)
    np.testing.assert_allclose(family.logpdf(z, theta), alone.logpdf(z, theta[part : part + 1]), rtol=1e-12)
    by_z, by_theta = family.gradient(z, theta)
    expected = alone.gradient(z, theta[part : part + 1])
    np.testing.assert_allclose(by_z, expected[0], rtol=1e-12, atol=1e-15)
    np.testing.assert_allclose(by_theta[part], expected[1][0], rtol=1e-12, atol=1e-15)
    np.testing.assert_allclose(
        family.magnitude_cdf(abs(z), theta), alone.magnitude_cdf(abs(z), theta[[part]])
    )
    assert np.isfinite(by_theta).all()


def test_the_students_bounds_reach_into_the_heaviest_tail():
    family, theta = FAMILIES["student-t"], np.array([1.0, 0.301])
    confidence = np.array([0.5, 0.9, 0.99, 0.9999])
    bound = family.magnitude_ppf(confidence, theta)
    np.testing.assert_allclose(family.magnitude_cdf(bound, theta), confidence, atol=1e-12)
    np.testing.assert_allclose(bound, stats.t(theta[1]).ppf(0.5 + confidence / 2), rtol=1e-6)


def test_a_student_of_one_degree_is_the_cauchy_and_of_many_the_gaussian():
    family = FAMILIES["student-t"]
    np.testing.assert_allclose(family.logpdf(Z, np.array([0.3, 1.0])), stats.cauchy(scale=0.3).logpdf(Z))
    z = np.linspace(-1, 1, 21)
    np.testing.assert_allclose(
        family.pdf(z, np.array([0.5, 99.9])), FAMILIES["gaussian"].pdf(z, np.array([0.5])), rtol=0.02
    )


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
