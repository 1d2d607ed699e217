import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from flowlik.errors import DataError
from flowlik.geometry.camera import Pinhole
from tests.helpers import CAMERA, finite_difference

POINTS = np.random.default_rng(0).uniform([-5, -5, 0.5], [5, 5, 30], (200, 3))


@given(
    u=st.floats(-500, 2500),
    v=st.floats(-500, 2500),
    length=st.floats(1e-3, 1e3),
    fx=st.floats(50, 3000),
    fy=st.floats(50, 3000),
)
def test_v2p_inverts_p2v_at_any_length(u, v, length, fx, fy):
    camera = Pinhole(2000, 1500, fx, fy, 1001.5, 740.0)
    direction = camera.p2v(np.array([[u, v]]))
    assert np.linalg.norm(direction) == pytest.approx(1, abs=1e-15)
    np.testing.assert_allclose(camera.v2p(length * direction), [[u, v]], rtol=0, atol=1e-9)


def test_v2p_agrees_with_opencv():
    pixels, _ = cv2.projectPoints(POINTS, np.zeros(3), np.zeros(3), CAMERA.K, None)
    np.testing.assert_allclose(CAMERA.v2p(POINTS), pixels[:, 0], rtol=0, atol=1e-10)


def test_rays_times_depth_are_points():
    rays = CAMERA.rays(CAMERA.v2p(POINTS))
    np.testing.assert_allclose(POINTS[:, 2:] * rays, POINTS, rtol=0, atol=1e-12)


def test_jacobian_of_v2p_is_its_derivative():
    jacobian = CAMERA.v2p_jacobian(POINTS)
    for point, J in zip(POINTS[:20], jacobian):
        numeric = finite_difference(CAMERA.v2p, point, 1e-5)
        np.testing.assert_allclose(J, numeric, rtol=1e-7, atol=1e-6)


def test_a_vector_that_does_not_point_forwards_has_no_pixel():
    assert np.isnan(CAMERA.v2p(np.array([[1, 1, -1.0], [1, 1, 0]]))).all()


@pytest.mark.parametrize("fov_deg", [30.0, 90.0, 120.0])
def test_field_of_view_is_the_angle_between_the_outer_edges(fov_deg):
    camera = Pinhole.from_fov(320, 180, fov_deg)
    left, right = camera.p2v(np.array([[-0.5, camera.cy], [319.5, camera.cy]]))
    assert np.rad2deg(np.arccos(left @ right)) == pytest.approx(fov_deg, abs=1e-9)


def test_pixel_grid_is_in_the_order_of_an_image():
    grid = Pinhole.from_fov(5, 3, 90).pixel_grid().reshape(3, 5, 2)
    np.testing.assert_array_equal(grid[2, 4], [4, 2])
    np.testing.assert_array_equal(grid[1, 3], [3, 1])


def test_an_image_ends_at_its_outermost_pixel_centres():
    pixels = np.array([[0, 0], [639, 479], [-0.01, 5], [639.01, 5], [5, 479.01], [np.nan, 5]])
    np.testing.assert_array_equal(CAMERA.contains(pixels), [True, True, False, False, False, False])


@pytest.mark.parametrize(
    "values",
    [(0, 480, 4, 4, 0, 0), (640, -1, 4, 4, 0, 0), (640, 480, 0, 4, 0, 0), (640, 480, 4, -4, 0, 0),
     (640, 480, np.nan, 4, 0, 0), (640, 480, 4, 4, np.inf, 0)],
)  # fmt: skip
def test_impossible_cameras_are_refused(values):
    with pytest.raises(DataError, match="impossible camera"):
        Pinhole(*values)


@pytest.mark.parametrize("fov_deg", [0, 180, -10, np.nan])
def test_impossible_fields_of_view_are_refused(fov_deg):
    with pytest.raises(DataError, match="field of view"):
        Pinhole.from_fov(320, 180, fov_deg)
