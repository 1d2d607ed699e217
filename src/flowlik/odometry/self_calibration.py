"""Intrinsics refined from images alone, a frame at a time, by the likelihood that finds the motion.

Epipolar errors of a frame's inliers say something about the intrinsics besides the motion. What is left
after the motion's five parameters are eliminated (Schur complement) goes into a Kalman filter over principal
point and distortion; the next frame uses the new intrinsics, so that the filter is causal.

A frame's information H and gradient b are worth less than they claim. The whitened gradient ``H^-1/2 b`` of
a true camera has a variance above 1, since errors of neighbouring vectors are not independent, and a part
that stays over many frames: flow's own systematic errors, which on a straight road look like another camera.
Both are in the filter as measured on simulated drives: noise of variance `noise`, and one more state a
parameter, a first-order Gauss-Markov process of variance `persistent` that forgets within `memory` frames.
Where images are worse than simulated ones, the filter's own innovations tell by how much: both variances are
multiplied by the mean of their squares so far. A frame most of whose tracks are wrong tells so itself, before
the filter has learned anything: both variances grow with the square of its errors' excess, for wrong tracks
agree with those of the frames around them.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from flowlik.egomotion.epipolar import Epipolar
from flowlik.egomotion.estimator import Estimator
from flowlik.egomotion.maximise import transform
from flowlik.geometry.camera import Distortion, Pinhole
from flowlik.likelihood.tables import look_up
from flowlik.measurement.measurements import Measurements
from flowlik.support.arrays import Array

STEPS = {"f": 0.01, "cx": 0.01, "cy": 0.01, "k1": 1e-5, "k2": 1e-5}
"""Parameters an intrinsics filter may have, and the steps [px, 1] of their finite differences."""

LEAST_INFORMATION = 1e-9


@dataclass(frozen=True)
class SelfCalibration:
    """What is refined, and how freely.

    Attributes
    ----------
    sigma : tuple of (str, float)
        Parameters (`f`, `cx`, `cy` [px], `k1`, `k2`) and their prior standard deviations.
    noise : float
        Variance of a frame's whitened gradient that is new in every frame; 1 were errors independent.
    persistent : float
        Variance of the part that stays.
    memory : float
        Frames within which it is forgotten.
    trusted : float
        Frames that the belief in these two variances counts as, against the innovations seen.
    drift : float
        Share of the prior variance that a parameter may change by in a frame.
    """

    sigma: tuple[tuple[str, float], ...] = (("cx", 4.0), ("k1", 0.02), ("k2", 0.01))
    noise: float = 2.0
    persistent: float = 0.3
    memory: float = 30.0
    trusted: float = 10.0
    drift: float = 1e-6

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters."""
        return tuple(name for name, _ in self.sigma)

    @property
    def prior_variances(self) -> Array:
        """Prior variances (P,) of the parameters."""
        return np.array([sigma**2 for _, sigma in self.sigma])


class FrameEvidence(NamedTuple):
    """What a frame says about the parameters, and how its motion hangs on them.

    Attributes
    ----------
    H : array (P, P)
        Information, the motion eliminated.
    b : array (P,)
        Gradient.
    excess : float
        Median of the frame's errors, each over the median that the likelihood expects of it; at least 1.
    motion_slopes : array (6, P)
        Change of the motion found, along its left tangent, by the parameters.
    """

    H: Array
    b: Array
    excess: float
    motion_slopes: Array


