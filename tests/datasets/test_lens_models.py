"""Lens models against OpenCV, against formulas written out anew, and against their own inverse."""

import cv2
import numpy as np
import pytest

from flowlik.datasets._lens_models import BrownConrady, DoubleSphere, KannalaBrandt, true_points
from flowlik.errors import DataError

EUROC = (-0.283, 0.074, 0.0002, 1.8e-5)
RATIONAL = (0.5, -0.1, 0.001, -0.0005, 0.02, 0.8, -0.05, 0.03)
TILTED = (*RATIONAL, 0.001, -0.0005, 0.0008, 0.0002, 0.01, -0.02)
TUM_VI = (0.0034823894, 0.00071503485, -0.0020532361, 0.00020293674)
MODELS = [
    BrownConrady(EUROC),
    BrownConrady((0.2624, -0.9531, -0.0054, 0.0026, 1.1633)),
    BrownConrady(RATIONAL),
    BrownConrady(TILTED),
    KannalaBrandt(TUM_VI),
    KannalaBrandt((0.05, -0.01, 0.002, -0.0005)),
    DoubleSphere(-0.172, 0.593),
    DoubleSphere(0.183, 0.809),
    DoubleSphere(-0.27, 0.35),
]


def points(widest_deg=35.0):
    """Points of the plane z = 1 all around the axis, the axis itself among them."""
    r = np.tan(np.deg2rad(np.linspace(0, widest_deg, 8)))
    angle = np.linspace(0, 2 * np.pi, 13)
    return np.stack([np.outer(r, np.cos(angle)).ravel(), np.outer(r, np.sin(angle)).ravel()], axis=1)


def rays(at):
    return np.column_stack([at, np.ones(len(at))])


@pytest.mark.parametrize("coefficients", [EUROC, (*EUROC, 0.05), RATIONAL, TILTED[:12], TILTED])
def test_brown_conrady_is_opencvs(coefficients):
    """Every number of coefficients that OpenCV takes, beyond what any lens has."""
    strong = np.array(coefficients) * ([1] * 8 + [10] * 4 + [5] * 2)[: len(coefficients)]
    expected = cv2.projectPoints(rays(points()), *np.zeros((2, 3)), np.eye(3), strong)[0][:, 0]
    np.testing.assert_allclose(BrownConrady(tuple(strong)).seen(points()), expected, atol=1e-12)


@pytest.mark.parametrize("coefficients", [TUM_VI, (0.05, -0.01, 0.002, -0.0005), (0, 0, 0, 0)])
def test_kannala_brandt_is_opencvs_fisheye(coefficients):
    wide = points(85)
    expected = cv2.fisheye.projectPoints(
        rays(wide)[:, None], np.zeros(3), np.zeros(3), np.eye(3), np.array(coefficients, float)
    )[0][:, 0]
    np.testing.assert_allclose(KannalaBrandt(coefficients).seen(wide), expected, atol=1e-12)


@pytest.mark.parametrize(("xi", "alpha"), [(-0.172, 0.593), (0.183, 0.809), (-0.27, 0.35), (0.0, 0.0)])
def test_double_sphere_is_that_of_the_paper(xi, alpha):
    """Usenko et al. 2018: projection, and its closed inverse."""
    seen = DoubleSphere(xi, alpha).seen(points(80))
    for (x, y, z), found in zip(rays(points(80)), seen):
        d1 = np.sqrt(x * x + y * y + z * z)
        d2 = np.sqrt(x * x + y * y + (xi * d1 + z) ** 2)
        expected = np.array([x, y]) / (alpha * d2 + (1 - alpha) * (xi * d1 + z))
        np.testing.assert_allclose(found, expected, atol=1e-12)
    q = (seen**2).sum(axis=1)
    mz = (1 - alpha**2 * q) / (alpha * np.sqrt(1 - (2 * alpha - 1) * q) + 1 - alpha)
    scale = (mz * xi + np.sqrt(mz**2 + (1 - xi**2) * q)) / (mz**2 + q)
    back = np.column_stack([scale[:, None] * seen, scale * mz - xi])
    np.testing.assert_allclose(back[:, :2] / back[:, 2:], points(80), atol=1e-9)


