"""Likelihood-ratio test of a ramp in GPS positions, of unknown rate and onset (docs/gps-integrity.md)."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from flowlik.errors import DataError
from flowlik.fusion.innovations import GpsInnovations
from flowlik.support.arrays import Array

WINDOW_S = 20.0
"""How far back [s] the onset of a ramp is looked for."""


@dataclass(frozen=True, eq=False)
class RampTest:
    """What the test says at each fix, of the likeliest onset.

    Attributes
    ----------
    times_s : array (N,)
        Times [s] of the fixes.
    statistic : array (N,) or (N, D)
        Twice the log-likelihood ratio of the likeliest ramp against none; 0 at the first fix.
    onset_s : array (N,) or (N, D)
        Its onset [s]: the time of the last fix that it leaves as it is.
    rate_n_mps : array (N, 3) or (N, D, 3)
        Its rate [m/s] in {n}.
    """

    times_s: Array
    statistic: Array
    onset_s: Array
    rate_n_mps: Array


@dataclass(frozen=True, eq=False)
class RampAlarm:
    """A ramp that was found.

    Attributes
    ----------
    time_s : float
        Time [s] of the fix that raised the alarm.
    onset_s : float
        Likeliest onset [s].
    onset_interval_s : tuple of 2 float
        First and last onset [s] of the interval that was asked for, within the window.
    rate_n_mps : array (3,)
        Rate [m/s] in {n} at the likeliest onset.
    rate_covariance_n : array (3, 3)
        Its covariance [m²/s²], the onset given.
    statistic : float
        Twice the log-likelihood ratio.
    """

    time_s: float
    onset_s: float
    onset_interval_s: tuple[float, float]
    rate_n_mps: Array
    rate_covariance_n: Array
    statistic: float


def ramp_test(
    fixes: GpsInnovations, window_s: float = WINDOW_S, innovations_m: Array | None = None
) -> RampTest:
    """Test at each fix whether GPS has begun to leave the truth at a constant rate.

    For every onset at a fix of the last ``window_s`` the signature of a ramp in the innovations follows from
    the filter's own gains (it pulls the estimate along); the likeliest rate has a closed form, and the
    largest ratio over all onsets is the statistic. Source: Willsky and Jones, "A generalized likelihood ratio
    approach to the detection and estimation of jumps in linear systems", IEEE TAC 21 (1976).

    Parameters
    ----------
    fixes : GpsInnovations
        A filter's fixes.
    window_s : float
        How far back [s] an onset is looked for.
    innovations_m : array (N, D, 3), optional
        D runs of innovations [m] to test in place of the filter's own; it is linear, so that all share its
        gains.

    Raises
    ------
    DataError
        If the window is not positive, or innovations are not (N, D, 3).
    """
    runs = _runs(fixes, innovations_m)
    statistic, onset_s = np.zeros((2, *runs.shape[:2]))
    rate = np.zeros_like(runs)
    onset_s += fixes.times_s[:, None]
    every = np.arange(runs.shape[1])
    for k, (onsets_s, ratios, rates, _) in enumerate(_hypotheses(fixes, runs, window_s)):
        if len(onsets_s):
            best = ratios.argmax(axis=0)
            statistic[k], onset_s[k], rate[k] = ratios[best, every], onsets_s[best], rates[best, :, every]
    if innovations_m is None:
        return RampTest(fixes.times_s, statistic[:, 0], onset_s[:, 0], rate[:, 0])
    return RampTest(fixes.times_s, statistic, onset_s, rate)


def ramp_alarm(
    fixes: GpsInnovations, threshold: float, window_s: float = WINDOW_S, confidence: float = 0.95
) -> RampAlarm | None:
    """First alarm of `ramp_test`, with what is known of the ramp by then; None if there is none.

    Parameters
    ----------
    fixes : GpsInnovations
        A filter's fixes.
    threshold : float
        Statistic above which there is an alarm: `flowlik.fusion.false_alarm_threshold`.
    window_s : float
        How far back [s] an onset is looked for.
    confidence : float
        Of the interval of the onset, by the fall of twice the log-likelihood from its largest value.

    Raises
    ------
    DataError
        If the window is not positive, or the confidence not between 0 and 1.
    """
    if not 0 < confidence < 1:
        raise DataError(f"an interval needs a confidence between 0 and 1, not {confidence:g}")
    fall = chi2.ppf(confidence, 1)
    runs = _runs(fixes, None)
    for time_s, found in zip(fixes.times_s, _hypotheses(fixes, runs, window_s), strict=True):
        onsets_s, ratios, rates, information = found
        if len(onsets_s) and (ratio := ratios.max()) > threshold:
            best, within = int(ratios[:, 0].argmax()), onsets_s[ratios[:, 0] > ratio - fall]
            return RampAlarm(
                time_s=float(time_s),
                onset_s=float(onsets_s[best]),
                onset_interval_s=(float(within.min()), float(within.max())),
                rate_n_mps=rates[best, :, 0],
                rate_covariance_n=np.linalg.inv(information[best]),
                statistic=float(ratio),
            )
    return None


def _runs(fixes: GpsInnovations, innovations_m: Array | None) -> Array:
    if innovations_m is None:
        return fixes.innovations_m[:, None]
    if innovations_m.ndim != 3 or innovations_m[:, 0].shape != fixes.innovations_m.shape:
        count = len(fixes.times_s)
        raise DataError(f"innovations must be ({count}, D, 3), not {innovations_m.shape}")
    return innovations_m


def _hypotheses(
    fixes: GpsInnovations, runs: Array, window_s: float
) -> Iterator[tuple[Array, Array, Array, Array]]:
    """At each fix, of onsets (L,) [s]: ratios (L, D), rates (L, 3, D) [m/s], and information (L, 3, 3)."""
    if not window_s > 0:
        raise DataError(f"a window of {window_s:g} s")
    times_s = fixes.times_s
    slots = _most_within(times_s, window_s)
    states = fixes.gains.shape[1]
    # one slot a hypothesis: its onset, the shift of the estimate by a unit ramp, and the two sums
    onsets_s = np.full(slots, np.inf)
    shift = np.zeros((states, slots, 3))
    information, score = np.zeros((slots, 3, 3)), np.zeros((slots, 3, runs.shape[1]))
    for k, time_s in enumerate(times_s):
        before = (fixes.transitions[k] @ shift.reshape(states, -1)).reshape(shift.shape)
        elapsed_s = np.where(np.isfinite(onsets_s), time_s - onsets_s, 0.0)
        signature = np.eye(3)[:, None] * elapsed_s[:, None] - np.tensordot(fixes.observations[k], before, 1)
        shift = before + np.tensordot(fixes.gains[k], signature, 1)
        root = np.linalg.cholesky(fixes.innovation_covariances_m2[k])
        white = np.linalg.solve(root, signature.reshape(3, -1)).reshape(signature.shape)
        information += np.einsum("ila,ilb->lab", white, white)
        score += np.einsum("ila,id->lad", white, np.linalg.solve(root, runs[k].T))
        alive = (elapsed_s > 0) & (elapsed_s <= window_s * (1 + 1e-9))
        rates = np.asarray(np.linalg.inv(information[alive]) @ score[alive], dtype=np.float64)
        ratios = np.asarray(np.einsum("lad,lad->ld", score[alive], rates), dtype=np.float64)
        yield onsets_s[alive], ratios, rates, information[alive]
        slot = k % slots
        onsets_s[slot], shift[:, slot], information[slot], score[slot] = time_s, 0.0, 0.0, 0.0


def _most_within(times_s: NDArray[np.float64], window_s: float) -> int:
    """Most fixes within a window of time, both ends counted."""
    ends = np.searchsorted(times_s, times_s + window_s * (1 + 1e-9), side="right")
    return int((ends - np.arange(len(times_s))).max(initial=1))
