"""Where a Lucas-Kanade vector belongs: the centre of its patch's gradient energy."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from scipy.ndimage import gaussian_filter, map_coordinates

from flowlik.flow import LucasKanade
from flowlik.flow.base import all_pixels
from flowlik.image.texture import derivatives
from flowlik.measurement.measurements import measure, stratified_pixels

SHAPE = (120, 160)
# flow d(x) = A x + b, as of a road that comes nearer
A, B = np.array([[0.012, 0.004], [-0.003, 0.03]]), np.array([-0.6, -0.4])


def flow_at(pixels):
    """Flow (N, 2) [px] at pixels (N, 2)."""
    return pixels @ A.T + B


def pair():
    """Two images, the scene moving by `flow_at`, with much texture in some places and little beside them."""
    rng = np.random.default_rng(0)
    contrast = gaussian_filter(rng.normal(size=SHAPE), 6)
    contrast = np.exp(1.5 * contrast / contrast.std())
    scene = contrast * gaussian_filter(rng.normal(size=SHAPE), 1.2)
    scene = 128 + 100 * np.tanh(scene / (2 * np.quantile(np.abs(scene), 0.95)))
    grid = all_pixels(SHAPE)
    # what was at p is now at p + d(p)
    origin = (grid - B) @ np.linalg.inv(np.eye(2) + A).T
    moved = map_coordinates(scene, origin.T[::-1], order=3, mode="reflect").reshape(SHAPE)
    return tuple(np.rint(image).clip(0, 255).astype(np.uint8) for image in (scene, moved))


def twin(image, pixels, half):
    """Energy centres, plainly."""
    gx, gy = (cv2.Scharr(image, cv2.CV_64F, *order) for order in ((1, 0), (0, 1)))
    energy, centres = gx**2 + gy**2, []
    for pixel in pixels:
        u, v = np.rint(pixel).astype(int)
        rows, columns = (
            np.arange(max(c - half, 0), min(c + half + 1, n)) for c, n in zip((v, u), image.shape)
        )
        e = energy[np.ix_(rows, columns)]
        offset = np.array([(e * (columns - u)).sum(), (e * (rows - v)[:, None]).sum()])
        centres.append(pixel + (offset / e.sum() if e.sum() > 0 else 0))
    return np.clip(centres, 0, [image.shape[1] - 1, image.shape[0] - 1])


@pytest.mark.parametrize("window", [11, 21])
def test_anchors_are_the_centres_of_gradient_energy(window):
    image, _ = pair()
    image[:40, :40] = 90
    pixels = np.random.default_rng(1).uniform(0, [159, 119], (300, 2))
    found = LucasKanade(window=window).anchors(derivatives(image), pixels)
    np.testing.assert_allclose(found, twin(image, pixels, window // 2), atol=1e-9)


def test_a_flat_patch_stays_where_it_is():
    pixels = np.array([[20.0, 30.25]])
    np.testing.assert_array_equal(
        LucasKanade().anchors(derivatives(np.full(SHAPE, 7, np.uint8)), pixels), pixels
    )


@pytest.mark.parametrize(("window", "ratio"), [(11, 0.6), (21, 0.4)])
def test_flow_is_that_of_the_anchor_where_motion_varies(window, ratio):
    previous, current = pair()
    pixels = stratified_pixels(SHAPE, 800, np.random.default_rng(2), margin=16)
    errors = {}
    for anchor in ("energy", "middle"):
        m = measure(previous, current, LucasKanade(window=window, anchor=anchor), pixels=pixels)
        assert len(m) > 700
        errors[anchor] = np.median(np.abs(m.flow - flow_at(m.pixels)), axis=0)
    # the motion changes most down the image
    assert errors["energy"][1] < ratio * errors["middle"][1]


def test_the_middle_of_the_patch_is_kept_when_asked_for():
    previous, current = pair()
    pixels = stratified_pixels(SHAPE, 50, np.random.default_rng(3), margin=16)
    np.testing.assert_array_equal(
        measure(previous, current, LucasKanade(anchor="middle"), pixels=pixels).pixels, pixels
    )
