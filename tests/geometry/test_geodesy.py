"""Geodetic coordinates against published values and the ellipsoid's own curvature."""

import numpy as np

from flowlik.geometry.geodesy import (
    ECCENTRICITY_SQUARED,
    SEMI_MAJOR_M,
    earth_centred,
    east_north_up,
)


def test_earth_centred_positions_are_those_of_another_library():
    """Values of pymap3d's own tests, which are Matlab's."""
    found = earth_centred(
        np.array([42.0, 0.0, 90.0]), np.array([-82.0, 0.0, 30.0]), np.array([200.0, 0.0, 0.0])
    )
    expected = [[660675.2518247, -4700948.68316, 4245737.66222], [SEMI_MAJOR_M, 0, 0], [0, 0, 6356752.314245]]
    np.testing.assert_allclose(found, expected, atol=1e-5)


def test_east_north_up_is_that_of_another_library():
    """pymap3d: azimuth 33, elevation 70 degrees, 1000 m; its latitude and longitude have six decimals."""
    found = east_north_up(*np.array([[42.002582], [-81.997752], [1139.7018]]), (42.0, -82.0, 200.0))
    np.testing.assert_allclose(found[0], [186.277521, 286.842228, 939.692621], atol=0.06)


def test_small_steps_are_those_of_the_radii_of_curvature():
    origin = (49.0, 8.4, 115.0)
    curved = 1 - ECCENTRICITY_SQUARED * np.sin(np.deg2rad(49.0)) ** 2
    meridian_m = SEMI_MAJOR_M * (1 - ECCENTRICITY_SQUARED) / curved**1.5 + 115
    parallel_m = (SEMI_MAJOR_M / np.sqrt(curved) + 115) * np.cos(np.deg2rad(49.0))
    step = np.deg2rad(1e-5)
    latitude, longitude, height = np.array([49.00001, 49.0, 49.0]), np.array([8.4, 8.40001, 8.4]), 115.0
    found = east_north_up(latitude, longitude, np.array([height, height, height + 2]), origin)
    np.testing.assert_allclose(
        found, [[0, meridian_m * step, 0], [parallel_m * step, 0, 0], [0, 0, 2]], atol=2e-6
    )
