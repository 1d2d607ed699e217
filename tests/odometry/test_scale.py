import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from flowlik.errors import DataError
from flowlik.geometry.camera import Pinhole
from flowlik.geometry.motion import exp_se3, h, inverse_range
from flowlik.image.texture import TextureDefinition
from flowlik.likelihood.likelihood import FlowLikelihood
from flowlik.measurement.measurements import Measurements
from flowlik.odometry._seen_lengths import _stereo_disparity
from flowlik.odometry.scale import (
    CameraHeight,
    Length,
    Norm,
    Stereo,
    Unscaled,
    scale_source,
)
from tests.helpers import textured_image

CAMERA = Pinhole(400, 200, 250.0, 250.0, 199.5, 80.0)
T = exp_se3(np.array([0.002, 0.01, -0.001, 0.03, 0.01, -0.9]))
UNIT = RigidTransform.from_components(T.translation / np.linalg.norm(T.translation), T.rotation)
LENGTH = np.linalg.norm(T.translation)
NOISE = 0.1
LIKELIHOOD = FlowLikelihood.constant_gaussian(NOISE)


def measured(pixels, depth, noise=0.0, seed=0, motion=T):
    flow = h(motion, CAMERA, pixels, inverse_range(CAMERA, pixels, depth))
    flow = flow + noise * np.random.default_rng(seed).standard_normal(flow.shape)
    n = len(pixels)
    return Measurements(
        pixels, flow, np.tile(np.eye(2), (n, 1, 1)), np.ones((n, 2)), TextureDefinition(), {"name": "none"}
    )


def across(motion, tilt_deg=0.0, roll_deg=0.0):
    """Normal of a road along a motion but for a tilt, in image k - 1; down is positive."""
    travel = -motion.rotation.inv().apply(motion.translation)
    travel /= np.linalg.norm(travel)
    right = np.cross(travel, [0.0, 1.0, 0.0])
    right /= np.linalg.norm(right)
    tilted = Rotation.from_rotvec(np.radians(tilt_deg) * right) * Rotation.from_rotvec(
        np.radians(roll_deg) * travel
    )
    return tilted.apply(np.cross(right, travel))


def street(height=1.65, seed=0, normal=None, cluttered=0.2, motion=T):
    """Pixels with depths: a road below the horizon with other things on it, and houses above."""
    rng = np.random.default_rng(seed)
    pixels = rng.uniform([0, 0], [399, 199], (900, 2))
    down = CAMERA.rays(pixels) @ (across(motion) if normal is None else normal)
    depth = np.where(down > 0.04, height / np.maximum(down, 0.04), rng.uniform(8, 40, 900))
    beside = rng.random(900) < cluttered
    return pixels, np.where(beside, rng.uniform(3, 30, 900), depth)


def told(source, pixels, depth, noise=0.0, seed=0, motion=T):
    unit = RigidTransform.from_components(
        motion.translation / np.linalg.norm(motion.translation), motion.rotation
    )
    return source.length(1, measured(pixels, depth, noise, seed, motion), CAMERA, unit, LIKELIHOOD)


@pytest.mark.parametrize("height", [1.2, 1.65])
def test_the_height_over_the_road_gives_the_length(height):
    exact = told(CameraHeight(height), *street(height, cluttered=0.0))
    assert exact.metres == pytest.approx(LENGTH, rel=1e-4)
    among_others = told(CameraHeight(height), *street(height), noise=NOISE)
    assert among_others.metres == pytest.approx(LENGTH, rel=0.02)
    assert 0 < among_others.sigma_m < 0.05 * LENGTH


def test_a_length_is_within_its_bound_as_often_as_it_says():
    """Roads tilt against the direction of travel and a car sits on its springs, as the source expects."""
    rng, errors = np.random.default_rng(3), []
    for seed in range(40):
        normal = across(T, *(rng.standard_normal(2).clip(-2.5, 2.5) * [0.31, 2.0]))
        height = 1.65 + 0.015 * rng.standard_normal()
        length = told(CameraHeight(1.65), *street(height, seed, normal), NOISE, seed)
        errors.append((length.metres - LENGTH) / length.sigma_m)
    assert np.mean(np.abs(errors) < 1.96) >= 0.9
    assert 0.6 < np.std(errors) < 1.4


@pytest.mark.parametrize("curvature", [-1 / 300, 1 / 300])
def test_a_road_that_rises_or_falls_ahead_is_no_other_length(curvature):
    pixels, depth = street(cluttered=0.0)
    down = CAMERA.rays(pixels) @ across(T)
    on_road = down > 0.05
    bent = depth[on_road]
    for _ in range(50):  # height 1.65 + curvature z^2 / 2 at the depth z
        bent = (1.65 + curvature * np.minimum(bent, 30) ** 2 / 2) / down[on_road]
    length = told(CameraHeight(1.65), pixels[on_road], bent, NOISE)
    assert abs(length.metres - LENGTH) < 1.96 * length.sigma_m
    flat = told(CameraHeight(1.65), pixels[on_road], depth[on_road], NOISE)
    assert length.sigma_m < 2.5 * flat.sigma_m


@pytest.mark.parametrize("step", [0.3, 0.05])
def test_a_slower_step_is_known_less_well(step):
    slow = RigidTransform.from_components(T.translation * step, T.rotation)
    shares = []
    for motion in (T, slow):
        length = told(CameraHeight(1.65), *street(motion=motion), NOISE, motion=motion)
        if length is None:
            assert step < 0.1
            return
        assert abs(length.metres - np.linalg.norm(motion.translation)) < 4 * length.sigma_m
        shares.append(length.sigma_m / length.metres)
    assert shares[1] > 1.2 * shares[0]


