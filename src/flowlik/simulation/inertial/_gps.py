"""A GPS receiver beside the camera: positions with white and coloured errors, outages and spoofing."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flowlik.errors import DataError
from flowlik.simulation.inertial._kinematics import SmoothMotion
from flowlik.simulation.inertial._spoofing import Spoofing
from flowlik.support.arrays import Array

_GPS_STREAM = 2


@dataclass(frozen=True)
class GpsModel:
    """How a GPS receiver errs.

    The error of each axis is white noise plus a first-order Gauss-Markov process, stationary from the start.

    Attributes
    ----------
    rate_hz : float
        Fixes a second.
    white_horizontal_m, white_vertical_m : float
        Standard deviation [m] of the white part: along x and z, and along y of {n}.
    coloured_horizontal_m, coloured_vertical_m : float
        Standard deviation [m] of the coloured part.
    correlation_time_s : float
        Its memory [s]: the autocorrelation falls to 1/e.
    position_c_m : tuple of 3 float
        Where the antenna sits [m] in {c}: the lever arm.
    outages_s : tuple of float
        First and last time [s] of each outage, one pair after the other.
    """

    rate_hz: float = 5.0
    white_horizontal_m: float = 1.5
    white_vertical_m: float = 1.5
    coloured_horizontal_m: float = 0.0
    coloured_vertical_m: float = 0.0
    correlation_time_s: float = 60.0
    position_c_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    outages_s: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        white, coloured = self._deviations
        if not (np.isfinite([*white, *coloured, *self.position_c_m, *self.outages_s]).all()):
            raise DataError(f"impossible GPS: {self} holds a number that is not finite")
        if min(*white, *coloured) < 0 or min(self.sigma_m) <= 0:
            raise DataError(f"impossible GPS: errors must not be negative, and their sum above 0, in {self}")
        if not (0 < self.rate_hz < np.inf and 0 < self.correlation_time_s < np.inf):
            raise DataError(f"impossible GPS: rate and correlation time must be positive, in {self}")
        starts, ends = self.outages_s[::2], self.outages_s[1::2]
        if len(starts) != len(ends) or any(a >= b for a, b in zip(starts, ends, strict=True)):
            raise DataError(f"outages {self.outages_s} must be pairs of a first and a later last time [s]")

    @property
    def _deviations(self) -> tuple[Array, Array]:
        horizontal_and_vertical = (
            (self.white_horizontal_m, self.white_vertical_m),
            (self.coloured_horizontal_m, self.coloured_vertical_m),
        )
        white, coloured = (np.array([h, v, h]) for h, v in horizontal_and_vertical)
        return white, coloured

    @property
    def sigma_m(self) -> tuple[float, float, float]:
        """Standard deviation [m] of the whole error along x, y, z of {n}."""
        x, y, z = np.hypot(*self._deviations)
        return float(x), float(y), float(z)


_CEP = math.sqrt(2 * math.log(2))  # 50 % of a circular normal lie within so many deviations
_HALF = 0.6744897501960817  # and of one axis within so many

GPS_PRESETS: dict[str, GpsModel] = {
    "white": GpsModel(),
    "coloured": GpsModel(
        white_horizontal_m=1.5 * math.sqrt(0.5),
        white_vertical_m=1.5 * math.sqrt(0.5),
        coloured_horizontal_m=1.5 * math.sqrt(0.5),
        coloured_vertical_m=1.5 * math.sqrt(0.5),
    ),
    "rtk": GpsModel(white_horizontal_m=0.01 / _CEP, white_vertical_m=0.01 / _HALF),
}
"""Receivers by name. *white*, *coloured*: 1.5 m an axis, all white, or half its variance with 60 s of memory.

Those two are settings to compare by, not a product's. *rtk*: fixed carrier phase on a short base line, u-blox
ZED-F9P's 0.01 m CEP (horizontal) and 0.01 m median (vertical).
"""


@dataclass(frozen=True, eq=False)
class SimulatedGps:
    """Fixes of a GPS receiver, with what they should have been.

    Attributes
    ----------
    times_s : array (N,)
        Times [s] of the camera's clock; none within an outage.
    positions_n_m : array (N, 3)
        Positions [m] of the antenna in {n}, as the receiver tells them.
    sigma_m : array (3,)
        Standard deviation [m] of x, y and z that it claims: that of its honest errors.
    true_positions_n_m : array (N, 3)
        True positions [m] of the antenna.
    coloured_m : array (N, 3)
        Coloured part [m] of the error.
    spoofed_m : array (N, 3)
        What spoofing adds [m].
    spoofed : bool array (N,)
        Whether an attack has begun.
    """

    times_s: Array
    positions_n_m: Array
    sigma_m: Array
    true_positions_n_m: Array
    coloured_m: Array
    spoofed_m: Array
    spoofed: NDArray[np.bool_]


def gauss_markov(white: Array, step_s: float, correlation_time_s: float) -> Array:
    """First-order Gauss-Markov process (N, M) of unit variance, stationary, from standard normals (N, M).

    Parameters
    ----------
    white : array (N, M)
        Independent standard normal draws.
    step_s : float
        Time [s] between rows.
    correlation_time_s : float
        Time [s] within which the autocorrelation falls to 1/e.
    """
    kept = np.exp(-step_s / correlation_time_s)
    driven = white * np.sqrt(1 - kept**2)
    driven[0] = white[0]
    for k in range(1, len(driven)):
        driven[k] += kept * driven[k - 1]
    return driven


def simulate_gps(
    motion: SmoothMotion, model: GpsModel, seed: int, attacks: Sequence[Spoofing] = ()
) -> SimulatedGps:
    """Positions of an antenna along a motion, as a receiver tells them.

    Equal seeds give equal bits; outages and spoofing leave the other fixes' errors as they are.

    Parameters
    ----------
    motion : SmoothMotion
        Of the camera.
    model : GpsModel
        The receiver.
    seed : int
        Seed of its errors.
    attacks : sequence of Spoofing
        Their shifts add up.

    Raises
    ------
    DataError
        If an attack begins outside the flight, or no fix is left.
    """
    for attack in attacks:
        if not motion.start_s <= attack.onset_s < motion.end_s:
            raise DataError(f"{attack} begins outside the flight, {motion.start_s:g} to {motion.end_s:g} s")
    times_s = motion.sample_times(model.rate_hz)
    white_m, coloured_m = model._deviations
    white, driving = (
        np.random.default_rng([seed, _GPS_STREAM, part]).standard_normal((len(times_s), 3))
        for part in range(2)
    )
    slow_m = coloured_m * gauss_markov(driving, 1 / model.rate_hz, model.correlation_time_s)
    true_m = motion.at(times_s).positions_n_m(model.position_c_m)
    shift_m = np.zeros_like(true_m)
    for attack in attacks:
        shift_m += attack.shift_n_m(times_s, motion, model.position_c_m)
    onset_s = min((attack.onset_s for attack in attacks), default=np.inf)
    kept = np.ones(len(times_s), dtype=bool)
    for first_s, last_s in zip(model.outages_s[::2], model.outages_s[1::2], strict=True):
        kept &= (times_s < first_s) | (times_s > last_s)
    if not kept.any():
        raise DataError(f"outages {model.outages_s} s leave no fix")
    measured_m = true_m + shift_m + slow_m + white_m * white
    return SimulatedGps(
        times_s=times_s[kept],
        positions_n_m=measured_m[kept],
        sigma_m=np.array(model.sigma_m),
        true_positions_n_m=true_m[kept],
        coloured_m=slow_m[kept],
        spoofed_m=shift_m[kept],
        spoofed=times_s[kept] >= onset_s,
    )
