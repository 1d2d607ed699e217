import cv2
import numpy as np
import pytest
from scipy import ndimage

from flowlik.errors import DataError, ModelError
from flowlik.flow import (
    DIS,
    PRESETS,
    Farneback,
    LucasKanade,
    describe,
    detect_corners,
    flow_method,
    method_label,
)
from flowlik.flow.base import _sample_dense
from tests.helpers import textured_image

SHAPE = (120, 160)
PREVIOUS = textured_image(SHAPE)
CURRENT = textured_image(SHAPE, shift=(2.3, -1.1))
PIXELS = np.random.default_rng(0).uniform([5, 5], [154, 114], (300, 2))


def test_farneback_is_opencv_with_the_papers_parameters():
    expected = cv2.calcOpticalFlowFarneback(PREVIOUS, CURRENT, None, 0.5, 5, 5, 5, 15, 1.5, 0)
    pixels, flow = Farneback().measure(PREVIOUS, CURRENT)
    column, row = pixels.astype(int).T
    np.testing.assert_array_equal(flow, expected[row, column])
    assert len(np.unique(pixels, axis=0)) == PREVIOUS.size
    np.testing.assert_array_equal(Farneback().measure_at(PREVIOUS, CURRENT, pixels[::7]), flow[::7])


def test_lucas_kanade_by_opencv_is_that_with_the_papers_parameters():
    start = PIXELS.astype(np.float32)[:, None]
    end, status, _ = cv2.calcOpticalFlowPyrLK(
        PREVIOUS, CURRENT, start, None, winSize=(21, 21), maxLevel=3, minEigThreshold=1e-7,
        criteria=(cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 30, 0.01),
    )  # fmt: skip
    flow = LucasKanade(solver="opencv").measure_at(PREVIOUS, CURRENT, PIXELS)
    found = status[:, 0] == 1
    np.testing.assert_array_equal(np.isfinite(flow).all(axis=1), found)
    np.testing.assert_allclose(flow[found], (end - start)[found, 0], atol=1e-4)  # OpenCV subtracts in float32


def test_the_solver_is_not_in_a_label():
    for solver in ("flowlik", "opencv"):
        assert method_label(describe(LucasKanade(window=11, solver=solver))) == "lucas-kanade-11"


def test_a_record_that_says_no_solver_is_of_opencvs():
    assert flow_method({"name": "lucas-kanade", "window": 11}) == LucasKanade(window=11, solver="opencv")


@pytest.mark.parametrize("method", PRESETS.values(), ids=PRESETS)
def test_flow_points_from_the_previous_image_to_the_current_one(method):
    inside = PIXELS[(PIXELS > 25).all(axis=1) & (PIXELS < [135, 95]).all(axis=1)]
    flow = method.measure_at(PREVIOUS, CURRENT, inside)
    np.testing.assert_allclose(np.median(flow, axis=0), [2.3, -1.1], atol=0.05)


def test_presets_are_the_two_readings_of_the_papers_list():
    assert (PRESETS["farneback"].window, PRESETS["farneback"].poly_n) == (5, 15)
    assert (PRESETS["farneback-wide"].window, PRESETS["farneback-wide"].poly_n) == (15, 5)
    narrow, wide = (PRESETS[n].dense(PREVIOUS, CURRENT) for n in ("farneback", "farneback-wide"))
    assert not np.array_equal(narrow, wide)


def test_lucas_kanade_says_nan_where_it_is_lost():
    half_flat = PREVIOUS.copy()
    half_flat[:, :80] = 100
    pixels = np.array([[20.0, 60], [30, 50], [120, 60], [130, 50]])
    flow = LucasKanade(max_level=0).measure_at(half_flat, half_flat, pixels)
    np.testing.assert_array_equal(np.isnan(flow).all(axis=1), [True, True, False, False])
    np.testing.assert_allclose(flow[2:], 0, atol=1e-6)


def test_lucas_kanade_chooses_the_detected_corners():
    pixels, flow = LucasKanade().measure(PREVIOUS, CURRENT)
    np.testing.assert_array_equal(pixels, detect_corners(PREVIOUS))
    np.testing.assert_array_equal(flow, LucasKanade().measure_at(PREVIOUS, CURRENT, pixels))


def test_corners_are_spaced_and_strongest_first():
    corners = detect_corners(PREVIOUS, spacing_px=9)
    column, row = corners.astype(int).T
    strength = cv2.cornerMinEigenVal(PREVIOUS, 5)[row, column]
    assert len(corners) > 50
    assert (np.diff(strength) <= 0).all()
    distance = np.linalg.norm(corners[:, None] - corners[None], axis=2) + 1e3 * np.eye(len(corners))
    assert distance.min() >= 9
    assert len(detect_corners(PREVIOUS, most=10)) == 10


def test_an_image_without_corners_gives_no_measurements():
    flat = np.full(SHAPE, 77, np.uint8)
    pixels, flow = LucasKanade().measure(flat, flat)
    assert pixels.shape == flow.shape == (0, 2)


@pytest.mark.parametrize("count", [500, 40_000])
def test_dense_flow_is_bilinear_between_pixels(count):
    flow = np.random.default_rng(1).normal(0, 5, (*SHAPE, 2)).astype(np.float32)
    pixels = np.random.default_rng(2).uniform([0, 0], [159, 119], (count, 2))
    expected = [ndimage.map_coordinates(flow[..., c].astype(float), pixels.T[::-1], order=1) for c in (0, 1)]
    np.testing.assert_allclose(_sample_dense(flow, pixels), np.transpose(expected), atol=1e-5)


