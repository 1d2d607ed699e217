from dataclasses import replace

import cv2
import numpy as np
import pytest
from scipy.ndimage import map_coordinates

from flowlik.errors import ModelError
from flowlik.flow import Farneback, LucasKanade
from flowlik.flow.base import samplers
from flowlik.image.texture import TextureDefinition, derivatives
from flowlik.likelihood.covariates import COVARIATES, covariate, of_components
from flowlik.measurement._signals import SIGNALS, Pair, signal
from flowlik.measurement.measurements import Measurements, measure
from tests.helpers import textured_image

SHAPE = (70, 100)
PREVIOUS = textured_image(SHAPE)
CURRENT = textured_image(SHAPE, shift=(1.3, -0.6))


@pytest.fixture(scope="module")
def measured() -> Measurements:
    m = measure(PREVIOUS, CURRENT, Farneback(), signals=[n for n in SIGNALS if n != "own-uncertainty"])
    return replace(m, signals={**m.signals, "own-uncertainty": 0.1 + np.abs(m.flow)})  # as a network's


def directions(n: int, seed: int = 0) -> np.ndarray:
    angle = np.random.default_rng(seed).uniform(0, 2 * np.pi, n)
    return np.stack([np.cos(angle), np.sin(angle)], axis=-1)


@pytest.mark.parametrize("name", COVARIATES)
def test_a_covariate_has_no_sign_and_follows_its_direction(measured, name):
    along = covariate(name).along
    n = directions(len(measured))
    values = along(measured, n)
    assert values.shape == (len(measured),)
    assert (values >= 0).all()
    np.testing.assert_allclose(along(measured, -n), values)
    components = of_components(name, measured)
    np.testing.assert_array_equal(components[:, 1], along(measured, measured.R_i_e[:, :, 1]))


def test_texture_across_is_texture_along_the_normal(measured):
    n = directions(len(measured))
    normal = np.stack([-n[:, 1], n[:, 0]], axis=-1)
    across = covariate("texture-across").along(measured, n)
    np.testing.assert_allclose(across, covariate("texture").along(measured, normal), rtol=1e-9)
    np.testing.assert_allclose(of_components("texture-across", measured), measured.t[:, ::-1], rtol=1e-6)


def test_flow_and_discrepancy_are_projected(measured):
    n = directions(len(measured))
    flow = covariate("flow-along").along(measured, n)
    np.testing.assert_allclose(flow, np.abs((measured.flow * n).sum(axis=1)))
    d = measured.signals["discrepancy"]
    back = np.isfinite(d).all(axis=1)
    assert 0 < (~back).sum() < 0.1 * len(measured)  # ends beyond the image
    values = covariate("discrepancy").along(measured, n)
    np.testing.assert_allclose(values[back], np.abs((d * n).sum(axis=1))[back])
    assert np.isinf(values[~back]).all()


def test_a_missing_signal_is_named():
    m = measure(PREVIOUS, CURRENT, LucasKanade())
    with pytest.raises(ModelError, match="discrepancy"):
        of_components("discrepancy", m)
    with pytest.raises(ModelError, match="unknown covariate 'colour'"):
        covariate("colour")
    with pytest.raises(ModelError, match="unknown signal 'colour'"):
        signal("colour")


def pair(flow, previous=PREVIOUS, current=CURRENT, pixels=None, flow_at=None) -> Pair:
    pixels = np.array([[20.0, 30.0], [50.0, 40.0], [80.0, 12.0]]) if pixels is None else pixels
    flow = np.broadcast_to(np.asarray(flow, float), pixels.shape).copy()
    flow_at = flow_at or (lambda p: np.zeros_like(p))
    back_at = samplers(Farneback(), previous, current).back
    return Pair(previous, current, derivatives(previous), flow_at, back_at, pixels, flow)


def test_the_discrepancy_is_the_way_there_and_back(measured):
    forward, backward = (Farneback().dense(*p) for p in ((PREVIOUS, CURRENT), (CURRENT, PREVIOUS)))
    flow = forward[30, 20].astype(float)
    d = SIGNALS["discrepancy"](pair(flow, pixels=np.array([[20.0, 30.0]])))
    u, v = np.array([20.0, 30.0]) + flow
    i, j, a, b = int(v), int(u), v - int(v), u - int(u)
    corner = backward[i : i + 2, j : j + 2].astype(float)
    back = (1 - a) * ((1 - b) * corner[0, 0] + b * corner[0, 1]) + a * (
        (1 - b) * corner[1, 0] + b * corner[1, 1]
    )
    np.testing.assert_allclose(d[0], flow + back, atol=1e-6)
    assert np.nanmedian(np.abs(measured.signals["discrepancy"])) < 0.1


