"""How a motion's error stays from frame to frame (docs/over-time.md)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from flowlik.errors import ModelError
from flowlik.support.arrays import Array

MOST_SHARE = 10.0
# how long a filter goes by flow alone, unless it says
HORIZON_S = 1.0


@dataclass(frozen=True)
class Persistence:
    """Correlation over time of the errors of motions, each whitened by its own covariance.

    Two errors a time dt [s] apart have the correlation ``share * exp(-dt / memory_s)``: a first-order
    Gauss-Markov bias beside white noise.

    Attributes
    ----------
    share : float
        Variance of what stays, in units of one motion's stated covariance; above 1 where errors are larger
        than stated.
    memory_s : float
        Time constant [s].

    Raises
    ------
    ModelError
        If the share is negative or above 10, or the memory is not positive.
    """

    share: float
    memory_s: float

    def __post_init__(self) -> None:
        if not (0 <= self.share <= MOST_SHARE and 0 < self.memory_s < np.inf):
            raise ModelError(
                f"errors over time need a share from 0 to {MOST_SHARE:g} and a memory above 0 s, "
                f"not {self.share:g} and {self.memory_s:g} s"
            )

    @property
    def variance(self) -> float:
        """Variance of a whitened error: 1, or the share where that is more."""
        return max(1.0, self.share)

    def correlation(self, apart_s: ArrayLike) -> Array:
        """Correlation of errors so far apart [s], which is not zero."""
        return np.asarray(self.share * np.exp(-np.asarray(apart_s, dtype=np.float64) / self.memory_s))

    def long_run_factor(self, motions: int, interval_s: float) -> float:
        """Variance of the sum of so many motions' errors, over that of independent ones of stated size.

        Parameters
        ----------
        motions : int
            Number of consecutive motions, at least 1.
        interval_s : float
            Time [s] between frames.

        Raises
        ------
        ModelError
            If there is no motion, or no time between them.
        """
        if motions < 1 or not interval_s > 0:
            raise ModelError(f"no long-run factor of {motions} motions every {interval_s:g} s")
        lag = np.arange(1.0, motions)
        return self.variance + 2 * float(((1 - lag / motions) * self.correlation(lag * interval_s)).sum())

    def filter_factor(self, interval_s: float, horizon_s: float = HORIZON_S) -> float:
        """Factor of a motion's covariance for a filter that takes each motion as independent of the others.

        The long-run factor of motions every ``interval_s`` over the time in which nothing else tells the
        filter what they tell.

        Raises
        ------
        ModelError
            If no time passes.
        """
        if not (interval_s > 0 and horizon_s > 0):
            raise ModelError(f"no long-run factor of motions every {interval_s:g} s over {horizon_s:g} s")
        return self.long_run_factor(max(round(horizon_s / interval_s), 1), interval_s)


@dataclass(frozen=True)
class OverTime:
    """What stays of the errors of motions.

    Attributes
    ----------
    full : Persistence
        Of the whole motion.
    given_rotation : Persistence
        Of the translation once the rotation is known, as from a gyroscope.
    """

    full: Persistence
    given_rotation: Persistence
