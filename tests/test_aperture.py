"""The aperture problem (the paper's Figure 1): a moving grating shows its motion along e1 only."""

import numpy as np
import pytest

from flowlik.flow import Farneback, LucasKanade
from flowlik.measurement.measurements import Measurements, measure

SHAPE = (160, 200)
ACROSS, ALONG = 0.5, 0.7  # true motion across and along the bars [px]

# one step at one scale: iterations let the flow along the bars wander off on noise
METHODS = [Farneback(levels=0, iterations=1, window=41), LucasKanade(max_level=0, iterations=1, window=41)]


def axes(angle_deg: float) -> tuple[np.ndarray, np.ndarray]:
    """Unit vectors across and along the bars of a grating."""
    c, s = np.cos(np.deg2rad(angle_deg)), np.sin(np.deg2rad(angle_deg))
    return np.array([c, s]), np.array([-s, c])


def grating(angle_deg: float, motion: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Sinusoidal grating of 14 px a period, moved by a vector [px], with sensor noise."""
    v, u = np.indices(SHAPE).astype(float)
    phase = np.stack([u - motion[0], v - motion[1]], axis=-1) @ axes(angle_deg)[0]
    noise = rng.normal(0, 2, SHAPE)
    return np.rint(127 + 110 * np.sin(2 * np.pi * phase / 14) + noise).astype(np.uint8)


def seen(method, angle_deg: float, motion: np.ndarray) -> Measurements:
    rng = np.random.default_rng(0)
    v, u = np.mgrid[30:130:5, 30:170:5]
    pixels = np.stack([u.ravel(), v.ravel()], axis=-1).astype(float)
    pair = grating(angle_deg, np.zeros(2), rng), grating(angle_deg, motion, rng)
    return measure(*pair, method, pixels=pixels)


@pytest.mark.parametrize("method", METHODS, ids=lambda method: method.name)
@pytest.mark.parametrize("angle_deg", [-35.0, 20.0, 60.0, 100.0])
def test_the_error_of_a_grating_lies_along_its_bars(method, angle_deg):
    across, along = axes(angle_deg)
    motion = ACROSS * across + ALONG * along
    m = seen(method, angle_deg, motion)
    t1, t2 = m.t.T
    assert np.median(t1 / t2) > 500
    np.testing.assert_allclose(np.abs(m.R_i_e[:, :, 0] @ across), 1, atol=1e-3)

    z = m.errors(np.broadcast_to(motion, m.flow.shape))
    true_e2 = m.R_i_e[:, :, 1] @ motion
    assert np.percentile(np.abs(z[:, 0]), 95) < 0.05 * ACROSS
    assert np.median(z[:, 1] / true_e2) == pytest.approx(-1, abs=0.1)
    assert np.median(np.abs(z[:, 1])) > 30 * np.median(np.abs(z[:, 0]))


@pytest.mark.parametrize("method", [Farneback(), LucasKanade()], ids=lambda method: method.name)
def test_a_motion_along_the_bars_changes_nothing_but_the_error_along_e2(method):
    across, along = axes(20.0)
    true_motions = (ACROSS * across, ACROSS * across + 3 * along)
    first, second = (seen(method, 20.0, motion) for motion in true_motions)
    np.testing.assert_array_equal(first.flow, second.flow)
    z = [m.errors(np.broadcast_to(motion, m.flow.shape)) for m, motion in zip((first, second), true_motions)]
    change = (z[1] - z[0]) * (first.R_i_e[:, :, 1] @ along)[:, None]
    np.testing.assert_allclose(change, np.broadcast_to([0, -3], change.shape), atol=0.1)
