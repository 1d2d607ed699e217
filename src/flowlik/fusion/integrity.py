"""Does what a GPS receiver says agree with the other sensors (docs/gps-integrity.md)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from flowlik.errors import DataError
from flowlik.fusion.innovations import GpsInnovations
from flowlik.fusion.ramp_test import WINDOW_S, RampAlarm, ramp_test
from flowlik.support.arrays import Array

KEPT_S = 60.0
"""How long [s] measurements are kept, to be filtered again from an onset on."""

FEWEST_MAXIMA = 20
TAIL_SHARE = 0.2


def normalised_innovations_squared(innovations_m: Array, covariances_m2: Array) -> Array:
    """NIS (...,) of innovations (..., 3) [m] with covariances (..., 3, 3) [m²]: 3 on average if honest."""
    whole = np.linalg.solve(covariances_m2, innovations_m[..., None])[..., 0]
    return np.asarray((innovations_m * whole).sum(axis=-1))


def windowed_nis(times_s: Array, nis: Array, window_s: float = WINDOW_S) -> Array:
    """How unlikely the fixes of the last seconds are together: -ln P of a sum of NIS as large.

    Parameters
    ----------
    times_s : array (N,)
        Times [s] of the fixes, increasing.
    nis : array (N, ...)
        Of `normalised_innovations_squared`.
    window_s : float
        Fixes no older than this [s] are summed.

    Returns
    -------
    surprise : array (N, ...)
        -ln P, by the χ² distribution of three freedoms a fix: the longer a window, the more freedoms.

    Raises
    ------
    DataError
        If the window is not positive.
    """
    if not window_s > 0:
        raise DataError(f"a window of {window_s:g} s")
    first = np.searchsorted(times_s, times_s - window_s * (1 + 1e-9))
    sums = np.concatenate([np.zeros((1, *nis.shape[1:])), np.cumsum(nis, axis=0)])
    counts = np.arange(1, len(times_s) + 1) - first
    freedoms = 3.0 * counts.reshape(-1, *[1] * (nis.ndim - 1))
    return np.asarray(-chi2.logsf(sums[1:] - sums[first], freedoms))


def drawn_maxima(
    fixes: GpsInnovations, draws: int, rng: np.random.Generator, window_s: float = WINDOW_S
) -> Array:
    """Largest statistics (draws,) of `ramp_test` in as many flights that are what the filter says.

    Innovations are drawn white of its own covariances; gains and transitions are its own, so that how the
    statistics of neighbouring fixes and onsets hang together is that of this flight.

    Parameters
    ----------
    fixes : GpsInnovations
        A filter's fixes; they may be under attack, since gains and covariances do not depend on it.
    draws : int
        How many flights as long as this one.
    rng : Generator
        Of the draws.
    window_s : float
        As for `ramp_test`.
    """
    roots = np.linalg.cholesky(fixes.innovation_covariances_m2)
    white = rng.standard_normal((len(fixes.times_s), draws, 3))
    test = ramp_test(fixes, window_s, np.einsum("kij,kdj->kdi", roots, white))
    return np.asarray(test.statistic.max(axis=0))


def block_maxima(times_s: Array, statistic: Array, block_s: float) -> Array:
    """Largest statistic (B,) of each whole block of time in a flight known to be clean.

    Parameters
    ----------
    times_s, statistic : array (N,)
        Times [s] and a statistic at each fix.
    block_s : float
        Length [s] of a block, at least the test's window, so that blocks are nearly independent.

    Raises
    ------
    DataError
        If there is no whole block.
    """
    blocks = int((times_s[-1] - times_s[0]) / block_s) if len(times_s) and block_s > 0 else 0
    if blocks == 0:
        raise DataError(f"no whole block of {block_s:g} s in the clean fixes")
    number = ((times_s - times_s[0]) / block_s).astype(int)
    held = [statistic[number == b] for b in range(blocks)]
    return np.array([values.max() for values in held if len(values)])


def false_alarm_threshold(maxima: Array, duration_s: float, per_hour: float) -> float:
    """Threshold of a statistic that clean flights exceed so often an hour.

    False alarms are taken to come at random, so that of clean times of ``duration_s`` the share
    1 - exp(-per_hour · duration) has one. Where that share is rarer than a fifth, what the largest fifth of
    the maxima exceed the rest by is taken to be exponential, the limit for maxima whose tails fall like χ².

    Parameters
    ----------
    maxima : array (M,)
        Largest statistics of `drawn_maxima` or `block_maxima`, at least 20.
    duration_s : float
        Time [s] that each is of.
    per_hour : float
        False alarms an hour.

    Raises
    ------
    DataError
        If there are too few maxima, or duration or rate are not positive.
    """
    if not (duration_s > 0 and per_hour > 0):
        raise DataError(f"no threshold for {per_hour:g} false alarms an hour over {duration_s:g} s")
    if len(maxima) < FEWEST_MAXIMA:
        raise DataError(f"{len(maxima)} maxima of clean time, but a threshold needs at least {FEWEST_MAXIMA}")
    share = -np.expm1(-per_hour * duration_s / 3600)
    if share >= TAIL_SHARE:
        return float(np.quantile(maxima, 1 - share))
    start = float(np.quantile(maxima, 1 - TAIL_SHARE))
    scale = float((maxima[maxima > start] - start).mean())
    return start + scale * float(np.log(TAIL_SHARE / share))


def trusted_fixes(times_s: Array, alarm: RampAlarm | None) -> NDArray[np.bool_]:
    """Which fixes (N,) a filter should take once there was an alarm: those before the earliest onset.

    The filter goes back to that onset, over measurements that it keeps for `KEPT_S`, and from there on
    coasts: GPS stays out until someone says otherwise.

    Parameters
    ----------
    times_s : array (N,)
        Times [s] of the fixes.
    alarm : RampAlarm or None
        Of `flowlik.fusion.ramp_alarm`; without one all are taken.
    """
    if alarm is None:
        return np.ones(len(times_s), dtype=bool)
    return np.asarray(times_s <= alarm.onset_interval_s[0])
