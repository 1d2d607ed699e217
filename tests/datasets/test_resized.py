"""Resized sequences: what counts in pixels is scaled with the images, about the pixels' centres."""

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from flowlik.datasets import Lens, open_sequence, resized
from flowlik.datasets._frames import DepthFrames
from flowlik.datasets._lens_models import BrownConrady
from flowlik.datasets._resized import Resize
from flowlik.datasets.base import frame_pairs
from flowlik.datasets.next_frame import motion_to_next, true_flow
from flowlik.errors import DataError, MissingFieldError
from flowlik.geometry.camera import Pinhole

from .fakes import make_kitti_flow, picture, save

W, H = 96, 64
CAMERA = Pinhole(W, H, 80.0, 81.0, 45.0, 33.0)
NORMAL, HEIGHT_M = np.array([0.2, -0.1, 1.0]), 4.0
TURN = Rotation.from_rotvec([0.01, 0.02, -0.03])


def plane_depth(camera):
    """Depth along z of the plane normal . X = 4 m, in closed form."""
    rays = camera.rays(camera.pixel_grid())
    return (HEIGHT_M / (rays @ NORMAL)).reshape(camera.height, camera.width)


class Plane(DepthFrames):
    """A slanted plane before a moving camera; a box of 2 m in its middle where asked for."""

    camera, box = CAMERA, False

    def depth(self, k):
        depth = plane_depth(CAMERA)
        if self.box:
            depth[20:41, 30:61] = 2.0
        return depth

    def T_n_c(self, k):
        return RigidTransform.from_components([0.05 * k, -0.02 * k, 0.1 * k], TURN**k)

    def timestamp(self, k):
        return float(k)


@pytest.fixture
def plane(tmp_path):
    u, v = np.meshgrid(np.arange(W), np.arange(H))
    files = [save(tmp_path / f"{k}.png", (2 * u + v).astype(np.uint8)) for k in range(2)]
    return Plane("plane", files)


SIZES = ["0.5", "2", "48x32", "32x32", "60x40", "192x128", "0.25"]


@pytest.mark.parametrize("size", SIZES)
def test_the_camera_sees_the_same_rays(plane, size):
    """A point at u is at (u + 1/2) s - 1/2: the image's borders, at -1/2 and W - 1/2, stay where they are."""
    camera = resized(plane, size).camera
    scale = np.array([camera.width / W, camera.height / H])
    pixels = np.array([[-0.5, -0.5], [W - 0.5, H - 0.5], [10.0, 20.0]])
    np.testing.assert_allclose(camera.rays((pixels + 0.5) * scale - 0.5), CAMERA.rays(pixels), atol=1e-12)
    borders = (pixels[:2] + 0.5) * scale - 0.5
    np.testing.assert_allclose(borders, [[-0.5, -0.5], [camera.width - 0.5, camera.height - 0.5]])


@pytest.mark.parametrize("size", ["0.5", "0.25", "48x32", "60x40", "192x128"])
def test_images_are_scaled_about_pixel_centres(plane, size):
    """A ramp keeps its values at the places that the camera says, within rounding."""
    sequence = resized(plane, size)
    image = sequence.image(0)
    assert image.shape == (sequence.camera.height, sequence.camera.width) == sequence.shape
    rays = sequence.camera.rays(sequence.camera.pixel_grid())
    before = CAMERA.v2p(rays).reshape(*image.shape, 2)
    inner = (slice(2, -2), slice(2, -2))
    ramp = 2 * before[..., 0] + before[..., 1]
    assert np.abs(image - ramp)[inner].max() < 0.6


@pytest.mark.parametrize("size", SIZES)
def test_depth_is_that_of_the_resized_pixels(plane, size):
    sequence = resized(plane, size)
    found, expected = sequence.depth(0), plane_depth(sequence.camera)
    inner = (slice(2, -2), slice(2, -2))
    np.testing.assert_allclose(found[inner], expected[inner], rtol=1e-9)


@pytest.mark.parametrize("size", ["0.5", "60x40", "192x128"])
def test_depth_is_not_mixed_over_edges(plane, size):
    plane.box = True
    sequence = resized(plane, size)
    depth, far = sequence.depth(0), plane_depth(sequence.camera)
    on_box = np.isclose(depth, 2.0)
    on_plane = np.isclose(depth, far, rtol=0.02)
    inner = (slice(2, -2), slice(2, -2))
    assert (on_box ^ on_plane)[inner].all()
    assert on_box.mean() == pytest.approx(21 * 31 / (H * W), rel=0.1)


