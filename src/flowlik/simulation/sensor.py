"""The camera's sensor: from light to an 8-bit image."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from flowlik.errors import DataError


@dataclass(frozen=True)
class Sensor:
    """Point spread, photon noise, read noise and 8-bit quantisation; each noise is off at 0.

    A pixel with blurred radiance I has noise of variance ``photon_gain * I + read_noise**2``: 1.2 grey
    levels at mid grey with the defaults.

    Parameters
    ----------
    psf_sigma_px : float
        Standard deviation of the Gaussian point spread [px].
    photon_gain : float
        Noise variance a unit of radiance [grey level], i.e. grey levels an electron.
    read_noise : float
        Standard deviation of the signal-independent noise [grey level].

    Raises
    ------
    DataError
        If a parameter is negative or not finite.
    """

    psf_sigma_px: float = 0.5
    photon_gain: float = 0.009
    read_noise: float = 0.5

    def __post_init__(self) -> None:
        values = np.array([self.psf_sigma_px, self.photon_gain, self.read_noise])
        if not (np.isfinite(values) & (values >= 0)).all():
            raise DataError(f"impossible {self}: every parameter must be 0 or positive")

    def signal(self, radiance: NDArray[np.float32], rng: np.random.Generator) -> NDArray[np.float32]:
        """Blurred, noisy signal (H, W) [grey level] before quantisation."""
        light = np.asarray(radiance, dtype=np.float32)
        if self.psf_sigma_px > 0:
            blurred = cv2.GaussianBlur(light, (0, 0), self.psf_sigma_px, borderType=cv2.BORDER_REPLICATE)
            light = np.asarray(blurred, dtype=np.float32)
        if self.photon_gain == 0 and self.read_noise == 0:
            return light
        noise_sd = np.sqrt(self.photon_gain * np.maximum(light, 0) + self.read_noise**2)
        noise = noise_sd * rng.standard_normal(light.shape, dtype=np.float32)
        return (light + noise).astype(np.float32)

    def expose(self, radiance: NDArray[np.float32], rng: np.random.Generator) -> NDArray[np.uint8]:
        """Image (H, W) of a radiance (H, W) [grey level], rounded to 8 bits and clipped."""
        return np.clip(np.rint(self.signal(radiance, rng)), 0, 255).astype(np.uint8)


DEFAULT_SENSOR = Sensor()

IDEAL_SENSOR = Sensor(psf_sigma_px=0.0, photon_gain=0.0, read_noise=0.0)
"""Neither blur nor noise; images are still rounded to 8 bits."""
