"""What the monitor of GPS says of a flight."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from flowlik.datasets import GpsFixes
from flowlik.fusion import (
    GpsInnovations,
    RampAlarm,
    RampTest,
    drawn_maxima,
    false_alarm_threshold,
    normalised_innovations_squared,
    ramp_alarm,
    ramp_test,
    trusted_fixes,
    windowed_nis,
)
from flowlik.support.arrays import Array

DRAWS = 300
FEWEST_FIXES = 3


@dataclass(frozen=True, eq=False)
class Watched:
    """Innovations of a flight's fixes, and what their tests say.

    Attributes
    ----------
    fixes : GpsInnovations
        N of them.
    nis : array (N,)
        Normalised innovations squared.
    surprise : array (N,)
        -ln P of the NIS of the last 20 s.
    test : RampTest or None
        The likeliest ramp at each fix; None of fewer than three fixes.
    threshold : float or None
        Of its statistic.
    alarm : RampAlarm or None
        The first.
    """

    fixes: GpsInnovations
    nis: Array
    surprise: Array
    test: RampTest | None = None
    threshold: float | None = None
    alarm: RampAlarm | None = None

    def trusted(self, fixes: GpsFixes) -> GpsFixes:
        """Fixes before the earliest onset of the ramp."""
        kept = trusted_fixes(fixes.times_s, self.alarm)
        return replace(
            fixes,
            times_s=fixes.times_s[kept],
            positions_n_m=fixes.positions_n_m[kept],
            sigma_m=fixes.sigma_m[kept],
        )


def watched(fixes: GpsInnovations, per_hour: float, seed: int) -> Watched:
    """Test the fixes of a flight, for a rate of false alarms an hour.

    Raises
    ------
    DataError
        If the rate is not above 0.
    """
    nis = normalised_innovations_squared(fixes.innovations_m, fixes.innovation_covariances_m2)
    surprise = windowed_nis(fixes.times_s, nis)
    if len(nis) < FEWEST_FIXES:
        return Watched(fixes, nis, surprise)
    rng = np.random.default_rng([seed, 4])
    duration_s = float(fixes.times_s[-1] - fixes.times_s[0])
    threshold = false_alarm_threshold(drawn_maxima(fixes, DRAWS, rng), duration_s, per_hour)
    return Watched(fixes, nis, surprise, ramp_test(fixes), threshold, ramp_alarm(fixes, threshold))