def test_the_patch_discrepancy_is_opencv_s_search_from_the_start():
    rng = np.random.default_rng(1)
    pixels = rng.uniform([20, 20], [80, 50], (100, 2)).astype(np.float32)
    p = pair(rng.normal([1.3, -0.6], 0.3, (100, 2)).astype(np.float32), pixels=pixels.astype(float))
    found, status, _ = cv2.calcOpticalFlowPyrLK(
        CURRENT, PREVIOUS, (p.pixels + p.flow).astype(np.float32)[:, None], pixels[:, None].copy(),
        winSize=(9, 9), maxLevel=0, criteria=(3, 30, 0.01), flags=cv2.OPTFLOW_USE_INITIAL_FLOW,
    )  # fmt: skip
    d = SIGNALS["patch-discrepancy"](p)
    assert status.all()
    assert np.median(np.abs(d - (found[:, 0] - pixels))) < 1e-3
    # the patch at a wrong end is found again where it belongs
    np.testing.assert_allclose(np.median(d - (p.flow - [1.3, -0.6]), axis=0), 0, atol=0.02)


def test_a_patch_that_leaves_the_image_has_no_way_back():
    d = SIGNALS["patch-discrepancy"](pair([[200.0, 0.0]], pixels=np.array([[50.0, 40.0]])))
    assert np.isnan(d).all()


def test_the_residual_agrees_with_numpy():
    flow = np.array([[1.0, 2.0], [-3.0, 0.0], [4.0, 1.0]])
    found = SIGNALS["residual"](pair(flow))
    offsets = np.arange(-2, 3)
    for value, (u, v), (du, dv) in zip(found, pair(flow).pixels.astype(int), flow.astype(int)):
        rows, columns = np.clip(v + offsets, 0, 69), np.clip(u + offsets, 0, 99)
        ends = np.clip(v + dv + offsets, 0, 69), np.clip(u + du + offsets, 0, 99)
        difference = CURRENT[np.ix_(*ends)].astype(float) - PREVIOUS[np.ix_(rows, columns)]
        assert value == pytest.approx(np.abs(difference - difference.mean()).mean(), abs=1e-9)


def test_the_residual_agrees_with_scipy_between_pixels_and_beyond_the_border():
    rng = np.random.default_rng(0)
    p = pair(rng.uniform(-4, 4, (200, 2)), pixels=rng.uniform(0, [99, 69], (200, 2)))
    v, u = np.mgrid[-2:3, -2:3].reshape(2, 25)
    patches = [
        map_coordinates(image.astype(float), np.stack([y + v, x + u]), order=1, mode="nearest")
        for image, places in ((p.previous, p.pixels), (p.current, p.pixels + p.flow))
        for x, y in places
    ]
    difference = np.array(patches[200:]) - np.array(patches[:200])
    expected = np.abs(difference - difference.mean(axis=1, keepdims=True)).mean(axis=1)
    np.testing.assert_allclose(SIGNALS["residual"](p), expected, atol=1e-9)


def test_the_residual_does_not_see_an_exposure_step_and_does_see_wrong_flow():
    brighter = np.clip(CURRENT.astype(int) + 9, 0, 255).astype(np.uint8)
    right, lit, wrong = (
        SIGNALS["residual"](p)
        for p in (pair([1.3, -0.6]), pair([1.3, -0.6], current=brighter), pair([5.0, 3.0]))
    )
    np.testing.assert_allclose(lit, right, atol=0.3)
    assert (wrong > 5 * right).all()


