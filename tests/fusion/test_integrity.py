"""The monitor of GPS against a filter that was fooled, against exact distributions, and against draws."""

import numpy as np
import pytest
from scipy.stats import chi2, kstest

from flowlik.errors import DataError
from flowlik.fusion import (
    GpsInnovations,
    block_maxima,
    drawn_maxima,
    false_alarm_threshold,
    normalised_innovations_squared,
    ramp_alarm,
    ramp_test,
    trusted_fixes,
    windowed_nis,
)

COUNT, STEP_S = 60, 0.5
SIGMA_M = np.array([1.0, 2.0, 1.5])


def filtered(fixes_m: np.ndarray) -> GpsInnovations:
    """A Kalman filter of position and velocity that takes fixes (N, 3) [m] of something at rest."""
    F = np.kron([[1, STEP_S], [0, 1]], np.eye(3))
    H = np.hstack([np.eye(3), np.zeros((3, 3))])
    R, Q = np.diag(SIGMA_M**2), np.diag([1e-4] * 3 + [4e-4] * 3)
    x, C = np.zeros(6), np.diag([1.0] * 3 + [0.1] * 3)
    told = []
    for k, fix in enumerate(fixes_m):
        if k:
            x, C = F @ x, F @ C @ F.T + Q
        S = H @ C @ H.T + R
        K = C @ H.T @ np.linalg.inv(S)
        told.append((fix - H @ x, S, H, K, F if k else np.eye(6)))
        x, C = x + K @ told[-1][0], (np.eye(6) - K @ H) @ C
    return GpsInnovations(np.arange(len(fixes_m)) * STEP_S, *(np.array(part) for part in zip(*told)))


def ramp(onset: int, rate_mps: np.ndarray) -> np.ndarray:
    return np.outer(np.maximum(np.arange(COUNT) - onset, 0) * STEP_S, rate_mps)


def test_a_ramp_without_noise_is_found_exactly():
    """The filter follows the ramp: only by its own gains are the innovations explained."""
    rate = np.array([0.3, -0.1, 0.2])
    test = ramp_test(filtered(ramp(25, rate)), window_s=20.0)
    assert not test.statistic[:26].any()
    np.testing.assert_allclose(test.rate_n_mps[28:60], np.tile(rate, (32, 1)), atol=1e-9)
    np.testing.assert_allclose(test.onset_s[28:60], 25 * STEP_S)
    alarm = ramp_alarm(filtered(ramp(25, rate)), test.statistic[40])
    assert alarm is not None and alarm.time_s == 41 * STEP_S and alarm.onset_s == 25 * STEP_S
    np.testing.assert_allclose(alarm.rate_n_mps, rate, atol=1e-9)
    first, last = alarm.onset_interval_s
    assert first < alarm.onset_s < last < alarm.time_s
    trusted = trusted_fixes(test.times_s, alarm)
    assert trusted.sum() == round(first / STEP_S) + 1 and not trusted[25:].all()


def test_older_onsets_than_the_window_are_not_looked_for():
    test = ramp_test(filtered(ramp(5, np.ones(3))), window_s=8.0)
    assert (test.times_s - test.onset_s).max() == 8.0
    assert test.onset_s[-1] > 5 * STEP_S


def test_the_last_window_alone_says_the_same_of_the_last_fix():
    """What a robot need keep: hypotheses begin at onsets, and know nothing of what was before."""
    fixes = filtered(ramp(40, np.array([0.2, 0.0, -0.1])) + np.sin(np.arange(3 * COUNT)).reshape(COUNT, 3))
    recent = GpsInnovations(
        *(part[fixes.times_s >= fixes.times_s[-1] - 8.0] for part in vars(fixes).values())
    )
    whole, part = ramp_test(fixes, 8.0), ramp_test(recent, 8.0)
    np.testing.assert_allclose(part.statistic[-1], whole.statistic[-1])
    np.testing.assert_allclose(part.rate_n_mps[-1], whole.rate_n_mps[-1])


