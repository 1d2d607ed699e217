import numpy as np
import pytest
from scipy.ndimage import gaussian_filter
from scipy.stats import chi2

from flowlik.errors import DataError
from flowlik.simulation import IDEAL_SENSOR, Sensor


@pytest.mark.parametrize("level", [5.0, 40.0, 128.0, 230.0])
def test_noise_has_the_variance_of_the_formula(level: float) -> None:
    sensor = Sensor()
    flat = np.full((300, 300), level, np.float32)
    signal = sensor.signal(flat, np.random.default_rng(0)).astype(np.float64)
    variance = sensor.photon_gain * level + sensor.read_noise**2
    low, high = chi2.ppf([1e-4, 1 - 1e-4], signal.size - 1) * variance / (signal.size - 1)
    assert low < signal.var(ddof=1) < high
    assert abs(signal.mean() - level) < 4 * np.sqrt(variance / signal.size)


def test_noise_at_mid_grey_is_about_one_level() -> None:
    sensor = Sensor()
    assert 1.0 < np.sqrt(128 * sensor.photon_gain + sensor.read_noise**2) < 1.5


def test_ideal_sensor_only_rounds() -> None:
    radiance = np.random.default_rng(0).uniform(-3, 260, (20, 30)).astype(np.float32)
    image = IDEAL_SENSOR.expose(radiance, np.random.default_rng(0))
    assert image.dtype == np.uint8
    np.testing.assert_array_equal(image, np.clip(np.rint(radiance), 0, 255))


def test_point_spread_is_a_gaussian() -> None:
    radiance = np.random.default_rng(0).uniform(0, 255, (40, 50)).astype(np.float32)
    blurred = Sensor(0.8, 0, 0).signal(radiance, np.random.default_rng(0))
    expected = gaussian_filter(radiance.astype(np.float64), 0.8, mode="nearest")
    np.testing.assert_allclose(blurred, expected, atol=0.5)


@pytest.mark.parametrize("bad", [{"psf_sigma_px": -1}, {"photon_gain": np.nan}, {"read_noise": np.inf}])
def test_impossible_sensors_are_refused(bad: dict[str, float]) -> None:
    with pytest.raises(DataError, match="impossible"):
        Sensor(**bad)
