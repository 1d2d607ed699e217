"""How scores of neighbouring flow vectors go together, measured against their distance on data with truth."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from scipy.optimize import nnls

from flowlik.calibration._kernels import products
from flowlik.calibration.distances import EDGES_PX, PER_OCTAVE, distances_px
from flowlik.errors import CalibrationError
from flowlik.likelihood.likelihood import FlowLikelihood
from flowlik.likelihood.shared_errors import SCALES_PX, ScoreCorrelation, flow_directions, shapes
from flowlik.measurement.measurements import Measurements
from flowlik.support.arrays import Array


@dataclass(frozen=True, eq=False)
class ScoreProducts:
    """Sums over pairs of vectors of an image pair, by distance: row 0 is each vector with itself.

    Every pair of vectors counts with the root of their information, as it does in a covariance, and every
    image pair alike: where errors are small, information is a hundredfold and would speak for all. Merging
    adds floats: blocks merged in the same order give the same bits, in another order nearly so.

    Attributes
    ----------
    dot, along, down : array (D + 1,)
        Sums of products of whitened scores in {i}, of their components along the flow, and of those
        along v.
    norm, cosine, steep : array (D + 1,)
        Sums of the weights alone, times the cosine between the two flows, and times the product of
        their directions' components along v.
    """

    dot: Array
    along: Array
    down: Array
    norm: Array
    cosine: Array
    steep: Array

    @classmethod
    def empty(cls) -> ScoreProducts:
        """Sums of nothing."""
        return cls(*np.zeros((6, len(EDGES_PX))))

    @classmethod
    def of(cls, likelihood: FlowLikelihood, m: Measurements, z: Array) -> ScoreProducts:
        """Sums over the vectors of one image pair with errors z (N, 2) [px] in the eigenbasis."""
        x = likelihood.coordinate(m)
        fisher = likelihood.fisher(x)
        scores = np.einsum("nij,nj->ni", m.R_i_e, likelihood.score(z, x) / np.sqrt(fisher))
        size = np.sqrt(fisher.mean(axis=1))
        size /= np.linalg.norm(size)
        sums = cls.empty()
        products(
            m.pixels, scores, flow_directions(m.flow), size, EDGES_PX[1], PER_OCTAVE,
            sums.dot, sums.along, sums.down, sums.norm, sums.cosine, sums.steep,
        )  # fmt: skip
        return sums

    def merge(self, other: ScoreProducts) -> ScoreProducts:
        """Sums of both."""
        names = (field.name for field in fields(self))
        return ScoreProducts(*(getattr(self, name) + getattr(other, name) for name in names))


def fit_correlation(sums: ScoreProducts) -> ScoreCorrelation:
    """All three sums of Gaussians by non-negative least squares, rows weighed by the root of their norm.

    At a distance the mean of ``dot`` is 2 rho + c rho_flow + rho_v, that of ``along`` is c rho + rho_flow +
    s rho_v, that of ``down`` rho + s rho_flow + rho_v, with c the mean cosine between flows and s the mean
    product of their components along v.

    Raises
    ------
    CalibrationError
        If there are no pairs of vectors.
    """
    scales = np.array(SCALES_PX)
    rows = np.flatnonzero(sums.norm[1:] > 0) + 1
    if not len(rows):
        raise CalibrationError("no pairs of flow vectors to take the correlation of scores from")
    norm = sums.norm[rows]
    near = shapes(distances_px()[rows], scales)[:, 1:]
    turned, steep = ((each[rows] / norm)[:, None] * near for each in (sums.cosine, sums.steep))
    basis = np.block([[2 * near, turned, near], [turned, near, steep], [near, steep, near]])
    means = np.concatenate([each[rows] / norm for each in (sums.dot, sums.along, sums.down)])
    root = np.tile(np.sqrt(norm / norm.max()), 3)
    fitted, _ = nnls(basis * root[:, None], means * root)
    # last bits differ between processes, and a model should not
    fitted = np.round(fitted, 9)
    isotropic, along, vertical = fitted.reshape(3, -1)
    # the rest of the scores' variance is each vector's own
    own = 0.5 * sums.dot[0] / sums.norm[0] - isotropic.sum() - 0.5 * (along.sum() + vertical.sum())
    return ScoreCorrelation(
        scales,
        np.concatenate([[max(round(own, 9), 0.0)], isotropic]),
        np.concatenate([[0.0], along]),
        np.concatenate([[0.0], vertical]),
    )
