"""The camera's sensor: from light to an 8-bit image, one small function a stage.

Light is linear radiance, 1 just saturates; the stages follow one another as they do in a camera.
`docs/simulation.md` says what the defaults rest on.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform

from flowlik.errors import DataError
from flowlik.geometry.camera import Pinhole
from flowlik.simulation._base import Frame
from flowlik.simulation.flight._blur import blur_rows
from flowlik.support.threads import in_bands

Light = NDArray[np.float32]

_STEPS = 1
"""First word of the random streams of exposure steps; those of the noise begin with 2 + eye."""


@dataclass(frozen=True)
class Sensor:
    """Motion blur, point spread, vignetting, exposure, noise, response; each is off at 0.

    Parameters
    ----------
    exposure_s : float
        Time the shutter is open [s]; motion within it blurs the picture.
    subframes : int
        Pictures averaged over the exposure; 0 blurs the one picture along its true flow instead.
    psf_sigma_px : float
        Standard deviation of the Gaussian point spread [px].
    vignetting : float
        Share of the light lost in the image's corner.
    gain : float
        Factor on the light.
    gain_sd, gamma_sd : float
        Standard deviation of the logarithm of gain and gamma, drawn anew every `hold_s`.
    hold_s : float
        Time [s] for which gain and gamma stay.
    full_well_e : float or None
        Electrons of a pixel that just saturates, which set the photon noise; None for no noise at all.
    read_noise_e : float
        Standard deviation of the noise in the dark [electrons].
    gamma : float
        The response curve is light to the power of 1 / gamma.

    Raises
    ------
    DataError
        If a parameter is negative or not finite, or one that must be positive is 0.
    """

    exposure_s: float = 0.002
    subframes: int = 0
    psf_sigma_px: float = 0.5
    vignetting: float = 0.07
    gain: float = 1.0
    gain_sd: float = 0.01
    gamma_sd: float = 0.002
    hold_s: float = 0.1
    full_well_e: float | None = 10_000.0
    read_noise_e: float = 7.0
    gamma: float = 2.2

    def __post_init__(self) -> None:
        values = np.array([value for value in vars(self).values() if value is not None], dtype=np.float64)
        full_well_e = 1.0 if self.full_well_e is None else self.full_well_e
        off = min(self.gain, self.hold_s, self.gamma, full_well_e) <= 0 or self.vignetting >= 1
        if off or not (np.isfinite(values) & (values >= 0)).all():
            raise DataError(
                f"impossible {self}: every parameter must be 0 or positive; gain, hold_s, full_well_e and "
                "gamma positive; vignetting below 1"
            )

    def exposure_at(self, seed: int, time_s: float) -> tuple[float, float]:
        """Gain and gamma at one time [s], which depend on the seed and the time alone."""
        if self.gain_sd == 0 and self.gamma_sd == 0:
            return self.gain, self.gamma
        # the next float down from a step's beginning belongs to that step
        step = int(np.floor(time_s / self.hold_s + 1e-6))
        a, b = np.random.default_rng([_STEPS, seed, abs(step), step < 0]).standard_normal(2)
        return self.gain * float(np.exp(self.gain_sd * a)), self.gamma * float(np.exp(self.gamma_sd * b))

    def signal(
        self, light: Light, camera: Pinhole, seed: int = 0, k: int = 0, time_s: float = 0.0, eye: int = 0
    ) -> Light:
        """Grey levels (H, W) before rounding, of light (H, W) that is already blurred by motion.

        Parameters
        ----------
        light : array (H, W)
            Linear radiance.
        camera : Pinhole
            The camera.
        seed, k, eye : int
            Seed, frame and camera (0 left, 1 right): together they draw the noise.
        time_s : float
            Time of the frame [s], by which the exposure steps.
        """
        gain, gamma = self.exposure_at(seed, time_s)
        light = point_spread(light, self.psf_sigma_px)
        light = vignetted(light, camera, self.vignetting) * np.float32(gain)
        rng = np.random.default_rng([2 + eye, seed, k])
        return displayed(noisy(light, self.full_well_e, self.read_noise_e, rng), gamma)

    def expose(
        self, light: Light, camera: Pinhole, seed: int = 0, k: int = 0, time_s: float = 0.0, eye: int = 0
    ) -> NDArray[np.uint8]:
        """Image (H, W): `signal` rounded to 8 bits."""
        return np.rint(self.signal(light, camera, seed, k, time_s, eye)).astype(np.uint8)


def motion_blurred(frame: Frame, camera: Pinhole, motions: RigidTransform) -> Light:
    """Light (H, W) of a frame, averaged along the way that each pixel moves while the shutter is open.

    The line is centred on the pixel, so that the blur moves nothing.

    Parameters
    ----------
    frame : Frame
        Seen in the middle of the exposure.
    camera : Pinhole
        The camera.
    motions : RigidTransform (1 + M,)
        Take points from the camera at the beginning to that at its end [m]: points of the static world,
        then those of each moving object.
    """
    rotations = np.ascontiguousarray(motions.rotation.as_matrix())
    translations = np.ascontiguousarray(motions.translation)
    intrinsics = np.array([camera.fx, camera.fy, camera.cx, camera.cy])
    movers = frame.movers if frame.movers is not None else np.full(frame.depth.shape, -1, np.int16)
    blurred = np.empty_like(frame.radiance)
    in_bands(
        lambda first, last: blur_rows(
            first, last, frame.radiance, frame.depth, movers, intrinsics, rotations, translations, blurred
        ),
        camera.height,
        24,
    )
    return blurred


def point_spread(light: Light, sigma_px: float) -> Light:
    """Light (H, W) after a Gaussian point spread."""
    if sigma_px == 0:
        return light
    blurred = cv2.GaussianBlur(light, (0, 0), sigma_px, borderType=cv2.BORDER_REPLICATE)
    return np.asarray(blurred, dtype=np.float32)


def vignetted(light: Light, camera: Pinhole, corner_loss: float) -> Light:
    """Light (H, W) after the fall-off towards the corners, the shape of a lens's cos^4."""
    return light if corner_loss == 0 else light * _fall_off(camera, corner_loss)