def test_a_single_hypothesis_is_chi_squared():
    """At the second fix the only onset is the first: the innovation tells the rate alone."""
    clean = filtered(np.zeros((COUNT, 3)))
    roots = np.linalg.cholesky(clean.innovation_covariances_m2[:2])
    first = GpsInnovations(*(part[:2] for part in vars(clean).values()))
    white = np.random.default_rng(1).standard_normal((2, 2000, 3))
    runs = np.einsum("kij,kdj->kdi", roots, white)
    test = ramp_test(first, 20.0, runs)
    assert kstest(test.statistic[1], chi2(3).cdf).pvalue > 0.01
    np.testing.assert_allclose(test.rate_n_mps[1], runs[1] / STEP_S)
    first.innovations_m[:] = runs[:, 0]
    alarm = ramp_alarm(first, 0.0)
    np.testing.assert_allclose(alarm.rate_covariance_n, clean.innovation_covariances_m2[1] / STEP_S**2)


def test_thresholds_hold_the_rate_of_false_alarms_that_was_asked_for():
    rng = np.random.default_rng(2)
    clean = filtered(np.zeros((COUNT, 3)))
    duration_s = COUNT * STEP_S
    per_hour = -np.log(0.9) / duration_s * 3600
    threshold = false_alarm_threshold(drawn_maxima(clean, 1000, rng), duration_s, per_hour)
    share = (drawn_maxima(clean, 1000, rng) > threshold).mean()
    assert abs(share - 0.1) < 4 * np.sqrt(2 * 0.09 / 1000)


def test_rare_thresholds_are_those_of_the_exact_distribution():
    """The largest of 50 independent chi-squared values has a quantile in closed form."""
    maxima = chi2(3).rvs((4000, 50), random_state=3).max(axis=1)
    for per_hour in (1.0, 10.0, 60.0):
        exact = chi2(3).isf(-np.expm1(np.log1p(np.expm1(-per_hour / 60)) / 50))
        assert abs(false_alarm_threshold(maxima, 60.0, per_hour) - exact) < 0.6


def test_nis_in_a_window_is_as_unlikely_as_it_says():
    rng = np.random.default_rng(4)
    root = np.array([[1.0, 0, 0], [0.5, 2.0, 0], [-1, 0.3, 0.5]])
    nis = normalised_innovations_squared(rng.standard_normal((40, 500, 3)) @ root.T, root @ root.T)
    assert abs(nis.mean() - 3) < 0.1
    times_s = np.arange(40) * 0.2
    surprise = windowed_nis(times_s, nis, window_s=2.0)
    assert kstest(surprise[30], "expon").pvalue > 0.01
    np.testing.assert_allclose(surprise[30], -chi2.logsf(nis[20:31].sum(axis=0), 33))


def test_blocks_of_clean_time():
    np.testing.assert_array_equal(block_maxima(np.arange(10.0), np.arange(10.0) % 7, 3.0), [2, 5, 6])


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda f: ramp_test(f, 0.0), "a window of 0 s"),
        (lambda f: ramp_test(f, innovations_m=np.zeros((3, 2, 3))), r"must be \(60, D, 3\), not \(3, 2, 3\)"),
        (lambda f: ramp_alarm(f, 10.0, confidence=1.0), "between 0 and 1, not 1"),
        (lambda f: windowed_nis(f.times_s, f.times_s, -1.0), "a window of -1 s"),
        (lambda f: block_maxima(f.times_s, f.times_s, 100.0), "no whole block of 100 s"),
        (lambda f: false_alarm_threshold(np.ones(19), 60.0, 1.0), "19 maxima of clean time"),
        (lambda f: false_alarm_threshold(np.ones(20), 60.0, 0.0), "0 false alarms an hour"),
    ],
)
def test_bad_input(call, message):
    with pytest.raises(DataError, match=message):
        call(filtered(np.zeros((COUNT, 3))))
