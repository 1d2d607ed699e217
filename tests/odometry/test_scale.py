import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

from flowlik.errors import DataError
from flowlik.geometry.camera import Pinhole
from flowlik.geometry.motion import exp_se3, h, inverse_range
from flowlik.image.texture import TextureDefinition
from flowlik.measurement.measurements import Measurements
from flowlik.odometry.scale import (
    CameraHeight,
    Norm,
    Stereo,
    Unscaled,
    _stereo_disparity,
    _triangulated,
    scale_source,
)
from tests.helpers import textured_image

CAMERA = Pinhole(400, 200, 250.0, 250.0, 199.5, 80.0)
T = exp_se3(np.array([0.002, 0.01, -0.001, 0.03, 0.01, -0.9]))
UNIT = RigidTransform.from_components(T.translation / np.linalg.norm(T.translation), T.rotation)
LENGTH = np.linalg.norm(T.translation)


def measured(pixels, depth, noise=0.0, seed=0):
    flow = h(T, CAMERA, pixels, inverse_range(CAMERA, pixels, depth))
    flow = flow + noise * np.random.default_rng(seed).standard_normal(flow.shape)
    n = len(pixels)
    return Measurements(
        pixels, flow, np.tile(np.eye(2), (n, 1, 1)), np.ones((n, 2)), TextureDefinition(), {"name": "none"}
    )


def street(height=1.65, seed=0):
    """Pixels with depths: a road below the horizon, and houses at random depths above."""
    rng = np.random.default_rng(seed)
    pixels = rng.uniform([0, 0], [399, 199], (900, 2))
    down = CAMERA.rays(pixels)[:, 1]
    depth = np.where(down > 0.04, height / np.maximum(down, 0.04), rng.uniform(8, 40, 900))
    beside = rng.random(900) < 0.2
    return pixels, np.where(beside, rng.uniform(5, 30, 900), depth)


def test_depths_are_triangulated_in_units_of_the_motion():
    pixels, depth = street()
    found, parallax = _triangulated(measured(pixels, depth), CAMERA, UNIT)
    clear = parallax > 1
    np.testing.assert_allclose(found[clear] * LENGTH, depth[clear], rtol=1e-6)


@pytest.mark.parametrize("height", [1.2, 1.65])
def test_the_height_over_the_road_gives_the_length(height):
    m = measured(*street(height), noise=0.1)
    length = CameraHeight(height).length_m(1, m, CAMERA, UNIT)
    assert length == pytest.approx(LENGTH, rel=0.02)


def test_without_a_road_there_is_no_length():
    pixels, depth = street()
    above = pixels[:, 1] < 80
    assert CameraHeight().length_m(1, measured(pixels[above], depth[above]), CAMERA, UNIT) is None
    with pytest.raises(DataError, match="height"):
        CameraHeight(-1.0)


class Pair:
    """A wall seen by two cameras: the right image is the left one moved by the disparity."""

    baseline_m, disparity = 0.5, 12.0
    name = "pair"
    left = textured_image((200, 400))
    right = textured_image((200, 400), shift=(-12.0, 0.0))

    def image(self, k):
        return self.left

    def right_image(self, k):
        return self.right

    def T_n_c(self, k):
        return RigidTransform.from_translation([0, 0, 2.0 * k])


def test_stereo_gives_the_length():
    disparity = _stereo_disparity(Pair.left, Pair.right)
    assert np.nanmedian(disparity) == pytest.approx(Pair.disparity, abs=0.1)
    rng = np.random.default_rng(1)
    pixels = np.floor(rng.uniform([150, 10], [390, 190], (300, 2)))
    depth = np.full(300, CAMERA.fx * Pair.baseline_m / Pair.disparity)
    length = Stereo(Pair()).length_m(1, measured(pixels, depth, 0.05), CAMERA, UNIT)
    assert length == pytest.approx(LENGTH, rel=0.02)


def test_sources_are_found_by_name_and_say_what_they_lack():
    m = measured(*street())
    assert scale_source("truth-norm", Pair()).length_m(3, m, CAMERA, UNIT) == pytest.approx(2.0)
    assert scale_source("none", Pair()).length_m(3, m, CAMERA, UNIT) is None
    assert isinstance(scale_source("none", Pair()), Unscaled)
    assert scale_source("camera-height", Pair(), 1.2) == CameraHeight(1.2)
    assert scale_source("stereo", Pair()).name == "stereo"
    with pytest.raises(DataError, match="OXTS"):
        scale_source("gps-norm", Pair())
    with pytest.raises(DataError, match="unknown scale source 'guess'"):
        scale_source("guess", Pair())
    walked = Pair()
    walked.gps_positions = np.cumsum(np.tile([0.0, 3.0, 4.0], (5, 1)), axis=0)
    assert isinstance(scale_source("gps-norm", walked), Norm)
    assert scale_source("gps-norm", walked).length_m(2, m, CAMERA, UNIT) == pytest.approx(5.0)
