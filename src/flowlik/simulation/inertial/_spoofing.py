"""How a spoofer shifts the position that a GPS receiver computes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from flowlik.errors import DataError
from flowlik.simulation.inertial._kinematics import SmoothMotion
from flowlik.support.arrays import Array


class Spoofing(Protocol):
    """One attack: a shift of the position, zero before its onset."""

    @property
    def onset_s(self) -> float:
        """Time [s] of the camera's clock at which it begins; it lasts to the end."""
        ...

    def shift_n_m(self, times_s: Array, motion: SmoothMotion, position_c_m: tuple[float, ...]) -> Array:
        """Shift (N, 3) [m] in {n} of an antenna that is fixed in {c}."""
        ...


@dataclass(frozen=True)
class Jump:
    """The position is wrong by a constant shift from the onset on.

    Attributes
    ----------
    onset_s : float
        Time [s] at which it begins.
    distance_m : float
        Length [m] of the shift, level.
    heading_deg : float
        Its direction [deg]: 0 along z of {n}, 90 along x.
    """

    onset_s: float
    distance_m: float
    heading_deg: float = 90.0

    def __post_init__(self) -> None:
        _check_finite(self)

    def shift_n_m(self, times_s: Array, motion: SmoothMotion, position_c_m: tuple[float, ...]) -> Array:
        """Shift (N, 3) [m] in {n}."""
        return np.outer(self.distance_m * (times_s >= self.onset_s), _direction(self.heading_deg))


@dataclass(frozen=True)
class CarryOff:
    """The position leaves the true one at a constant speed from the onset on.

    Attributes
    ----------
    onset_s : float
        Time [s] at which it begins.
    rate_mps : float
        Speed [m/s] of the shift, level.
    heading_deg : float
        Its direction [deg]: 0 along z of {n}, 90 along x.
    """

    onset_s: float
    rate_mps: float
    heading_deg: float = 90.0

    def __post_init__(self) -> None:
        _check_finite(self)

    def shift_n_m(self, times_s: Array, motion: SmoothMotion, position_c_m: tuple[float, ...]) -> Array:
        """Shift (N, 3) [m] in {n}."""
        since_s = np.maximum(times_s - self.onset_s, 0.0)
        return np.outer(self.rate_mps * since_s, _direction(self.heading_deg))


@dataclass(frozen=True)
class Replay:
    """Signals are recorded and sent again: the position is where the antenna was.

    Attributes
    ----------
    onset_s : float
        Time [s] at which it begins.
    delay_s : float
        How old [s] the signals are.
    """

    onset_s: float
    delay_s: float

    def __post_init__(self) -> None:
        _check_finite(self)
        if self.delay_s <= 0:
            raise DataError(f"a replay is of the past: delay_s {self.delay_s:g} must be positive")

    def shift_n_m(self, times_s: Array, motion: SmoothMotion, position_c_m: tuple[float, ...]) -> Array:
        """Shift (N, 3) [m] in {n}.

        Raises
        ------
        DataError
            If signals from before the first frame are replayed.
        """
        if self.onset_s - self.delay_s < motion.start_s:
            raise DataError(
                f"a replay from {self.onset_s:g} s on of signals {self.delay_s:g} s old begins before the "
                f"flight, at {motion.start_s:g} s"
            )
        shift = np.zeros((len(times_s), 3))
        active = times_s >= self.onset_s
        now = motion.at(times_s[active]).positions_n_m(position_c_m)
        shift[active] = motion.at(times_s[active] - self.delay_s).positions_n_m(position_c_m) - now
        return shift


def _direction(heading_deg: float) -> Array:
    angle = np.deg2rad(heading_deg)
    return np.array([np.sin(angle), 0.0, np.cos(angle)])


def _check_finite(attack: object) -> None:
    bad = [name for name, value in vars(attack).items() if not np.isfinite(value)]
    if bad:
        raise DataError(f"spoofing: {bad[0]} is not finite")