@pytest.mark.parametrize("model", MODELS)
def test_true_points_are_found_again(model):
    widest = 30 if isinstance(model, BrownConrady) else 70
    np.testing.assert_allclose(true_points(model, model.seen(points(widest))), points(widest), atol=1e-7)


@pytest.mark.parametrize("model", MODELS)
def test_magnification_is_the_slope_on_the_axis(model):
    if model == BrownConrady(TILTED):
        return  # a tilted sensor has two
    slope = (model.seen(np.array([[1e-5, 0.0]])) - model.seen(np.array([[-1e-5, 0.0]]))) / 2e-5
    np.testing.assert_allclose(slope, [[model.magnification, 0]], atol=6e-4)


FOLDING = [
    (BrownConrady((-0.3, 0.0, 0.0, 0.0)), np.sqrt(1 / 0.9)),
    (BrownConrady((0.0, -0.2, 0.0, 0.0)), 1.0),
    (BrownConrady((0.2, -0.3, 0.0, 0.0, 0.1, 1.5, -0.6, 0.2)), None),
    (BrownConrady((0.0, 0.0, 0.0, 0.0, 0.0, -0.25, 0.0, 0.0)), 2.0),  # a pole
    (KannalaBrandt((-0.4, 0.0, 0.0, 0.0)), np.tan(np.sqrt(1 / 1.2))),
    (DoubleSphere(-0.5, 0.0), np.sqrt(3)),  # 1 - d1 / 2 = 0 at d1 = 2
    (DoubleSphere(-0.9, 0.2), None),
    (DoubleSphere(-0.9, 0.9), None),
]


@pytest.mark.parametrize(("model", "limit"), FOLDING)
def test_the_limit_is_where_the_radius_turns_back(model, limit):
    if limit is not None:
        assert model.limit == pytest.approx(limit)
    angles = np.linspace(0, np.arctan(min(model.limit, 1e4)), 2000)[1:-1]
    radius = model.radius(np.tan(angles))
    assert (np.diff(radius) > 0).all()
    if np.isfinite(model.limit):
        before, after = model.radius(model.limit * np.array([1 - 1e-4, 1 + 1e-4]))
        turns = model.radius(np.array([model.limit * (1 + 1e-3)]))[0] < after
        assert turns or after < 0 or not np.isfinite(after)
        assert before > 0


@pytest.mark.parametrize("model", MODELS[:3] + MODELS[4:6])
def test_gentle_lenses_have_no_limit_nearby(model):
    assert model.limit > np.tan(np.deg2rad(44))


def test_beyond_the_limit_there_is_no_true_point():
    model = BrownConrady((-0.3, 0.0, 0.0, 0.0))
    highest = model.limit * (1 - 0.3 * model.limit**2)
    found = true_points(model, np.array([[0.99 * highest, 0.0], [1.01 * highest, 0.0], [0.0, -5.0]]))
    assert np.isfinite(found[0]).all()
    assert np.isnan(found[1:]).all()


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: BrownConrady((0.1, 0.2)), "2 distortion coefficients, expected 0, 4, 5, 8, 12, 14"),
        (lambda: BrownConrady((0.1, 0.2, np.nan, 0)), "not a finite number"),
        (lambda: BrownConrady((0.1, 0.2, 1e300, 0)), "not a finite number"),
        (lambda: KannalaBrandt(()), "0 distortion coefficients, expected 4"),
        (lambda: DoubleSphere(-1.0, 0.5), "xi must be above -1"),
        (lambda: DoubleSphere(0.1, 1.1), "alpha in"),
        (lambda: DoubleSphere(np.nan, 0.5), "xi must be above -1"),
    ],
)
def test_impossible_coefficients_are_refused(make, message):
    with pytest.raises(DataError, match=message):
        make()
