"""Errors that stay over time, held against sums of drawn ones."""

import numpy as np
import pytest

from flowlik.errors import ModelError
from flowlik.likelihood.over_time import OverTime, Persistence
from flowlik.likelihood.shared_errors import SharedErrors


def drawn(stays: Persistence, motions: int, interval_s: float, count: int, seed: int = 0) -> np.ndarray:
    """Whitened errors (count, motions): a Gauss-Markov bias beside white noise."""
    rng = np.random.default_rng(seed)
    kept = np.exp(-interval_s / stays.memory_s)
    bias = np.sqrt(stays.share) * rng.standard_normal(count)
    errors = np.empty((count, motions))
    for k in range(motions):
        errors[:, k] = bias + np.sqrt(stays.variance - stays.share) * rng.standard_normal(count)
        bias = kept * bias + np.sqrt(stays.share * (1 - kept**2)) * rng.standard_normal(count)
    return errors


@pytest.mark.parametrize("stays", [Persistence(0.6, 0.4), Persistence(2.0, 0.1), Persistence(0.0, 1.0)])
def test_the_long_run_factor_is_the_variance_of_a_sum(stays):
    errors = drawn(stays, 40, 0.05, 20_000)
    for motions in (1, 5, 40):
        found = errors[:, :motions].sum(axis=1).var() / motions
        assert stays.long_run_factor(motions, 0.05) == pytest.approx(found, rel=0.05)
    lag = (errors[:, :-3] * errors[:, 3:]).mean()
    assert stays.correlation(0.15) == pytest.approx(lag, abs=0.02)


def test_a_filter_s_factor_is_that_of_its_horizon():
    stays = Persistence(0.6, 0.4)
    assert stays.filter_factor(1 / 60, 2.0) == stays.long_run_factor(120, 1 / 60)
    assert stays.filter_factor(3.0, 2.0) == 1.0
    # half the motions, each with half the others beside it
    assert stays.filter_factor(1 / 30) == pytest.approx(0.5 * stays.filter_factor(1 / 60), rel=0.05)
    with pytest.raises(ModelError, match="over 0 s"):
        stays.filter_factor(1 / 60, 0.0)


@pytest.mark.parametrize(("share", "memory_s"), [(-0.1, 1.0), (11.0, 1.0), (0.5, 0.0), (float("nan"), 1.0)])
def test_what_is_no_persistence(share, memory_s):
    with pytest.raises(ModelError, match="share from 0 to 10"):
        Persistence(share, memory_s)


@pytest.mark.parametrize(("motions", "interval_s"), [(0, 0.1), (3, 0.0)])
def test_no_factor_of_nothing(motions, interval_s):
    with pytest.raises(ModelError, match="no long-run factor"):
        Persistence(0.5, 1.0).long_run_factor(motions, interval_s)


def test_values_come_back():
    shared = SharedErrors(None, 0.5, OverTime(Persistence(0.7, 1.5), Persistence(0.2, 0.5)))
    assert SharedErrors.of_values(shared.values()).over_time == shared.over_time
    assert SharedErrors.of_values({"correlation": None, "composite_power": 0.0}).over_time is None