def test_unknown_depth_stays_unknown(plane):
    far = np.where(np.arange(H)[:, None] < 20, np.inf, 3.0)
    plane.depth = lambda k: np.where(np.arange(W) < 48, np.nan, far)
    depth = resized(plane, "0.5").depth(0)
    assert np.isnan(depth[:, :24]).all()
    assert np.isposinf(depth[:9, 25:]).all()
    np.testing.assert_allclose(depth[11:, 25:], 3.0)


@pytest.mark.parametrize("size", ["0.5", "32x32", "192x128"])
def test_flow_is_that_of_the_resized_camera(plane, size):
    sequence = resized(plane, size)
    found = sequence.flow(0)
    expected = true_flow(sequence.camera, plane_depth(sequence.camera), motion_to_next(plane, 0))
    inner = (slice(3, -3), slice(3, -3))
    assert np.abs(expected).max() > 1.5
    np.testing.assert_allclose(found[inner], expected[inner], atol=0.01)


def test_what_else_there_is(plane):
    plane.right_image = lambda k: picture(9, W, H)
    plane.baseline_m = 0.5
    sequence = resized(plane, "0.5")
    assert sequence.right_image(0).shape == (32, 48)
    assert (sequence.baseline_m, sequence.timestamp(1)) == (0.5, 1.0)
    assert (len(sequence), sequence.name) == (2, "plane")
    assert resized(plane, None) is plane


def test_what_is_seen_again_is_so_after_resizing(plane):
    plane.visible = lambda k: np.arange(H)[:, None] + np.zeros(W) < 30
    for size, row in (("0.5", 15), ("2", 60)):
        visible = resized(plane, size).visible(0)
        assert visible[:row].all()
        assert not visible[row:].any()


def test_isolated_pairs_stay_pairs(tmp_path):
    sequence = resized(open_sequence(make_kitti_flow(tmp_path)), "2")
    whole = open_sequence(make_kitti_flow(tmp_path / "again"))
    assert list(frame_pairs(sequence)) == list(frame_pairs(whole)) == [0, 2]
    assert [sequence.image(k).shape for k in (0, 2)] == [(60, 80), (60, 84)]
    known = np.isfinite(sequence.flow(0)).all(axis=-1)
    assert known.any()
    np.testing.assert_allclose(sequence.flow(0)[21, 31], 2 * whole.flow(0)[10, 15], atol=8)
    with pytest.raises(MissingFieldError, match="no camera"):
        _ = sequence.camera


def test_a_lens_is_removed_before_resizing(tmp_path):
    """The camera is that of the images as they are, whatever size is asked for."""
    lens = Lens(60.0, 60.0, 47.5, 31.5, BrownConrady((0.3, 0.05, 0.0, 0.0)), (W, H))
    save(tmp_path / "0.png", picture(0, W, H))
    whole = open_sequence(tmp_path, camera=lens)
    sequence = resized(whole, "0.5")
    assert sequence.camera == Pinhole(48, 32, 30, 30, 23.5, 15.5)
    np.testing.assert_array_equal(
        sequence.image(0), cv2.resize(whole.image(0), (48, 32), interpolation=cv2.INTER_AREA)
    )
    blocks = whole.mask(0).reshape(32, 2, 48, 2).all(axis=(1, 3))
    np.testing.assert_array_equal(sequence.mask(0), blocks)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("0,5", "expected WIDTHxHEIGHT .px., such as 640x360, or a factor"),
        ("50", "expected WIDTHxHEIGHT"),
        ("640", "expected WIDTHxHEIGHT"),
        ("640:360", "expected WIDTHxHEIGHT"),
        ("640x", "expected WIDTHxHEIGHT"),
        ("-0.5", "expected WIDTHxHEIGHT"),
        ("0", "expected WIDTHxHEIGHT"),
        ("nan", "expected WIDTHxHEIGHT"),
        ("", "expected WIDTHxHEIGHT"),
        ("0.1", "would become 10 x 6; a side has 16 at least"),
        ("8x8", "would become 8 x 8"),
        ("99999x99999", "would become 99999 x 99999"),
    ],
)
def test_impossible_sizes(plane, text, message):
    with pytest.raises(DataError, match=message):
        resized(plane, text)


def test_sizes_as_they_are_typed():
    assert Resize.of("640x360") == Resize.of(" 640 X 360 ") == Resize(640, 360)
    assert Resize.of("0.5") == Resize.of(".5") == Resize(factor=0.5)
    assert Resize(factor=0.5).shape((375, 1242)) == (188, 621)
