import numpy as np
import pytest

import naturalness
from flowlik.errors import DataError
from tests.helpers import textured_image


def power_law_noise(exponent: float, shape=(256, 400), seed=0) -> np.ndarray:
    """Noise with the amplitude 1 / f^exponent and random phases."""
    white = np.fft.rfft2(np.random.default_rng(seed).standard_normal(shape))
    frequency = np.hypot(np.fft.fftfreq(shape[0])[:, None], np.fft.rfftfreq(shape[1]))
    frequency[0, 0] = np.inf
    return np.fft.irfft2(white / frequency**exponent, shape)


@pytest.mark.parametrize("exponent", [0.0, 0.7, 1.0, 1.5])
def test_slope_of_power_law_noise_is_its_exponent(exponent):
    slopes = [naturalness.spectral_slope(power_law_noise(exponent, seed=seed)) for seed in range(4)]
    assert np.mean(slopes) == pytest.approx(-exponent, abs=0.03)


def test_amplitude_of_white_noise_is_its_standard_deviation():
    image = 100 + 7 * np.random.default_rng(0).standard_normal((300, 200))
    frequency, amplitude = naturalness.amplitude_spectrum(image)
    high = frequency > 0.1  # in low rings there are few frequencies
    np.testing.assert_allclose(amplitude[high], 7, rtol=0.1)
    assert (np.diff(frequency) > 0).all() and frequency[-1] <= 0.5


@pytest.mark.parametrize("angle", [0.0, 0.6, np.pi / 2])
def test_a_wave_shows_at_its_frequency_in_any_direction(angle):
    v, u = np.mgrid[0:180, 0:320]
    wave = np.sin(2 * np.pi * 0.13 * (u * np.cos(angle) + v * np.sin(angle)))
    frequency, amplitude = naturalness.amplitude_spectrum(wave)
    assert abs(np.log2(frequency[amplitude.argmax()] / 0.13)) < 0.25


def test_gradient_of_a_ramp_and_kurtosis_of_known_distributions():
    v, u = np.mgrid[0:50, 0:60]
    values = naturalness.gradients((3 * u + v).astype(np.uint8)).reshape(2, 50, 60)[:, 1:-1, 1:-1]
    np.testing.assert_allclose(values[0], 3)
    np.testing.assert_allclose(values[1], 1)
    rng = np.random.default_rng(0)
    assert naturalness.kurtosis(rng.standard_normal(400_000)) == pytest.approx(3, abs=0.05)
    assert naturalness.kurtosis(rng.laplace(size=400_000)) == pytest.approx(6, abs=0.3)
    assert naturalness.kurtosis(rng.uniform(-1, 1, 400_000)) == pytest.approx(9 / 5, abs=0.01)


def test_texture_levels_are_ordered_and_average_to_the_squared_gradient():
    image = textured_image((80, 90))
    t1, t2 = naturalness.texture_levels(image)
    assert (t1 >= t2).all() and (t2 >= 0).all() and t1.shape == (80 * 90,)
    squared = 2 * np.mean(naturalness.gradients(image) ** 2)
    assert np.mean(t1 + t2) == pytest.approx(squared, rel=0.05)


def test_share_at_a_step_is_a_band_of_known_width():
    depth = np.full((40, 100), 5.0)
    depth[:, 60:] = 8.0
    # columns 59 and 60 hold the step, five more on either side lie within 5 px
    assert naturalness.depth_edges(depth).sum() == 2 * 40
    assert naturalness.depth_edge_share(depth) == pytest.approx(12 / 100)
    assert naturalness.depth_edge_share(depth, 0) == pytest.approx(2 / 100)
    assert naturalness.depth_smooth(depth).mean() == pytest.approx(78 / 100)


def test_distance_to_an_edge_is_euclidean():
    depth = np.full((41, 41), 10.0)
    depth[20, 20] = 5.0
    near = naturalness.near_depth_edge(depth, 5)
    v, u = np.mgrid[0:41, 0:41]
    to_block = np.hypot(np.maximum(abs(u - 20) - 1, 0), np.maximum(abs(v - 20) - 1, 0))
    np.testing.assert_array_equal(near, to_block <= 5)


def test_sky_is_an_edge_only_where_it_meets_the_world_and_small_steps_are_none():
    depth = np.full((30, 30), np.inf)
    assert naturalness.depth_edge_share(depth) == 0
    depth[15:] = 50.0
    assert naturalness.depth_edges(depth).sum() == 2 * 30
    assert not naturalness.depth_smooth(depth)[:15].any()
    ramp = np.full((30, 30), 10.0) * 1.04 ** np.arange(30)
    assert not naturalness.depth_edges(ramp).any()  # 1.04 squared is less than 1.1


def test_unknown_depth_makes_no_edge_and_is_not_counted():
    depth = np.full((40, 100), 5.0)
    depth[:, 50:70] = np.nan
    assert naturalness.depth_edge_share(depth) == 0
    depth[:, 99] = 9.0
    assert naturalness.depth_edge_share(depth) == pytest.approx(7 / 80)


def test_what_has_no_answer_is_an_error():
    with pytest.raises(DataError, match="at least 16 x 16"):
        naturalness.amplitude_spectrum(np.zeros((10, 100)))
    with pytest.raises(DataError, match="without contrast"):
        naturalness.spectral_slope(np.full((64, 64), 7))
    with pytest.raises(DataError, match="all 0"):
        naturalness.kurtosis(np.zeros(9))
    with pytest.raises(DataError, match="no depth is known"):
        naturalness.depth_edge_share(np.full((5, 5), np.nan))