def noisy(light: Light, full_well_e: float | None, read_noise_e: float, rng: np.random.Generator) -> Light:
    """Light (H, W) with photon and read noise, both Gaussian: of N electrons, variance N + read_noise_e^2."""
    if full_well_e is None:
        return light
    electrons = np.maximum(light, 0) * np.float32(full_well_e)
    noise = np.sqrt(electrons + np.float32(read_noise_e**2))
    noise *= rng.standard_normal(light.shape, dtype=np.float32)
    return np.asarray((electrons + noise) / np.float32(full_well_e), dtype=np.float32)


def displayed(light: Light, gamma: float) -> Light:
    """Grey levels (H, W), 0 to 255, of light: clipped at saturation, then the response curve."""
    return np.asarray(np.float32(255) * np.clip(light, 0, 1) ** np.float32(1 / gamma), dtype=np.float32)


@lru_cache(maxsize=4)
def _fall_off(camera: Pinhole, corner_loss: float) -> Light:
    """Share of light (H, W) that arrives: 1 / (1 + a r^2)^2, which is cos^4 if r is the angle's tangent."""
    u, v = np.arange(camera.width) - camera.cx, np.arange(camera.height) - camera.cy
    squared = u**2 + v[:, None] ** 2
    a = (1 / np.sqrt(1 - corner_loss) - 1) / squared.max()
    return (1 / (1 + a * squared) ** 2).astype(np.float32)


DEFAULT_SENSOR = Sensor()

IDEAL_SENSOR = Sensor(
    exposure_s=0.0,
    psf_sigma_px=0.0,
    vignetting=0.0,
    gain_sd=0.0,
    gamma_sd=0.0,
    full_well_e=None,
    read_noise_e=0.0,
)
"""Neither blur nor noise nor steps: response curve and rounding alone."""
