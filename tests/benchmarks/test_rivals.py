"""Error models of the related systems: densities, and figures of known answer."""

import numpy as np
import pytest

import rivals
import rivals_models
from flowlik.likelihood.schedule import Schedule
from rivals_rows import Rows


def rows_of(errors: np.ndarray, flow=(3.0, 0.0), angle: float = 0.3) -> Rows:
    n = len(errors)
    c, s = np.cos(angle), np.sin(angle)
    flow = np.tile(flow, (n, 1))
    t = np.tile([50.0, 8.0], (n, 1))
    return Rows(
        flow, flow - errors, t, np.tile([[c, -s], [s, c]], (n, 1, 1)), np.zeros(n), np.zeros((n, 2)),
        np.zeros((n, 2)), np.ones(n), np.ones(n), np.ones((n, 3)), flow[:, None] - errors[:, None],
    )  # fmt: skip


def mass(rival) -> float:
    """Integral of a model's density over the plane of errors, on polar cells that are finer near 0."""
    r = np.geomspace(1e-4, 300, 400)
    angle = (np.arange(48) + 0.5) * 2 * np.pi / 48
    middle = np.sqrt(r[1:] * r[:-1])
    errors = (middle[:, None, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)).reshape(-1, 2)
    cells = np.repeat((r[1:] ** 2 - r[:-1] ** 2) / 2 * 2 * np.pi / 48, 48)
    return float(np.exp(rival.predict(rows_of(errors)).log_prob) @ cells)


def test_densities_of_vectors_are_normalised():
    constant = Schedule.constant(np.array([0.4, 1.7]))
    assert mass(rivals_models._isotropic(constant, 1.0)) == pytest.approx(1, abs=0.01)
    assert mass(rivals_models._isotropic(constant, 0.5)) == pytest.approx(1, abs=0.01)
    noise = np.random.default_rng(0).standard_normal((4000, 2)) * [0.5, 2.0]
    learned = {"flight": rows_of(noise)}
    assert mass(rivals_models.probflow(learned, "dis")) == pytest.approx(1, abs=0.01)


def test_a_mixture_in_the_images_axes_tells_the_axes_apart():
    noise = np.random.default_rng(0).standard_normal((20_000, 2)) * [0.5, 2.0]
    rival = rivals_models.probflow({"flight": rows_of(noise)}, "dis")
    found = rival.predict(rows_of(noise))
    entropy = 0.5 * np.log(2 * np.pi * np.e * np.array([0.25, 4.0])).sum()
    assert -found.log_prob.mean() == pytest.approx(entropy, abs=0.02)
    assert (found.cdf(np.abs(found.errors)) <= 0.9).mean() == pytest.approx(0.9, abs=0.01)


def test_an_ensemble_is_scaled_to_its_errors():
    rng = np.random.default_rng(0)
    n, spread = 3000, 10 ** rng.uniform(-1, 0, (3000, 1))
    rows = rows_of(spread * rng.standard_normal((n, 2)))
    # an ensemble of a third of the spread around the measured flow, so large that its covariance is known
    away = spread[:, None] / 3 * rng.standard_normal((n, 60, 2))
    ensemble = rows.flow[:, None] + away - away.mean(axis=1, keepdims=True)
    rows = Rows(**{**vars(rows), "ensemble": ensemble})
    found = rivals_models.ilg({"flight": rows}, "lucas-kanade-11").predict(rows)
    assert (found.cdf(np.abs(found.errors)) <= 0.5).mean() == pytest.approx(0.5, abs=0.03)


def test_sparsification_of_the_best_order_is_0_and_of_none_is_1():
    error = np.random.default_rng(0).exponential(size=(20_000, 2))
    assert rivals._ause(error, error) == pytest.approx(0)
    assert rivals._ause(error, np.ones_like(error)) == pytest.approx(1, abs=0.05)


def test_k_s_over_texture_is_that_of_the_magnitude():
    errors = np.abs(np.random.default_rng(0).standard_normal((5000, 2)))
    texture = np.full_like(errors, 10.0)

    def half_normal(magnitude):
        from scipy.special import erf

        return erf(magnitude / np.sqrt(2))

    assert rivals._ks_median(half_normal, errors, texture) < 0.02
    assert rivals._ks_median(lambda m: half_normal(m / 2), errors, texture) == pytest.approx(0.323, abs=0.03)
