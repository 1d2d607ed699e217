"""Patches tracked a cell at a time: the steps of Lucas and Kanade, as plain numpy and as OpenCV take them."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from scipy.ndimage import map_coordinates

from flowlik.flow import LucasKanade
from flowlik.flow.tracking import Pyramid, Tracker
from flowlik.support import threads
from tests.helpers import textured_image

SHAPE = (120, 160)
PREVIOUS, CURRENT = textured_image(SHAPE), textured_image(SHAPE, shift=(5.3, -3.6))
PIXELS = np.random.default_rng(0).uniform([0, 0], [159, 119], (300, 2))


def level_twin(previous, current, pixel, flow, window, iterations, epsilon):
    """Flow at one level, step by step in double precision, and whether it ends in the image; None if flat."""
    shape, offsets = np.array(previous.shape[::-1]), np.arange(window) - 0.5 * (window - 1)
    gx, gy = (cv2.Scharr(previous.astype(float), cv2.CV_64F, *order) / 32 for order in ((1, 0), (0, 1)))
    u, v = np.meshgrid(pixel[0] + offsets, pixel[1] + offsets)
    seen = (u >= 0) & (u <= shape[0] - 1) & (v >= 0) & (v <= shape[1] - 1)

    def read(image, u, v):
        return map_coordinates(image, [v, u], order=1, mode="mirror")

    g = np.stack([np.where(seen, read(gradient, u, v), 0) for gradient in (gx, gy)], axis=-1).reshape(-1, 2)
    patch, S = read(previous.astype(float), u, v), g.T @ g
    if np.linalg.eigvalsh(S)[0] / window**2 < 1.024e-4 or np.linalg.det(S) < 0.125:
        return None
    last = np.zeros(2)
    for k in range(iterations):
        first = np.floor(pixel + flow - 0.5 * (window - 1))
        if not ((first >= -window) & (first < shape)).all():
            break
        difference = read(current.astype(float), u + flow[0], v + flow[1]) - patch
        step = -np.linalg.solve(S, g.T @ difference.ravel())
        flow = flow + step
        if step @ step <= epsilon**2:
            break
        if k and (np.abs(step + last) < 0.01).all():
            flow = flow - 0.5 * step
            break
        last = step
    first = pixel + flow - 0.5 * (window - 1)
    return flow, bool(((first >= -window) & (first < shape)).all())


@pytest.mark.parametrize(("window", "level"), [(11, 0), (21, 0), (21, 2), (10, 1)])
def test_patches_go_where_the_plain_steps_go(window, level):
    start = np.array([5.0, -3.0]) + np.random.default_rng(1).normal(0, 0.3, PIXELS.shape)
    pyramids = [Pyramid.of(image, window, 3) for image in (PREVIOUS, CURRENT)]
    found = Tracker(window, 30, 0.01).track(*pyramids, PIXELS, start, top=level)
    images = [[PREVIOUS, CURRENT]]
    for _ in range(level):
        images.append([cv2.pyrDown(image) for image in images[-1]])
    expected = start.copy()
    for above in range(level, -1, -1):
        for i, pixel in enumerate(PIXELS / 2**above):
            moved = level_twin(*images[above], pixel, expected[i] / 2**above, window, 30, 0.01)
            if moved is not None and (above or moved[1]):
                expected[i] = moved[0] * 2**above
            elif above == 0:
                expected[i] = np.nan
    np.testing.assert_array_equal(np.isnan(found), np.isnan(expected))
    # a step near the threshold may be one too few or too many
    assert np.nanquantile(np.abs(found - expected), 0.98) < 2e-5
    np.testing.assert_allclose(found, expected, atol=0.02)


@pytest.mark.parametrize("window", [11, 21])
def test_vectors_are_those_of_opencv(window):
    ours, theirs = (
        LucasKanade(window=window, solver=solver).measure_at(PREVIOUS, CURRENT, PIXELS)
        for solver in ("flowlik", "opencv")
    )
    apart = np.linalg.norm(ours - theirs, axis=1)
    assert (np.isnan(ours) == np.isnan(theirs)).all(axis=1).mean() > 0.98
    assert np.nanmedian(apart) < 3e-4
    inner = (np.abs(PIXELS - [80, 60]) < [50, 30]).all(axis=1)
    assert np.nanquantile(apart[inner], 0.98) < 0.01


def test_flow_does_not_depend_on_the_number_of_threads(monkeypatch):
    pixels = np.tile(PIXELS, (4, 1))
    found = []
    for number in (1, 2):
        monkeypatch.setattr(threads, "THREADS", number)
        found.append(LucasKanade().measure_at(PREVIOUS, CURRENT, pixels))
    np.testing.assert_array_equal(*found)


def test_a_patch_without_a_start_or_in_a_flat_image_is_lost():
    pyramids = [Pyramid.of(image, 21, 3) for image in (PREVIOUS, CURRENT)]
    start = np.where(np.arange(300)[:, None] % 3, [5.0, -3.5], np.nan)
    found = Tracker(21, 30, 0.01).track(*pyramids, PIXELS, start)
    assert np.isnan(found[::3]).all() and np.isfinite(found[1::3]).all(axis=1).mean() > 0.8
    flat = Pyramid.of(np.full(SHAPE, 90, np.uint8), 21, 3)
    assert np.isnan(Tracker(21, 30, 0.01).track(flat, flat, PIXELS)).all()


def test_a_pyramid_ends_where_opencvs_does():
    for shape, window in (
        ((120, 160), 21),
        ((43, 400), 21),
        ((44, 400), 21),
        ((30, 30), 21),
        ((360, 640), 11),
    ):
        image = textured_image(shape)
        levels, _ = cv2.buildOpticalFlowPyramid(image, (window, window), 3, withDerivatives=False)
        assert len(Pyramid.of(image, window, 3).levels) == levels + 1
