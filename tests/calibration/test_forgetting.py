"""A sketch is good enough to forget the samples; benchmarks/calibration_sketch.py does the same at scale."""

import numpy as np
import pytest

from flowlik.calibration import ErrorSketch, fit
from flowlik.calibration.sketch import level_edges
from flowlik.evaluation.likelihood import Counting, kolmogorov_smirnov, negative_log_likelihood
from flowlik.likelihood.families import LaplaceCauchy
from flowlik.likelihood.likelihood import FlowLikelihood
from flowlik.likelihood.schedule import Index

N, CHUNKS = 40_000, 5


@pytest.fixture(scope="module")
def samples():
    """Texture and errors of a Laplace-Cauchy mixture whose parameters bend over texture."""
    rng = np.random.default_rng(0)
    x = rng.normal(np.log(30.0), 1.6, N * CHUNKS)
    scale = 2.5 / (1 + np.exp(0.9 * (x - 2))) + 0.03
    core = rng.random(len(x)) < 0.75 - 0.3 / (1 + np.exp(x - 3))
    z = np.where(core, rng.laplace(size=len(x)), 1.5 * rng.standard_cauchy(len(x)))
    return x, scale * z


@pytest.fixture(scope="module")
def sketch(samples):
    merged = ErrorSketch.empty(Index())
    for i, (x, z) in enumerate(zip(*(np.split(part, CHUNKS) for part in samples))):
        rng = np.random.default_rng(i)
        merged = merged.merge(ErrorSketch.of(Index(), {"texture": np.exp(x)}, z, np.ones(len(z)), rng))
    return merged


@pytest.fixture(scope="module")
def model(sketch):
    return FlowLikelihood(LaplaceCauchy(), fit(sketch, LaplaceCauchy())[0])


def test_log_score_is_that_of_the_samples(samples, sketch, model):
    x, z = samples
    raw = -model.family.logpdf(z, model.schedule.theta(x)).mean()
    assert negative_log_likelihood(sketch, model) == pytest.approx(raw, abs=1e-3)


def test_ks_is_that_of_the_samples(samples, sketch, model):
    x, z = samples
    found = kolmogorov_smirnov(sketch, model, Counting(10_000, 1))
    assert found.counted.sum() >= 5
    edges = np.log(level_edges())
    grid = np.geomspace(1e-5, 1e5, 2000)
    for level in np.flatnonzero(found.counted):
        mine = (x >= edges[level]) & (x < edges[level + 1])
        theta = model.schedule.theta(np.quantile(x[mine], (np.arange(100) + 0.5) / 100))
        predicted = model.family.magnitude_cdf(grid[:, None], theta[:, None, :]).mean(axis=1)
        magnitude = np.sort(np.abs(z[mine]))
        at_samples = np.interp(magnitude, grid, predicted)
        rank = np.arange(len(magnitude) + 1) / len(magnitude)
        raw = max(np.abs(rank[1:] - at_samples).max(), np.abs(rank[:-1] - at_samples).max())
        assert found.statistic[level] == pytest.approx(raw, abs=2e-3)
