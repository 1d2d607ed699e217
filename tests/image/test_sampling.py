"""Maps read between pixels: exact on a surface, never a mixture across an edge."""

from __future__ import annotations

import numpy as np
import pytest

from flowlik.geometry.camera import Pinhole
from flowlik.image.sampling import sample_flow, sample_inverse_depth

CAMERA = Pinhole(64, 48, 60.0, 60.0, 31.5, 23.5)
NORMAL = np.array([0.1, -0.9, -0.21])


def plane_depth(pixels):
    """Depth [m] of the plane n . p = -4 that the camera looks down on."""
    return -4.0 / (CAMERA.rays(pixels) @ NORMAL)


def test_inverse_depth_of_a_plane_is_exact_between_pixels():
    depth = plane_depth(CAMERA.pixel_grid()).reshape(48, 64)
    pixels = np.random.default_rng(0).uniform([2, 34], [61, 46], (200, 2))
    np.testing.assert_allclose(sample_inverse_depth(depth, pixels), 1 / plane_depth(pixels), rtol=1e-12)


@pytest.mark.parametrize("hole", [np.nan, np.inf, 3.0])
def test_an_edge_is_not_interpolated_across(hole):
    depth = np.full((8, 10), 2.0)
    depth[:, 5:] = hole
    pixels = np.array([[4.4, 3.3], [4.6, 3.3], [3.7, 3.3]])
    np.testing.assert_array_equal(sample_inverse_depth(depth, pixels), [0.5, 1 / hole, 0.5])


def test_whole_pixels_are_read_as_they_are():
    rng = np.random.default_rng(1)
    flow = rng.normal(size=(6, 7, 2))
    flow[2, 3] = np.nan
    v, u = np.mgrid[0:6, 0:7]
    pixels = np.stack([u.ravel(), v.ravel()], axis=-1).astype(float)
    np.testing.assert_array_equal(sample_flow(flow, pixels), flow.reshape(-1, 2))


def test_flow_that_varies_evenly_is_interpolated_and_a_jump_is_not():
    v, u = np.mgrid[0:10, 0:12].astype(float)
    flow = np.stack([0.01 * u + 1, 0.02 * v], axis=-1)
    flow[:, 8:, 0] += 3
    pixels = np.array([[3.25, 4.5], [7.4, 4.25], [7.6, 4.25]])
    expected = [[1.0325, 0.09], [1.07, 0.08], [4.08, 0.08]]
    np.testing.assert_allclose(sample_flow(flow, pixels), expected, atol=1e-12)
