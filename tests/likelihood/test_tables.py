import numpy as np
import pytest
from scipy.interpolate import RegularGridInterpolator

from flowlik.likelihood import tables
from tests.helpers import KNOTS, lcm_likelihood
from tests.likelihood.test_likelihood import every_model

RNG = np.random.default_rng(0)
X = RNG.uniform(KNOTS[0], KNOTS[-1], 20_000)
Z = 10 ** RNG.uniform(-4, 2.9, 20_000) * RNG.choice([-1, 1], 20_000)
MODEL = lcm_likelihood()


def look_up(table, rows, magnitude):
    last = len(table) - 2
    whole = np.minimum(rows.astype(int), last)
    columns = [tables.magnitude_position(z) for z in magnitude]
    return np.array([tables.bilinear(table, i, r - i, j, f) for r, i, (j, f) in zip(rows, whole, columns)])


def twin(table, rows, magnitude):
    """Bilinear interpolation by scipy, constant beyond the outer nodes."""
    nodes = tables.magnitude_nodes()
    grid = RegularGridInterpolator((np.arange(len(table)), nodes), table.astype(np.float64))
    return grid(np.stack([rows, np.clip(np.float32(magnitude), nodes[0], nodes[-1])], axis=-1))


def test_magnitude_nodes_are_sixteen_linear_steps_an_octave():
    nodes = tables.magnitude_nodes()
    octaves = nodes[:-1].reshape(24, 16)
    np.testing.assert_array_equal(octaves[:, 0], 2.0 ** np.arange(-14, 10))
    np.testing.assert_allclose(octaves, octaves[:, :1] * (1 + np.arange(16) / 16), rtol=1e-15)
    assert nodes[-1] == 1024


@every_model
def test_look_up_is_bilinear(model):
    compiled = model.compiled
    rows = compiled.rows(X[:2000])
    magnitude = np.append(np.abs(Z[:1990]), [0, 1e-9, 2**-14, 0.5, 1, 1023.9, 1024, 1e5, 1e30, 3e38])
    for table in (compiled.log_prob, compiled.weight):
        np.testing.assert_allclose(
            look_up(table, rows, magnitude), twin(table, rows, magnitude), rtol=1e-5, atol=1e-6
        )


def test_coordinates_beyond_the_outer_knots_are_clamped():
    compiled = MODEL.compiled
    rows = compiled.rows(np.array([KNOTS[0] - 9, KNOTS[0], KNOTS[-1], KNOTS[-1] + 9]))
    np.testing.assert_allclose(rows, [0, 0, tables.X_NODES - 1, tables.X_NODES - 1])
    last = look_up(compiled.log_prob, rows[-1:], [0.3])
    np.testing.assert_allclose(last, MODEL.log_prob(0.3, KNOTS[-1] + 9), atol=1e-3)


@every_model
def test_tables_agree_with_the_formula(model):
    """Within 1 % of the log-density (or 0.01 nat) and of the weight, away from jumps and kinks."""
    compiled, magnitude = model.compiled, np.abs(Z)
    rows = compiled.rows(X)
    log_prob, weight = model.log_prob(Z, X), model.weight(Z, X)
    smooth = magnitude > 1.1e-4  # the log-logistic jumps at its floor
    error = np.abs(look_up(compiled.log_prob, rows, magnitude) - log_prob)
    assert (error <= 0.01 * np.maximum(1, np.abs(log_prob)))[smooth].all()
    error = np.abs(look_up(compiled.weight, rows, magnitude) - weight)
    assert (error <= 0.015 * weight + 0.01 * model.fisher(X)).all()
    tail = magnitude > model.bound(X, 0.9)
    assert (error <= 0.01 * weight)[tail].all()


@pytest.fixture(scope="module")
def components():
    """Errors, Jacobian, coordinates and what is used, of 5003 components."""
    rng = np.random.default_rng(2)
    x = rng.uniform(KNOTS[0] - 1, KNOTS[-1] + 1, 5003)
    return MODEL.sample(x, rng), rng.normal(0, 100, (len(x), 6)), x, rng.random(len(x)) < 0.7


def equations(z, J, x, used):
    compiled = MODEL.compiled
    return tables.normal_equations(
        z, J, compiled.rows(x), MODEL.fisher(x), used, compiled.log_prob, compiled.weight
    )


def test_normal_equations_agree_with_numpy(components):
    z, J, x, used = components
    H, b, log_prob = equations(*components)
    rows = MODEL.compiled.rows(x[used])
    weight, each = (twin(t, rows, np.abs(z[used])) for t in (MODEL.compiled.weight, MODEL.compiled.log_prob))
    expected = (J[used] * MODEL.fisher(x[used])[:, None]).T @ J[used]
    np.testing.assert_allclose(H, expected, rtol=1e-9, atol=1e-9 * np.abs(expected).max())
    np.testing.assert_array_equal(H, H.T)
    expected = -J[used].T @ (weight * z[used])
    np.testing.assert_allclose(b, expected, rtol=1e-5, atol=1e-6 * np.abs(expected).max())
    assert log_prob == pytest.approx(each.sum(), rel=1e-6)


def test_unused_components_may_be_nan(components):
    z, J, x, used = components
    for a, b in zip(equations(*components), equations(np.where(used, z, np.nan), J, x, used)):
        np.testing.assert_array_equal(a, b)


def test_interpolation_agrees_with_numpy():
    nodes, values = np.linspace(-3, 8, 45), np.random.default_rng(3).normal(size=45)
    x = np.append(np.random.default_rng(4).uniform(-6, 12, 500), nodes)
    found = tables.interpolate(x, nodes[0], nodes[1] - nodes[0], values)
    np.testing.assert_allclose(found, np.interp(x, nodes, values), atol=1e-12)
