"""Daylight: the sun, the sky and the air."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flowlik.errors import DataError


@dataclass(frozen=True)
class Daylight:
    """Light of a scene. A white surface in full sun has radiance ``sun + sky``; 1 saturates the sensor.

    Parameters
    ----------
    azimuth_deg, elevation_deg : float
        Where the sun stands: azimuth from z towards x, elevation above the horizon (0 to 90).
    sun, sky : float
        Irradiance of the sun on a surface that faces it, and of the whole sky.
    haze_per_m : float
        Share of light lost to haze a metre [1/m]; the haze itself shines like the horizon.
    horizon, zenith : float
        Radiance of the clear sky there.
    clouds : float
        Share of the sky that is clouded, 0 to 1.
    """

    azimuth_deg: float = 128.0
    elevation_deg: float = 48.0
    sun: float = 1.7
    sky: float = 0.28
    haze_per_m: float = 0.0012
    horizon: float = 0.9
    zenith: float = 0.55
    clouds: float = 0.5

    def __post_init__(self) -> None:
        if not 0 < self.elevation_deg <= 90 or min(self.sun, self.sky, self.haze_per_m, self.horizon) < 0:
            raise DataError(f"impossible {self}: the sun must be above the horizon, no light negative")

    @property
    def to_sun(self) -> NDArray[np.float64]:
        """Unit vector (3,) in {n} towards the sun; y is down."""
        azimuth, elevation = np.deg2rad([self.azimuth_deg, self.elevation_deg])
        level = np.cos(elevation)
        return np.array([level * np.sin(azimuth), -np.sin(elevation), level * np.cos(azimuth)])