def test_without_a_road_there_is_no_length():
    pixels, depth = street()
    above = pixels[:, 1] < 80
    assert told(CameraHeight(1.65), pixels[above], depth[above]) is None
    assert told(CameraHeight(1.65), pixels[:0], depth[:0]) is None


@pytest.mark.parametrize("depth_m", [4.0, 8.0, 20.0])
def test_a_wall_or_a_vehicle_that_fills_the_image_gives_no_length(depth_m):
    pixels, _ = street()
    for seed in range(10):
        assert told(CameraHeight(1.65), pixels, np.full(len(pixels), depth_m), NOISE, seed) is None


def test_things_at_random_depths_are_no_road():
    for seed in range(10):
        assert told(CameraHeight(1.65), *street(seed=seed, cluttered=1.0), NOISE, seed) is None


def test_a_lift_drives_along_no_road():
    up = exp_se3(np.array([0, 0, 0, 0, -0.5, 0.0]))
    pixels, depth = street(motion=T)
    assert told(CameraHeight(1.65), pixels, depth, NOISE, motion=up) is None


def test_the_motions_error_enters_the_length():
    source, scene, step = CameraHeight(1.65), street(cluttered=0.0), 1e-5
    m = measured(*scene)
    length = source.length(1, m, CAMERA, UNIT, LIKELIHOOD)
    for i in range(3):  # the road is taken to lie along the travel, so that only turns can be told apart
        turned = exp_se3(step * np.eye(6)[i]) * UNIT
        moved = RigidTransform.from_components(
            turned.translation / np.linalg.norm(turned.translation), turned.rotation
        )
        change = np.log(source.length(1, m, CAMERA, moved, LIKELIHOOD).metres / length.metres) / step
        assert length.by_motion[i] == pytest.approx(change, rel=0.1, abs=0.5)
    C = np.diag([1e-6, 1e-6, 1e-6, 0, 0, 0])
    assert length.sigma_with(C) == pytest.approx(
        np.hypot(length.sigma_m, length.metres * 1e-3 * np.linalg.norm(length.by_motion[:3]))
    )


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
    length = told(Stereo(Pair()), pixels, depth, 0.05)
    assert length.metres == pytest.approx(LENGTH, rel=0.02)
    assert abs(length.metres - LENGTH) < 3 * length.sigma_m < 0.1 * LENGTH
    other = np.where(rng.random(300) < 0.9, rng.uniform(1, 60, 300), depth)
    assert told(Stereo(Pair()), pixels, other, 0.05) is None
    assert told(Stereo(Pair()), pixels[:5], depth[:5]) is None


def test_a_gps_says_how_well_it_knows_a_step():
    steps, accuracy = {1: 0.9, 2: 0.05, 3: np.nan}, 0.05
    gps = Norm("gps-norm", steps.__getitem__, lambda k: np.hypot(accuracy, accuracy))
    m = measured(*street())
    length = gps.length(1, m, CAMERA, UNIT, LIKELIHOOD)
    assert (length.metres, length.sigma_m) == (0.9, pytest.approx(0.0707, abs=1e-4))
    assert gps.length(2, m, CAMERA, UNIT, LIKELIHOOD) is None  # its noise is as long
    assert gps.length(3, m, CAMERA, UNIT, LIKELIHOOD) is None


def test_sources_are_found_by_name_and_say_what_they_lack():
    m = measured(*street())
    truth = scale_source("truth-norm", Pair()).length(3, m, CAMERA, UNIT, LIKELIHOOD)
    assert (truth.metres, truth.sigma_m) == (pytest.approx(2.0), 0.0)
    assert scale_source("none", Pair()).length(3, m, CAMERA, UNIT, LIKELIHOOD) is None
    assert isinstance(scale_source("none", Pair()), Unscaled)
    assert scale_source("camera-height", Pair(), 1.2) == CameraHeight(1.2)
    assert scale_source("stereo", Pair()).name == "stereo"
    with pytest.raises(DataError, match="GPS"):
        scale_source("gps-norm", Pair())
    with pytest.raises(DataError, match="unknown scale source 'guess'"):
        scale_source("guess", Pair())
    with pytest.raises(DataError, match="needs --camera-height"):
        scale_source("camera-height", Pair())
    with pytest.raises(DataError, match="no use with --scale stereo"):
        scale_source("stereo", Pair(), 1.65)
    with pytest.raises(DataError, match="must be positive"):
        scale_source("camera-height", Pair(), -1.0)
    walked = Pair()
    walked.gps_positions = np.cumsum(np.tile([0.0, 3.0, 4.0], (5, 1)), axis=0)
    with pytest.raises(DataError, match="accuracy"):
        scale_source("gps-norm", walked)
    walked.gps_accuracy_m = np.full(5, 0.1)
    length = scale_source("gps-norm", walked).length(2, m, CAMERA, UNIT, LIKELIHOOD)
    assert (length.metres, length.sigma_m) == (pytest.approx(5.0), pytest.approx(0.1414, abs=1e-4))


def test_an_exact_length_has_no_error_of_the_motion():
    assert Length(2.0).sigma_with(np.eye(6)) == 0