def test_the_spread_is_that_of_neighbouring_flow():
    def sheared(pixels):
        flow = 0.1 * pixels
        flow[pixels[:, 0] < 18] = np.nan
        return flow

    p = pair([0, 0], flow_at=sheared)
    p = replace(p, flow=sheared(p.pixels))
    # neighbours 4 px away on a grid: squares 0.16 four times and 0.32 four times
    np.testing.assert_allclose(SIGNALS["spread"](p)[1:], np.sqrt(0.24))
    # without the three to the left, where the flow is unknown: 0.16 three times, 0.32 twice
    np.testing.assert_allclose(SIGNALS["spread"](p)[0], np.sqrt((3 * 0.16 + 2 * 0.32) / 5))
    nowhere = pair([0, 0], flow_at=lambda pixels: np.full_like(pixels, np.nan))
    assert np.isnan(SIGNALS["spread"](nowhere)).all()


def standard_error_twin(p: Pair, blocks: int = 5) -> np.ndarray:
    height, width = p.previous.shape
    gx, gy = (cv2.Scharr(p.previous, cv2.CV_64F, dx, dy) / 32 for dx, dy in ((1, 0), (0, 1)))
    offsets = np.arange(3 * blocks) - 3 * blocks // 2
    covariances = []
    for (u, v), flow in zip(np.rint(p.pixels).astype(int), p.flow):
        here = np.ix_(np.clip(v + offsets, 0, height - 1), np.clip(u + offsets, 0, width - 1))
        end_u, end_v = np.meshgrid(u + flow[0] + offsets, v + flow[1] + offsets)
        ends = map_coordinates(p.current.astype(float), [end_v, end_u], order=1, mode="nearest")
        g = np.stack([gx[here], gy[here]], axis=-1)
        scores = g * (ends - p.previous[here])[:, :, None]
        scores = scores.reshape(blocks, 3, blocks, 3, 2).sum(axis=(1, 3)).reshape(-1, 2)
        S = np.einsum("vui,vuj->ij", g, g) + 1e-3 * np.eye(2)
        inverse = np.linalg.inv(S)
        covariances.append(inverse @ (scores.T @ scores + S / 12) @ inverse)
    return np.array(covariances)


def test_the_standard_error_agrees_with_numpy():
    # the last two reach beyond the image, one of them by far
    pixels = np.array([[20.0, 30.0], [50.3, 40.8], [98.0, 3.0], [60.0, 20.0]])
    p = pair([[1.3, -0.6], [-2.25, 0.5], [4.0, -5.5], [4000.0, 0.0]], pixels=pixels)
    found = SIGNALS["standard-error"](p)
    np.testing.assert_allclose(found, standard_error_twin(p)[:, [0, 0, 1], [0, 1, 1]], rtol=1e-9)
    flat = np.full(SHAPE, 90, np.uint8)
    (xx, xy, yy), *_ = SIGNALS["standard-error"](pair([0, 0], flat, flat))
    assert xy == 0 and xx == yy == pytest.approx(1 / 12 / 1e-3)


def test_the_standard_error_is_that_of_least_squares_under_noise_and_sees_two_motions():
    rng = np.random.default_rng(1)
    shape = (300, 400)
    image = textured_image(shape).astype(float)
    previous, current = (np.clip(image + rng.normal(0, 3, shape), 0, 255).astype(np.uint8) for _ in "ab")
    v, u = np.mgrid[20:280:12, 20:380:12]
    pixels = np.stack([u.ravel(), v.ravel()], axis=-1).astype(float)
    method = LucasKanade(window=15, max_level=0, anchor="middle")
    m = measure(previous, current, method, pixels=pixels, signals=["standard-error"])
    sigma = of_components("standard-error", m)
    assert 0.8 < np.std(m.errors(np.zeros_like(m.flow)) / sigma) < 1.25
    # the right half moves on: patches on the seam have the same texture, and blocks that disagree
    moved = current.copy()
    moved[:, 200:] = np.roll(current, 3, axis=1)[:, 200:]
    seam = np.abs(pixels[:, 0] - 200) < 6
    before, after = (
        SIGNALS["standard-error"](pair([0, 0], previous, end, pixels[seam])) for end in (current, moved)
    )
    assert (after[:, 0] > 4 * before[:, 0]).mean() > 0.9


def test_signals_are_measured_only_where_asked_and_selected_with_the_rest(measured):
    assert measure(PREVIOUS, CURRENT, LucasKanade()).signals == {}
    part = measured.select(np.arange(5))
    for name in SIGNALS:
        np.testing.assert_array_equal(part.signals[name], measured.signals[name][:5])
    assert isinstance(part.texture, TextureDefinition)
