"""LiDAR as known depth: a wall and a post that are formulas, and images of a wall that moves."""

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from flowlik.egomotion import Status, mle
from flowlik.errors import DataError
from flowlik.flow import LucasKanade
from flowlik.fusion import LidarNoise, lidar_motion, sparse_depth
from flowlik.geometry.camera import Pinhole
from flowlik.likelihood.likelihood import FlowLikelihood
from tests.helpers import textured_image

CAMERA = Pinhole(160, 120, 120.0, 120.0, 79.5, 59.5)
# LiDAR: x forward, y left, z up, a little above the camera
T_C_L = RigidTransform.from_components(
    [0.0, -0.1, 0.05], Rotation.from_matrix([[0, -1, 0], [0, 0, -1], [1, 0, 0]])
)


def wall(n_c: np.ndarray) -> np.ndarray:
    """Points in LiDAR's axes of the plane n . p = 1 of {c}, one each four pixels."""
    v, u = np.mgrid[2:118:4, 2:158:4]
    rays = CAMERA.rays(np.stack([u.ravel(), v.ravel()], axis=1).astype(float))
    return T_C_L.inv().apply(rays / (rays @ n_c)[:, None])


def test_depth_is_that_of_the_wall_and_its_slope_that_of_the_plane():
    n_c = np.array([0.05, 0.0, 0.2])
    noise = LidarNoise(0.02, 1.5)
    found = sparse_depth(wall(n_c), T_C_L, CAMERA, noise)
    rays = CAMERA.p2v(found.pixels)
    np.testing.assert_allclose(found.inverse_range, rays @ n_c, rtol=1e-9)
    inside = np.abs(found.pixels - [79.5, 59.5]).max(axis=1) < 40
    right, down = (CAMERA.p2v(found.pixels + step) @ n_c - rays @ n_c for step in ([1, 0], [0, 1]))
    steepest = np.hypot(right, down)[inside]
    # the root mean square over directions is the steepest slope by the root of two
    assert abs(np.median(found.slope[inside] / steepest) - np.sqrt(0.5)) < 0.1
    expected = np.hypot(0.02 * found.inverse_range**2, 1.5 * found.slope)
    np.testing.assert_allclose(found.inverse_range_sd, expected)


def test_what_a_post_hides_is_left_out_and_its_edge_is_uncertain():
    post = wall(np.array([0.0, 0.0, 0.5]))
    post = post[np.abs(T_C_L.apply(post)[:, 0]) < 0.1]
    far = wall(np.array([0.0, 0.0, 0.1]))
    far += [0, 0.12, 0]  # points between those of the post
    found = sparse_depth(np.vstack([post, far]), T_C_L, CAMERA, LidarNoise(0.02, 1.0))
    near = found.inverse_range > 0.3
    beside = np.abs(found.pixels[:, 0] - 79.5) < 4
    assert near[beside].all()
    assert found.slope[near].min() > 10 * np.median(found.slope[~near])


def test_motion_from_a_wall_of_sparse_points():
    """A wall 4 m away that is shifted by 2 px aside and 1 px down: 6.7 and 3.3 cm."""
    previous, current = (textured_image((120, 160), 3, shift) for shift in ((0, 0), (2.0, 1.0)))
    depth = sparse_depth(wall(np.array([0.0, 0.0, 0.25])), T_C_L, CAMERA, LidarNoise(0.02, 1.0))
    estimator = mle(FlowLikelihood.constant_gaussian(0.1))
    motion = lidar_motion(previous, current, depth, CAMERA, LucasKanade(), estimator)
    assert motion.status is Status.SOLVED
    predicted = motion.T_k_prev.apply([0.0, 0.0, 4.0]) - [0.0, 0.0, 4.0]
    np.testing.assert_allclose(predicted[:2], [2 / 30, 1 / 30], atol=3e-3)


def test_refusals():
    with pytest.raises(DataError, match="0 of 1131 LiDAR points fall into the image"):
        sparse_depth(-wall(np.array([0.0, 0.0, 0.2])), T_C_L, CAMERA, LidarNoise(0.02, 1.0))
    with pytest.raises(DataError, match="finite and not negative"):
        LidarNoise(-0.02, 1.0)
