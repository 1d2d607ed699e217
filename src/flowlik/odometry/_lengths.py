"""Lengths of motions over time: which one told is to be believed, and which to expect where none is."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from flowlik.egomotion import EgoMotion
from flowlik.egomotion.result import of_rotation
from flowlik.geometry.motion import scaled
from flowlik.support.arrays import Array

# a step changes from frame to frame by this share of the longest of late, which fades by FADING a frame
CHANGE, FADING = 0.05, 0.98
# standard deviations beyond which a length is refused: a tenth of a percent of good ones are
GATE = 3.29
# so many lengths refused in a row, all within a third of their median, are believed
AGREEING, APART = 3, 1 / 3


@dataclass(frozen=True, eq=False)
class Length:
    """Length of a motion, told by a scale source.

    Attributes
    ----------
    metres : float
        Length [m].
    sigma_m : float
        Standard deviation [m] of its error where the motion is as given; 0 for a length taken as exact.
    by_motion : array (6,)
        Derivative of its logarithm by the left tangent of the motion of unit length: how the motion's
        error enters it.
    """

    metres: float
    sigma_m: float = 0.0
    by_motion: Array = field(default_factory=lambda: np.zeros(6))

    def sigma_with(self, covariance: Array) -> float:
        """Standard deviation [m] with the error of the motion of unit length, covariance (6, 6)."""
        return float(
            np.hypot(self.sigma_m, self.metres * np.sqrt(self.by_motion @ covariance @ self.by_motion))
        )


@dataclass(frozen=True)
class LengthModel:
    """A random walk of lengths, as the lengths told so far have it.

    Attributes
    ----------
    metres : float or None
        Length [m] of the last frame; None before the first.
    sigma_m : float
        Its standard deviation [m].
    longest_m : float
        Longest step of late [m]: what changes are measured by.
    missed : int
        Frames since one was believed.
    refused : tuple of float
        Lengths [m] refused in a row.
    """

    metres: float | None = None
    sigma_m: float = 0.0
    longest_m: float = 0.0
    missed: int = 0
    refused: tuple[float, ...] = ()

    def predict(self) -> tuple[float, float] | None:
        """Length [m] expected next and its standard deviation [m]; None before the first."""
        if self.metres is None:
            return None
        change = CHANGE * self.longest_m * np.sqrt(self.missed + 1)
        return self.metres, float(np.hypot(self.sigma_m, change))

    def believes(self, metres: float, sigma_m: float) -> bool:
        """Whether a length told is believed: it is exact, as expected, or several in a row agree."""
        expected = self.predict()
        if sigma_m == 0 or expected is None or self.longest_m == 0:
            return True
        if abs(metres - expected[0]) <= GATE * np.hypot(sigma_m, expected[1]):
            return True
        row = np.array([*self.refused[1 - AGREEING :], metres])
        middle = float(np.median(row))
        return len(row) == AGREEING and bool((np.abs(row - middle) <= APART * middle).all())

    def updated(self, metres: float, sigma_m: float) -> LengthModel:
        """Return the model after a length that is believed; one that was not expected begins anew."""
        longest = max(metres, FADING * self.longest_m)
        expected = self.predict()
        if expected is None or abs(metres - expected[0]) > GATE * np.hypot(sigma_m, expected[1]):
            return LengthModel(metres, sigma_m, longest)
        gain = expected[1] ** 2 / (expected[1] ** 2 + sigma_m**2) if sigma_m > 0 else 1.0
        mean = expected[0] + gain * (metres - expected[0])
        return LengthModel(mean, float(np.sqrt(gain) * sigma_m), longest)

    def skipped(self, refused: float | None = None) -> LengthModel:
        """Return the model after a frame without a length that is believed."""
        row = () if refused is None else (*self.refused, refused)[-AGREEING:]
        return replace(self, missed=self.missed + 1, refused=row)


def with_length(
    motion: EgoMotion, told: Length | None, model: LengthModel, name: str
) -> tuple[EgoMotion, LengthModel]:
    """Give a motion of unit length the length told, or else the expected one; and the model after it.

    Parameters
    ----------
    motion : EgoMotion
        Motion that was solved, with a translation of unit length.
    told : Length or None
        What a scale source tells.
    model : LengthModel
        Lengths so far.
    name : str
        Name of the source, for the reason.
    """
    if told is not None:
        sigma_m = told.sigma_with(motion.covariance) if told.by_motion.any() else told.sigma_m
        if model.believes(told.metres, sigma_m):
            return rescaled(motion, told), model.updated(told.metres, sigma_m)
    why = f"{name} tells no length" if told is None else f"{name} tells {told.metres:.3g} m, not expected"
    after = model.skipped(None if told is None else told.metres)
    if (expected := model.predict()) is None:
        unknown = of_rotation(motion.covariance, np.nan)
        return replace(motion, covariance=unknown, reason=f"{why}: length unknown"), after
    guess = rescaled(motion, Length(*expected))
    reason = f"{why}: {expected[0]:.3g} m by the lengths before"
    return replace(guess, scale_known=False, length_predicted=True, reason=reason), after


def rescaled(motion: EgoMotion, length: Length) -> EgoMotion:
    """Return a motion of unit length with a length [m], whose error enters the covariance.

    A translation ``s t`` errs by ``s (upsilon + t d)`` where the unit one errs by upsilon, and the logarithm
    of the length by ``d = by_motion . xi + e``: e has the length's own standard deviation.
    """
    factor = np.repeat([1.0, length.metres], 3)
    t = motion.T_k_prev.translation
    covariance = motion.covariance * np.outer(factor, factor)
    if length.sigma_m > 0:
        along = np.concatenate([np.zeros(3), t / np.linalg.norm(t)])
        spread = np.diag(factor) + length.metres * np.outer(along, length.by_motion)
        covariance = spread @ motion.covariance @ spread.T + length.sigma_m**2 * np.outer(along, along)
    information = motion.information / np.outer(factor, factor) if length.metres > 0 else motion.information
    return replace(
        motion,
        T_k_prev=scaled(motion.T_k_prev, length.metres),
        information=information,
        covariance=covariance,
        sensitivity=None,
        scale_known=True,
    )
