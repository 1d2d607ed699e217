"""Intrinsics refined from images alone, a frame at a time, by the likelihood that finds the motion.

Every frame's epipolar errors say something about the intrinsics besides the motion. What is left after
the motion's five parameters are eliminated (Schur complement) goes into an information filter over principal
point and distortion; the next frame uses the new intrinsics, so that the filter is causal.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from flowlik.camera import Array, Distortion, Pinhole
from flowlik.egomotion.epipolar import Epipolar
from flowlik.likelihood import FlowLikelihood
from flowlik.measurements import Measurements

STEPS = {"f": 0.1, "cx": 0.1, "cy": 0.1, "k1": 1e-4, "k2": 1e-4}
"""Parameters an intrinsics filter may have, and the steps [px, 1] of their finite differences."""


@dataclass(frozen=True)
class SelfCalibration:
    """What is refined, and how freely.

    Attributes
    ----------
    sigma : tuple of (str, float)
        Parameters (`f`, `cx`, `cy` [px], `k1`, `k2`) and their prior standard deviations.
    temper : float
        Share of a frame's information that is believed: errors of neighbouring vectors, and of the same
        ones in the next frame, are not independent, and the likelihood does not fit exactly.
    drift : float
        Share of the prior variance that a parameter may change by in a frame.
    """

    sigma: tuple[tuple[str, float], ...] = (("cx", 4.0), ("k1", 0.02), ("k2", 0.01))
    temper: float = 0.3
    drift: float = 1e-6

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters."""
        return tuple(name for name, _ in self.sigma)


@dataclass(frozen=True, eq=False)
class Intrinsics:
    """A camera with what is known of its intrinsics.

    Attributes
    ----------
    nominal : Pinhole
        Camera as it was given.
    settings : SelfCalibration
        What may change.
    values : array (P,)
        Parameters: changes of focal length and principal point [px], distortion coefficients.
    covariance : array (P, P)
        Of these.
    frames : int
        Frames they come from.
    """

    nominal: Pinhole
    settings: SelfCalibration
    values: Array
    covariance: Array
    frames: int = 0

    @classmethod
    def prior(
        cls, camera: Pinhole, settings: SelfCalibration | None = None, distortion: Distortion | None = None
    ) -> Intrinsics:
        """Intrinsics of a camera as given."""
        settings, distortion = settings or SelfCalibration(), distortion or Distortion()
        begin = {"k1": distortion.k1, "k2": distortion.k2}
        values = np.array([begin.get(name, 0.0) for name in settings.names])
        return cls(camera, settings, values, np.diag([sigma**2 for _, sigma in settings.sigma]))

    @property
    def camera(self) -> Pinhole:
        """Camera with the refined focal length and principal point."""
        return self._with(self.values)[0]

    @property
    def distortion(self) -> Distortion:
        """Refined distortion."""
        return self._with(self.values)[1]

    @property
    def sigma(self) -> Array:
        """Standard deviations (P,) of the parameters."""
        return np.sqrt(np.diag(self.covariance))

    def rectified(self, m: Measurements) -> Measurements:
        """Measurements as a pinhole camera would have made them; to be used with `camera`."""
        return _rectified(m, *self._with(self.values))

    def updated(self, m: Measurements, T: Array, likelihood: FlowLikelihood) -> Intrinsics:
        """Intrinsics after a frame.

        Parameters
        ----------
        m : Measurements
            As the camera made them, not rectified.
        T : array (3, 4)
            Motion found with these intrinsics.
        likelihood : FlowLikelihood
            Of the flow.
        """
        residual = Epipolar.of(self.rectified(m), self.camera)
        _, normal, J = residual.linearise_with_normal(T)
        z = self._errors(m, T, self.values)
        x = likelihood.schedule.index.along(residual.measurements, normal)
        slopes = []
        for i, name in enumerate(self.settings.names):
            step = STEPS[name] * np.eye(len(self.values))[i]
            ahead, behind = (self._errors(m, T, self.values + s) for s in (step, -step))
            slopes.append((ahead - behind) / (2 * STEPS[name]))
        G = np.stack(slopes, axis=-1)
        J = J @ residual.basis(T)
        usable = np.isfinite(z) & np.isfinite(G).all(axis=1)
        z, J, G, x = z[usable], J[usable], G[usable], x[usable]
        weight = likelihood.weight(z, x)
        wz = weight * z
        # wrong intrinsics make errors that no component expects: these weigh as little as their slope says
        believed = np.minimum(weight, likelihood.fisher(x))[:, None]
        by_motion = np.linalg.solve(J.T @ (believed * J), np.column_stack([J.T @ (believed * G), -J.T @ wz]))
        H = G.T @ (believed * G) - (G.T @ (believed * J)) @ by_motion[:, :-1]
        b = -G.T @ wz - (G.T @ (believed * J)) @ by_motion[:, -1]
        return self._after(H, b)

    def _after(self, H: Array, b: Array) -> Intrinsics:
        """Intrinsics after a frame's information H (P, P) and gradient b (P,)."""
        prior = np.array([sigma**2 for _, sigma in self.settings.sigma])
        loosened = self.covariance + np.diag(self.settings.drift * prior)
        covariance = np.asarray(np.linalg.inv(np.linalg.inv(loosened) + self.settings.temper * H), float)
        values = self.values + covariance @ (self.settings.temper * b)
        return replace(self, values=values, covariance=covariance, frames=self.frames + 1)

    def _errors(self, m: Measurements, T: Array, values: Array) -> Array:
        """Epipolar errors (N,) in pixels of the images; ideal ones would reward shrinking them."""
        camera, distortion = self._with(values)
        ideal = _rectified(m, camera, distortion)
        z, normal, _ = Epipolar.of(ideal, camera).linearise_with_normal(T)
        return z * distortion.stretch(camera.rays(ideal.pixels + ideal.flow)[:, :2], normal)

    def _with(self, values: Array) -> tuple[Pinhole, Distortion]:
        change, c = dict(zip(self.settings.names, map(float, values))), self.nominal
        f = change.get("f", 0.0)
        camera = replace(
            c, fx=c.fx + f, fy=c.fy + f, cx=c.cx + change.get("cx", 0.0), cy=c.cy + change.get("cy", 0.0)
        )
        return camera, Distortion(change.get("k1", 0.0), change.get("k2", 0.0))


def _rectified(m: Measurements, camera: Pinhole, distortion: Distortion) -> Measurements:
    if distortion == Distortion():
        return m
    begin, end = (distortion.ideal_pixels(camera, p) for p in (m.pixels, m.pixels + m.flow))
    return replace(m, pixels=begin, flow=end - begin)
