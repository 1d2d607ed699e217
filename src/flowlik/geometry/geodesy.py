"""Latitude, longitude and height to metres east, north and up (WGS84)."""

from __future__ import annotations

import numpy as np

from flowlik.support.arrays import Array

SEMI_MAJOR_M = 6378137.0
FLATTENING = 1 / 298.257223563
ECCENTRICITY_SQUARED = FLATTENING * (2 - FLATTENING)


def earth_centred(latitude_deg: Array, longitude_deg: Array, height_m: Array) -> Array:
    """Earth-centred, earth-fixed positions (..., 3) [m] of geodetic coordinates on WGS84's ellipsoid."""
    latitude, longitude = np.deg2rad(latitude_deg), np.deg2rad(longitude_deg)
    normal_m = SEMI_MAJOR_M / np.sqrt(1 - ECCENTRICITY_SQUARED * np.sin(latitude) ** 2)
    level_m = (normal_m + height_m) * np.cos(latitude)
    up_m = (normal_m * (1 - ECCENTRICITY_SQUARED) + height_m) * np.sin(latitude)
    return np.stack([level_m * np.cos(longitude), level_m * np.sin(longitude), up_m], axis=-1)


def east_north_up(
    latitude_deg: Array, longitude_deg: Array, height_m: Array, origin: tuple[float, float, float]
) -> Array:
    """Positions (N, 3) [m] east, north and up of an origin; no projection, so that they are true lengths.

    Parameters
    ----------
    latitude_deg, longitude_deg, height_m : array (N,)
        Geodetic coordinates; height above the ellipsoid.
    origin : tuple of 3 float
        Latitude [deg], longitude [deg] and height [m] of the origin.
    """
    latitude, longitude = np.deg2rad(origin[:2])
    s, c, sl, cl = np.sin(latitude), np.cos(latitude), np.sin(longitude), np.cos(longitude)
    R_enu_ecef = np.array([[-sl, cl, 0], [-s * cl, -s * sl, c], [c * cl, c * sl, s]])
    centre = earth_centred(*(np.asarray(value, dtype=np.float64) for value in origin))
    return (earth_centred(latitude_deg, longitude_deg, height_m) - centre) @ R_enu_ecef.T