@pytest.mark.parametrize("method", [*PRESETS.values(), Farneback(levels=2), LucasKanade(window=9)])
def test_a_description_names_the_same_method_again(method):
    assert flow_method(describe(method)) == method


def test_presets_are_found_by_name():
    assert all(flow_method(name) is method for name, method in PRESETS.items())


@pytest.mark.parametrize(
    "description",
    [
        "raft",
        {"name": "raft"},
        {"name": "farneback", "windows": 3},
        {"window": 3},
        {},
        {"name": ["farneback"]},
    ],
)
def test_an_unknown_method_is_one_line(description):
    with pytest.raises(ModelError, match="unknown flow method") as caught:
        flow_method(description)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("method", PRESETS.values(), ids=PRESETS)
@pytest.mark.parametrize("current", [CURRENT[:-1], CURRENT.astype(np.float32), CURRENT[..., None]])
def test_images_that_do_not_fit_are_refused(method, current):
    with pytest.raises(DataError, match=r"size|grey uint8"):
        method.measure_at(PREVIOUS, current, PIXELS)


def test_dis_is_opencvs_preset_medium():
    opencv = cv2.DISOpticalFlow.create(cv2.DISOPTICAL_FLOW_PRESET_MEDIUM)
    np.testing.assert_array_equal(DIS().dense(PREVIOUS, CURRENT), opencv.calc(PREVIOUS, CURRENT, None))
    coarse = DIS(finest_scale=2, patch_stride=4, iterations=12, refinement_iterations=0)
    ultrafast = cv2.DISOpticalFlow.create(cv2.DISOPTICAL_FLOW_PRESET_ULTRAFAST)
    np.testing.assert_array_equal(coarse.dense(PREVIOUS, CURRENT), ultrafast.calc(PREVIOUS, CURRENT, None))


def test_dis_does_not_depend_on_opencvs_threads():
    before = cv2.getNumThreads()
    try:
        flows = []
        for threads in (1, 3):
            cv2.setNumThreads(threads)
            flows.append(DIS().dense(PREVIOUS, CURRENT))
    finally:
        cv2.setNumThreads(before)
    np.testing.assert_array_equal(*flows)


@pytest.mark.parametrize("shape", [(8, 8), (15, 640)])
def test_images_too_small_for_dis_are_refused(shape):
    image = textured_image(shape)
    with pytest.raises(DataError, match=f"images of {shape[1]}x{shape[0]} are too small for DIS"):
        DIS().dense(image, image)


@pytest.mark.parametrize("method", PRESETS.values(), ids=PRESETS)
def test_a_constant_image_gives_no_flow_or_none_at_all(method):
    flat = np.full(SHAPE, 77, np.uint8)
    flow = method.measure_at(flat, flat, PIXELS)
    assert (np.isnan(flow) | (flow == 0)).all()


@pytest.mark.parametrize("method", PRESETS.values(), ids=PRESETS)
def test_a_method_measures_backward_from_where_the_flow_ends(method):
    inside = PIXELS[(PIXELS > 25).all(axis=1) & (PIXELS < [135, 95]).all(axis=1)]
    ends = inside + method.measure_at(PREVIOUS, CURRENT, inside)
    back = method.measure_at(CURRENT, PREVIOUS, ends)
    np.testing.assert_allclose(np.median(back, axis=0), [-2.3, 1.1], atol=0.05)
    assert np.median(np.abs(inside - ends - back)) < 0.05


@pytest.mark.parametrize("method", PRESETS.values(), ids=PRESETS)
def test_outside_the_image_there_is_no_flow(method):
    outside = np.array([[-0.01, 50], [159.01, 50], [80, -3], [80, 119.5], [np.nan, 50], [1e6, -1e6]])
    pixels = np.concatenate([PIXELS, outside])
    flow = method.measure_at(PREVIOUS, CURRENT, pixels)
    assert np.isnan(flow[len(PIXELS) :]).all()
    np.testing.assert_array_equal(flow[: len(PIXELS)], method.measure_at(PREVIOUS, CURRENT, PIXELS))


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        ({"name": "farneback", "window": 0}, "window must be a positive number below 1000, not 0"),
        ({"name": "farneback", "poly_sigma": float("nan")}, "poly_sigma must be a positive number"),
        ({"name": "lucas-kanade", "window": 1e6}, "window must be of int, not 1000000.0"),
        ({"name": "lucas-kanade", "window": True}, "window must be of int, not True"),
        ({"name": "lucas-kanade", "epsilon_px": "0.1"}, "epsilon_px must be of float, not '0.1'"),
        ({"name": "dis", "mean_normalization": 1}, "mean_normalization must be of bool, not 1"),
        ({"name": "dis", "iterations": 1000}, "iterations must be a positive number below 1000"),
    ],
)
def test_parameters_out_of_range_are_refused(parameters, message):
    with pytest.raises(ModelError, match=message):
        flow_method(parameters)


def test_a_parameter_that_may_be_0_comes_back_from_a_file():
    for method in (
        DIS(finest_scale=0, mean_normalization=False),
        Farneback(levels=0),
        LucasKanade(max_level=0),
    ):
        assert flow_method(describe(method)) == method