@dataclass(frozen=True, eq=False)
class Intrinsics:
    """A camera with what is known of its intrinsics.

    Attributes
    ----------
    nominal : Pinhole
        Camera as it was given.
    settings : SelfCalibration
        What may change.
    state : array (2 P,)
        Parameters, then the persistent part of whitened gradients.
    joint : array (2 P, 2 P)
        Covariance of the state.
    frames : int
        Frames they come from.
    squares : float
        Sum of the squared innovations of these, each in units of what was expected of it.
    """

    nominal: Pinhole
    settings: SelfCalibration
    state: Array
    joint: Array
    frames: int = 0
    squares: float = 0.0

    @classmethod
    def prior(
        cls, camera: Pinhole, settings: SelfCalibration | None = None, distortion: Distortion | None = None
    ) -> Intrinsics:
        """Intrinsics of a camera as given."""
        settings, distortion = settings or SelfCalibration(), distortion or Distortion()
        begin = {"k1": distortion.k1, "k2": distortion.k2}
        values = np.array([begin.get(name, 0.0) for name in settings.names])
        variances = settings.prior_variances, np.full(len(values), settings.persistent)
        return cls(camera, settings, np.concatenate([values, 0 * values]), np.diag(np.concatenate(variances)))

    @property
    def values(self) -> Array:
        """Parameters (P,): changes of focal length and principal point [px], distortion coefficients."""
        return self.state[: len(self.settings.sigma)]

    @property
    def covariance(self) -> Array:
        """Covariance (P, P) of the parameters."""
        count = len(self.settings.sigma)
        return self.joint[:count, :count]

    @property
    def misfit(self) -> float:
        """How many times as large as in simulation the variances of gradients are, at least 1."""
        if not np.isfinite(trusted := self.settings.trusted):
            return 1.0
        return max((trusted + self.squares) / (trusted + self.frames), 1.0)

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

    def evidence(self, m: Measurements, T: Array, estimator: Estimator) -> FrameEvidence:
        """What a frame says about the parameters.

        Parameters
        ----------
        m : Measurements
            As the camera made them, not rectified.
        T : array (3, 4)
            Motion found with these intrinsics.
        estimator : Estimator
            Which found it: its inliers tell of the camera too.
        """
        likelihood, residual = estimator.likelihood, Epipolar.of(self.rectified(m), self.camera)
        _, _, J, x, _, basis = residual.at(T, likelihood.schedule.index)
        z, G = self.linearise(m, T)
        J = J @ basis
        usable = np.isfinite(z) & np.isfinite(G).all(axis=1)
        expected = likelihood.bound(x[usable], 0.5)
        excess = float(np.median(np.abs(z[usable]) / expected)) if usable.any() else 1.0
        # wrong tracks along one structure err alike, and outweigh what a frame knows of its camera
        usable &= estimator.inliers(residual, transform(T)).ravel()
        z, x, J, G = z[usable], x[usable], J[usable], G[usable]
        weight = look_up(likelihood.compiled.weight, likelihood.compiled.rows(x), z)
        # wrong intrinsics make errors that no component expects: these weigh as little as their slope says
        believed = np.minimum(weight, likelihood.fisher(x))[:, None]
        # slopes along directions that no motion explains, so that the gradient needs no exact maximum
        slopes = -np.linalg.lstsq(J.T @ (believed * J), J.T @ (believed * G), rcond=None)[0]
        G = G + J @ slopes
        return FrameEvidence(G.T @ (believed * G), -G.T @ (weight * z), max(excess, 1.0), basis @ slopes)

    def linearise(self, m: Measurements, T: Array) -> tuple[Array, Array]:
        """Epipolar errors (N,) [px] at the present values, and their Jacobian (N, P) by the parameters."""
        z, slopes = self._errors(m, T, self.values), []
        for i, name in enumerate(self.settings.names):
            step = STEPS[name] * np.eye(len(self.values))[i]
            slopes.append((self._errors(m, T, self.values + step) - z) / STEPS[name])
        return z, np.stack(slopes, axis=-1)

    def motion_covariance(self, evidence: FrameEvidence) -> Array:
        """Covariance (6, 6) that not knowing the parameters exactly adds to a motion found with them."""
        return evidence.motion_slopes @ self.covariance @ evidence.motion_slopes.T

    def updated(self, evidence: FrameEvidence) -> Intrinsics:
        """Intrinsics after a frame."""
        H, b, excess, _ = evidence
        settings, count = self.settings, len(b)
        prior, kept = settings.prior_variances, np.exp(-1 / settings.memory)
        fades = np.concatenate([np.ones(count), np.full(count, kept)])
        # what wrong tracks say stays as well: without that, ten such frames would count as ten witnesses
        renewed = np.full(count, settings.persistent * ((1 - kept**2) * self.misfit + excess**2 - 1))
        state = fades * self.state
        joint = fades[:, None] * self.joint * fades + np.diag(
            np.concatenate([settings.drift * prior, renewed])
        )
        # whitened in units of the prior, where the square root treats all parameters alike
        unit = np.sqrt(prior)
        values, vectors = np.linalg.eigh(unit[:, None] * H * unit)
        informed = values > LEAST_INFORMATION * max(1.0, values[-1])
        roots = np.sqrt(values[informed])
        W = roots[:, None] * vectors[:, informed].T
        u = (vectors[:, informed].T @ (unit * b)) / roots
        # u = W (true - present values) + persistent + new noise, in the eigenbasis of the information
        M = np.hstack([W / unit, vectors[:, informed].T])
        innovation = u - vectors[:, informed].T @ state[count:]
        known, new = M @ joint @ M.T, excess**2 * settings.noise * np.eye(len(u))
        square = innovation @ np.linalg.solve(known + new, innovation) / max(len(u), 1)
        seen = replace(self, frames=self.frames + 1, squares=self.squares + (square if len(u) else 1.0))
        gain = joint @ M.T @ np.linalg.inv(known + seen.misfit * new)
        joint = joint - gain @ M @ joint
        return replace(seen, state=state + gain @ innovation, joint=0.5 * (joint + joint.T))

    def _errors(self, m: Measurements, T: Array, values: Array) -> Array:
        """Epipolar errors (N,) in pixels of the images; ideal ones would reward shrinking them."""
        camera, distortion = self._with(values)
        ideal = _rectified(m, camera, distortion)
        z, normal, _ = Epipolar.of(ideal, camera).linearise(T)
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
