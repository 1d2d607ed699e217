"""Depth that errs: how much wider the errors of flow are for it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import RigidTransform

from flowlik.egomotion.known_depth import KnownDepth
from flowlik.errors import DataError
from flowlik.likelihood.likelihood import FlowLikelihood
from flowlik.support.arrays import Array


def with_depth_errors(
    residual: KnownDepth, likelihood: FlowLikelihood, T_k_prev: RigidTransform, rho_sd: Array
) -> KnownDepth:
    """Residual whose components count for less where an error of their depth moves the predicted flow.

    An error of the inverse range moves the prediction along the parallax. Component e then errs by
    ``1 / fisher(x) + (e . dh/drho)^2 rho_sd^2`` in place of ``1 / fisher(x)``: it is divided by the root of
    their ratio. Errors that points share, as of the place of a sensor, are not in it.

    Parameters
    ----------
    residual : KnownDepth
        Flow of points of depth that is known to a standard deviation.
    likelihood : FlowLikelihood
        Of the flow alone.
    T_k_prev : RigidTransform
        A motion near the true one, of which the parallax is taken [m].
    rho_sd : array (N,)
        Standard deviation of each inverse range [1/m] in the residual's order.

    Raises
    ------
    DataError
        If deviations are not (N,), or one is negative or not finite.
    """
    if rho_sd.shape != residual.rho.shape or not (np.isfinite(rho_sd).all() and (rho_sd >= 0).all()):
        raise DataError(
            f"{len(residual.rho)} points need as many finite deviations of inverse range, from 0 on"
        )
    camera, t = residual.camera, np.asarray(T_k_prev.translation)
    points = T_k_prev.rotation.apply(camera.p2v(residual.measurements.pixels)) + np.outer(residual.rho, t)
    along = camera.v2p_jacobian(points) @ t
    moved_px = np.einsum("nij,ni->nj", residual.measurements.R_i_e, along) * rho_sd[:, None]
    fisher = likelihood.fisher(residual.coordinates(likelihood.schedule.index)).reshape(-1, 2)
    widened = np.sqrt(1 + np.where(points[:, 2:] > 0, fisher * moved_px**2, 0.0))
    return replace(residual, widened=widened)
