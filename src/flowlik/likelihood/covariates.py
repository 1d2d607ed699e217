"""Covariates: what the error of a flow component may depend on, each one function of measurements.

A covariate is a function of Measurements and of a unit direction in {i}; along the eigenvectors it gives the
(N, 2) values of the eigen-components, along an epipolar normal those of the epipolar error. Some need signals
that cost more flow (`flowlik.measurement.SIGNALS`); a schedule names its covariates, so that only these
are measured.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from flowlik.errors import ModelError
from flowlik.measurement.measurements import Measurements
from flowlik.support.arrays import Array


@dataclass(frozen=True)
class Covariate:
    """One covariate.

    Attributes
    ----------
    name, unit : str
        As model files and figures name it.
    floor : float
        Values below it [unit] mean nothing; it keeps the logarithm finite.
    along : callable
        ``along(measurements, n)``: values (N,) >= 0 along unit vectors n (N, 2) in {i}; infinite where the
        signal behind it is missing, as where the flow has no way back.
    signals : tuple of str
        What must have been measured, names in `flowlik.measurement.SIGNALS`.
    isotropic : bool
        Whether it is the same along every direction.
    """

    name: str
    unit: str
    floor: float
    along: Callable[[Measurements, Array], Array]
    signals: tuple[str, ...] = ()
    isotropic: bool = False


def _normal(n: Array) -> Array:
    return np.stack([-n[:, 1], n[:, 0]], axis=-1)


def _dot(a: Array, n: Array) -> Array:
    return np.abs(a[:, 0] * n[:, 0] + a[:, 1] * n[:, 1])


def _texture(m: Measurements, n: Array) -> Array:
    first, second = (_dot(m.R_i_e[:, :, j], n) for j in (0, 1))
    return first**2 * m.t[:, 0] + second**2 * m.t[:, 1]


def _signal(m: Measurements, name: str) -> Array:
    if name not in m.signals:
        raise ModelError(f"the schedule needs the signal {name!r}, which was not measured")
    return m.signals[name]


def _known(values: Array) -> Array:
    return np.where(np.isfinite(values), values, np.inf)


def _projected(name: str, across: bool = False) -> Callable[[Measurements, Array], Array]:
    # infinite in both components where there is no way back: no direction of it is better known
    return lambda m, n: _known(_dot(_signal(m, name), _normal(n) if across else n))


def _standard_error(m: Measurements, n: Array) -> Array:
    xx, xy, yy = _known(_signal(m, "standard-error")).T
    variance = n[:, 0] ** 2 * xx + 2 * n[:, 0] * n[:, 1] * xy + n[:, 1] ** 2 * yy
    return np.sqrt(np.maximum(variance, 0.0))


def _own_uncertainty(m: Measurements, n: Array) -> Array:
    # along u and v taken for uncorrelated, as networks take them
    own = _known(_signal(m, "own-uncertainty"))
    return np.hypot(own[:, 0] * n[:, 0], own[:, 1] * n[:, 1])


def _any_direction(name: str) -> Callable[[Measurements, Array], Array]:
    return lambda m, n: _known(_signal(m, name))


COVARIATES: dict[str, Covariate] = {
    c.name: c
    for c in (
        Covariate("texture", "intensity²/px²", 1e-2, _texture),
        Covariate("texture-across", "intensity²/px²", 1e-2, lambda m, n: _texture(m, _normal(n))),
        Covariate("flow", "px", 0.05, lambda m, n: np.linalg.norm(m.flow, axis=1), isotropic=True),
        Covariate("flow-along", "px", 0.02, lambda m, n: _dot(m.flow, n)),
        Covariate("discrepancy", "px", 1e-3, _projected("discrepancy"), ("discrepancy",)),
        Covariate("discrepancy-across", "px", 1e-3, _projected("discrepancy", across=True), ("discrepancy",)),
        Covariate("patch-discrepancy", "px", 1e-3, _projected("patch-discrepancy"), ("patch-discrepancy",)),
        Covariate(
            "patch-discrepancy-across", "px", 1e-3, _projected("patch-discrepancy", across=True),
            ("patch-discrepancy",),
        ),
        Covariate("residual", "intensity", 0.3, _any_direction("residual"), ("residual",), True),
        Covariate("spread", "px", 1e-2, _any_direction("spread"), ("spread",), True),
        Covariate("standard-error", "px", 1e-4, _standard_error, ("standard-error",)),
        Covariate("own-uncertainty", "px", 1e-3, _own_uncertainty, ("own-uncertainty",)),
    )
}  # fmt: skip


def covariate(name: str) -> Covariate:
    """Covariate of a name.

    Raises
    ------
    ModelError
        If there is none of that name.
    """
    if name not in COVARIATES:
        raise ModelError(f"unknown covariate {name!r}: known are {', '.join(COVARIATES)}")
    return COVARIATES[name]


def of_components(name: str, m: Measurements) -> Array:
    """Values (N, 2) of a covariate for the eigen-components of measurements.

    Raises
    ------
    ModelError
        If there is none of that name, or a signal that it needs was not measured.
    """
    along = covariate(name).along
    return np.stack([along(m, m.R_i_e[:, :, j]) for j in (0, 1)], axis=-1)
