"""Consistency of motions with their covariances: normalised estimation errors squared (NEES) and coverage."""

from __future__ import annotations

from collections.abc import Sequence as Seq
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import RigidTransform
from scipy.stats import chi2, trim_mean

from flowlik.errors import DataError
from flowlik.results.records import Record, protocol
from flowlik.support.arrays import Array

CONFIDENCES = (0.50, 0.90, 0.95)
TRIMMED = 0.05


@dataclass(frozen=True, eq=False)
class Consistency:
    """How squared errors in units of their covariances compare with the chi-square law of D freedoms.

    Attributes
    ----------
    nees : array (K,)
        Normalised squared errors of the frames.
    freedoms : int
        D: 6 with known depth, 5 for the epipolar residual.
    """

    nees: Array
    freedoms: int

    @property
    def mean(self) -> float:
        """Mean; D where covariances are honest."""
        return float(np.mean(self.nees))

    @property
    def trimmed_mean(self) -> float:
        """Mean without the 5 % smallest and largest, relative to that of the chi-square law, times D."""
        return float(trim_mean(self.nees, TRIMMED) / _trimmed_chi2(self.freedoms) * self.freedoms)

    @property
    def median(self) -> float:
        """Median; 5.35 for 6 freedoms where covariances are honest."""
        return float(np.median(self.nees))

    def coverage(self, confidence: float) -> float:
        """Share of errors within the ellipsoid of a confidence."""
        return float(np.mean(self.nees <= chi2.ppf(confidence, self.freedoms)))


def tangent_errors(estimated: Seq[RigidTransform], true: Seq[RigidTransform]) -> Array:
    """Errors (K, 6) of motions T_k_prev along the left tangent, (rotation vector [rad], translation [m])."""
    return np.array([(a * b.inv()).as_exp_coords() for a, b in zip(estimated, true)]).reshape(-1, 6)


def consistency(errors: Array, covariances: Array) -> Consistency:
    """Compare errors (K, 6) with covariances (K, 6, 6), within the directions that these know.

    Raises
    ------
    DataError
        If there are no frames, a covariance is not finite, or ranks differ between frames.
    """
    if not len(errors):
        raise DataError("no frames to judge the consistency of")
    if not np.isfinite(covariances).all():
        raise DataError("a covariance is not finite: leave frames without one out and count them")
    # metres and radians differ by orders of magnitude
    scale = np.sqrt(np.maximum(np.einsum("kii->ki", covariances), 1e-300))
    correlations = covariances / (scale[:, :, None] * scale[:, None, :])
    values, vectors = np.linalg.eigh(correlations)
    known = values > 1e-9
    freedoms = np.unique(known.sum(axis=1))
    if len(freedoms) > 1:
        raise DataError(f"covariances of different rank: {freedoms.tolist()}")
    along = np.einsum("kij,ki->kj", vectors, errors / scale) ** 2
    nees = np.sum(np.where(known, along / np.where(known, values, 1.0), 0.0), axis=1)
    return Consistency(nees, int(freedoms[0]))


def consistency_records(found: Consistency, base: Record, covariance: str) -> list[Record]:
    """NEES and coverage as records keyed as `base`; `covariance` says which: ``sandwich`` or ``product``."""
    note = f"{base.protocol}; " if base.protocol else ""
    note += protocol(covariance=covariance, freedoms=found.freedoms)
    values = {
        "nees_mean": found.mean,
        "nees_trimmed_mean": found.trimmed_mean,
        "nees_median": found.median,
        **{f"ellipsoid_coverage_{round(100 * c)}": found.coverage(c) for c in CONFIDENCES},
    }
    count = len(found.nees)
    return [replace(base, metric=m, value=v, unit="", count=count, protocol=note) for m, v in values.items()]


def _trimmed_chi2(freedoms: int) -> float:
    low, high = chi2.ppf([TRIMMED, 1 - TRIMMED], freedoms)
    # integral of x f(x), by the law of D + 2 freedoms
    return float(freedoms * np.diff(chi2.cdf([low, high], freedoms + 2))[0] / (1 - 2 * TRIMMED))
