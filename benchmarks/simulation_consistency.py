"""Do pictures agree with the true flow? Warping residuals, Lucas-Kanade's signed error, texture at rest."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates
from scipy.spatial.transform import RigidTransform

from flowlik.flow import LucasKanade
from flowlik.image.sampling import sample_flow
from flowlik.measurement.measurements import measure
from flowlik.simulation import IDEAL_SENSOR, Flight, SimulatedSequence
from naturalness import depth_smooth, texture_levels

Array = NDArray[np.float64]

TEXTURED = 3.0
"""Least t2 [intensity^2/px^2] of a textured pixel."""
TRACKED_PX = 1.0
"""Lucas-Kanade errors beyond this are failures to track, not biases."""
CREEP_STEPS = (1, 2, 4, 8)


@dataclass(frozen=True)
class Residuals:
    """Grey-level differences (N,) after and before warping by the true flow, in the pixels compared."""

    warped: Array
    unwarped: Array
    share: float

    @property
    def median(self) -> float:
        """Median of the absolute residual [grey levels]."""
        return float(np.median(np.abs(self.warped)))


def compared(sequence: SimulatedSequence, k: int) -> NDArray[np.bool_]:
    """Visible, depth-smooth pixels (H, W)."""
    return sequence.visible(k) & depth_smooth(sequence.depth(k))


def residuals(sequence: SimulatedSequence, k: int) -> Residuals:
    """Frame k + 1 read at the true ends by cubic splines, minus frame k."""
    image, later = sequence.image(k).astype(float), sequence.image(k + 1).astype(float)
    pixels = sequence.camera.pixel_grid().reshape(*image.shape, 2)
    mask = compared(sequence, k)
    ends = (pixels + sequence.flow(k))[mask]
    # not cv2.remap, which rounds positions to 1/32 px
    read = map_coordinates(later, ends.T[::-1], order=3, mode="nearest")
    return Residuals(read - image[mask], later[mask] - image[mask], float(mask.mean()))


def pooled(all_residuals: list[Residuals]) -> Residuals:
    """Join the residuals of several pairs."""
    return Residuals(
        np.concatenate([r.warped for r in all_residuals]),
        np.concatenate([r.unwarped for r in all_residuals]),
        float(np.mean([r.share for r in all_residuals])),
    )


def textured_pixels(sequence: SimulatedSequence, k: int, most: int) -> Array:
    """At most so many visible, depth-smooth, textured pixels (N, 2)."""
    image = sequence.image(k)
    textured = texture_levels(image)[1].reshape(image.shape) > TEXTURED
    wanted = sequence.camera.pixel_grid()[(compared(sequence, k) & textured).ravel()]
    if len(wanted) > most:
        wanted = wanted[np.random.default_rng(k).choice(len(wanted), most, replace=False)]
    return wanted


def lucas_kanade_errors(
    sequence: SimulatedSequence, k: int, method: LucasKanade, most: int = 20_000
) -> tuple[Array, Array]:
    """Signed errors (N, 2) and true flow (N, 2) [px] at textured pixels tracked."""
    pixels = textured_pixels(sequence, k, most)
    m = measure(sequence.image(k), sequence.image(k + 1), method, pixels=pixels)
    truth = sample_flow(sequence.flow(k), m.pixels)
    error = m.flow - truth
    tracked = np.linalg.norm(error, axis=1) < TRACKED_PX  # NaN, where the anchor has no truth, is not
    return error[tracked], truth[tracked]


def leftover_flow(sequence: SimulatedSequence, k: int, method: LucasKanade, most: int = 20_000) -> Array:
    """Flow (N, 2) [px] from frame k to frame k + 1 read at the true ends: none, if pictures follow the truth.

    Unlike the error itself it holds nothing of how motion varies within a patch.
    """
    image, flow = sequence.image(k), sequence.flow(k)
    ends = sequence.camera.pixel_grid() + np.where(np.isfinite(flow), flow, 0.0).reshape(-1, 2)
    read = map_coordinates(sequence.image(k + 1).astype(float), ends.T[::-1], order=3, mode="nearest")
    back = np.rint(read).clip(0, 255).astype(np.uint8).reshape(image.shape)
    left = measure(image, back, method, pixels=textured_pixels(sequence, k, most)).flow
    return left[np.linalg.norm(left, axis=1) < TRACKED_PX]


def there_and_back(sequence: SimulatedSequence) -> tuple[SimulatedSequence, SimulatedSequence]:
    """Return a flight without sensor effects, and the same flown backwards."""
    return tuple(
        SimulatedSequence(sequence.world, Flight.of(poses, name=name), sequence.camera, IDEAL_SENSOR)
        for name, poses in (("there", sequence.poses), ("back", sequence.poses[::-1]))
    )  # type: ignore[return-value]


@dataclass(frozen=True)
class Creep:
    """What a sideways camera sees after 1, 2, 4 and 8 steps: median residuals, and the texture's own motion.

    `share` is the least-squares factor of Lucas-Kanade's error over the true flow: 0 for a texture fixed to
    the world, -1 for one fixed to the camera.
    """

    residuals: tuple[float, ...]
    share: float


def creep(sequence: SimulatedSequence, frames: list[int], step_m: float) -> Creep:
    """Move the camera sideways from some frames of a flight, so that depth and detail stay what they are."""
    of_step: dict[int, list[Residuals]] = {n: [] for n in CREEP_STEPS}
    errors, truths = [], []
    for k in frames:
        for n in CREEP_STEPS:
            aside = RigidTransform.from_translation([[0, 0, 0], [n * step_m, 0, 0]])
            pair = SimulatedSequence(
                sequence.world, Flight.of(sequence.T_n_c(k) * aside), sequence.camera, IDEAL_SENSOR
            )
            of_step[n].append(residuals(pair, 0))
            error, truth = lucas_kanade_errors(pair, 0, LucasKanade(), 5000)
            errors.append(error[:, 0])
            truths.append(truth[:, 0])
    error, truth = np.concatenate(errors), np.concatenate(truths)
    return Creep(
        tuple(pooled(of_step[n]).median for n in CREEP_STEPS), float((error @ truth) / (truth @ truth))
    )
