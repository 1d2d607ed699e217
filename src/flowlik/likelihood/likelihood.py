"""FlowLikelihood: an error family over a schedule, the model that is calibrated, saved and used."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike
from scipy.integrate import trapezoid
from scipy.interpolate import RegularGridInterpolator

from flowlik.errors import ModelError
from flowlik.image.texture import TextureDefinition
from flowlik.likelihood import tables
from flowlik.likelihood._ellipses import ellipse_factors
from flowlik.likelihood.families import ErrorFamily, Gaussian
from flowlik.likelihood.schedule import Index, Schedule, check_values
from flowlik.likelihood.shared_errors import SharedErrors
from flowlik.measurement.measurements import Measurements
from flowlik.support.arrays import Array

BOUND_NODES = 513
ELLIPSE_NODES = 17

Errors = Literal["depth", "epipolar"]
"""Whose errors: both components of flow of known depth, or the one across an epipolar line."""


@dataclass(frozen=True, eq=False)
class FlowLikelihood:
    """Distribution of one error component z [px] given its schedule coordinate x.

    The five functions `log_prob`, `score`, `weight`, `bound` and `fisher` are all that estimators and
    filters need; both residuals (known depth, epipolar) turn a pose into (z, J, x).

    Attributes
    ----------
    family : ErrorFamily
        Density whose parameters the schedule gives.
    schedule : Schedule
        Look-up table theta(x; u).
    texture : TextureDefinition
        Definition of texture the table was calibrated with.
    method : dict or None
        Flow method's name and parameters; None for a likelihood of any flow, as RANSAC's.
    provenance, goodness : dict
        Where the table comes from, and figures of how well it fits.
    shared_errors : SharedErrors
        What the errors of an image have in common.
    residual : {"depth", "epipolar"}
        Which errors it was calibrated on. One of both components of a vector serves along any direction,
        across epipolar lines too; one of errors across these lines serves there alone.

    Raises
    ------
    ModelError
        If the table's parameters do not fit the family or leave its bounds.
    """

    family: ErrorFamily
    schedule: Schedule
    texture: TextureDefinition = field(default_factory=TextureDefinition)
    method: dict[str, Any] | None = None
    provenance: dict[str, Any] = field(default_factory=dict)
    goodness: dict[str, Any] = field(default_factory=dict)
    shared_errors: SharedErrors = field(default_factory=SharedErrors)
    residual: Errors = "depth"

    def __post_init__(self) -> None:
        check_values(self.family, self.schedule)

    @classmethod
    def constant_gaussian(cls, sigma_px: float) -> FlowLikelihood:
        """Gaussian with one standard deviation [px] for any flow and texture: RANSAC's likelihood."""
        return cls(Gaussian(), Schedule.constant(np.array([sigma_px])))

    def with_index(self, index: Index) -> FlowLikelihood:
        """Likelihood of the same table over another index; what was tabulated is kept."""
        other = replace(self, schedule=replace(self.schedule, index=index))
        names = [name for name, value in vars(type(self)).items() if isinstance(value, cached_property)]
        other.__dict__.update({name: self.__dict__[name] for name in names if name in self.__dict__})
        return other

    @property
    def signals(self) -> tuple[str, ...]:
        """Signals that `flowlik.measure` must measure for this model."""
        return self.schedule.index.signals

    def coordinate(self, measurements: Measurements) -> Array:
        """Schedule coordinates x (N, 2) of every eigen-component.

        Raises
        ------
        ModelError
            If the model is for another flow method or texture, or of errors across epipolar lines alone.
        """
        self.check(measurements)
        self.check_components()
        return self.schedule.index.of(measurements)

    def check(self, measurements: Measurements) -> None:
        """Raise ModelError unless the measurements' flow method and texture are the model's."""
        if self.method is not None and self.method != measurements.method:
            raise ModelError(
                f"the model is for the flow {self.method}, the measurements are of {measurements.method}"
            )
        if self.method is not None and self.texture != measurements.texture:
            raise ModelError(f"the model is for {self.texture}, the measurements have {measurements.texture}")

    def check_components(self) -> None:
        """Raise ModelError if the model tells nothing of errors along epipolar lines."""
        if self.residual == "epipolar":
            raise ModelError(
                "the model knows errors across epipolar lines alone, not along them: it serves motions "
                "without depth; take one calibrated with depth, or the one that ships"
            )

    def log_prob(self, z: ArrayLike, x: Array | float) -> Array:
        """Log-density [nat] of errors z [px] at coordinates x."""
        return self.family.logpdf(z, self.schedule.theta(x))

    def score(self, z: ArrayLike, x: Array | float) -> Array:
        """Derivative [nat/px] of `log_prob` by z."""
        return self.family.gradient(z, self.schedule.theta(x))[0]

    def weight(self, z: ArrayLike, x: Array | float) -> Array:
        """Weight [1/px^2] of z in iteratively reweighted least squares, ``-score / z``.

        abs(z) is floored at a tenth of the median error at x, so that a cusp at 0 stays finite.
        """
        theta = self.schedule.theta(x)
        floored = np.maximum(np.abs(z), 0.1 * self.family.magnitude_ppf(0.5, theta))
        return np.maximum(-self.family.gradient(floored, theta)[0] / floored, 0.0)

    def cdf(self, z: ArrayLike, x: Array | float) -> Array:
        """Distribution function at errors z [px] and coordinates x."""
        return self.family.cdf(z, self.schedule.theta(x))

    def sample(self, x: Array, rng: np.random.Generator) -> Array:
        """Random errors [px], one for each coordinate x."""
        return self.family.rvs(self.schedule.theta(x), np.shape(x), rng)

    def bound(self, x: Array | float, confidence: float) -> Array:
        """Half-width b [px] with ``P(abs(z) <= b) = confidence`` at x.

        Solved on 513 nodes between the outer knots; between nodes it is interpolated.
        """
        if not 0 < confidence < 1:
            raise ModelError(f"confidence must lie between 0 and 1, not {confidence}")
        if confidence not in self._bounds:
            theta = self.schedule.theta(self._nodes)
            self._bounds[confidence] = self.family.magnitude_ppf(confidence, theta)
        return self._interpolate(x, self._bounds[confidence])

    def fisher(self, x: Array | float, confidence: float | None = None) -> Array:
        """Fisher information [1/px^2] of one component at x, ``E[(d ln p / dz)^2]`` by quadrature.

        With a confidence it is ``E[(d ln p / dz)^2; abs(z) <= bound]``: both the sensitivity and the
        variance of a score that is cut off at its bound.
        """
        if confidence not in self._informations:
            self._informations[confidence] = self._information(confidence)
        return self._interpolate(x, self._informations[confidence])

    def covariance(self, measurements: Measurements, level: float = 0.9) -> Array:
        """Covariances (N, 2, 2) [px^2] in {i} of flow vectors, for a filter that takes Gaussians.

        Each is of the Gaussian whose ellipse of that level holds that share of errors, by this model. The
        ellipse lies along the eigenbasis, its axes in the ratio of the components' bounds. Errors beyond are
        larger than the Gaussian says: a filter should gate at the same level (docs/in-your-own-filter.md).

        Parameters
        ----------
        measurements : Measurements
            Flow vectors.
        level : float
            Share of errors that the ellipse holds: the filter's gate.

        Raises
        ------
        ModelError
            If the model is for another flow or texture, knows errors across epipolar lines alone, or the
            level does not lie between 0 and 1.
        """
        x = self.coordinate(measurements)
        half_axes = self._ellipse_factor(x, level)[:, None] * self.bound(x, level)
        # of a Gaussian whose ellipse has these half-axes
        variances = half_axes**2 / (-2.0 * np.log1p(-level))
        R_i_e = measurements.R_i_e
        return np.asarray(np.einsum("nij,nj,nkj->nik", R_i_e, variances, R_i_e))

    def composite_weight(self, x: Array | float) -> Array:
        """Weight in (0, 1] of a component's log-density in an estimate over many, ``(f / max f)^power``.

        Errors that vectors share are the larger part of wide ones: in a product of likelihoods, as if all
        were independent, components of little information f would count too much
        (docs/theory-covariance.md).
        """
        if (power := self.shared_errors.composite_power) == 0:
            return np.ones(np.shape(x))
        return np.asarray((self.fisher(x) / self._most_fisher) ** power)

    def _interpolate(self, x: Array | float, values: Array) -> Array:
        """Values at x, given at the nodes."""
        flat = np.asarray(x, dtype=np.float64)
        step = self._nodes[1] - self._nodes[0]
        return tables.interpolate(flat.ravel(), self._nodes[0], step, values).reshape(flat.shape)

    @cached_property
    def compiled(self) -> tables.LikelihoodTables:
        """Tables of log-density and weight that kernels read; they know no family."""
        return tables.compile_tables(self.log_prob, self.weight, self.schedule.knots)

    @cached_property
    def composite(self) -> tables.LikelihoodTables:
        """Tables like `compiled`, times `composite_weight`."""
        if self.shared_errors.composite_power == 0:
            return self.compiled
        return self.compiled.times(self.composite_weight(self.compiled.x)[:, None].astype(np.float32))

    @cached_property
    def _most_fisher(self) -> float:
        return float(self.fisher(self._nodes).max())

    def _ellipse_factor(self, x: Array, level: float) -> Array:
        """Half-axes (N,) of the ellipses over the bounds of both components, at coordinates x (N, 2)."""
        knots = self.schedule.knots
        nodes = np.linspace(knots[0], knots[-1], ELLIPSE_NODES)
        if level not in self._ellipses:
            bounds, theta = self.bound(nodes, level), self.schedule.theta(nodes)
            self._ellipses[level] = ellipse_factors(self.family, theta, bounds, level)
        grid = RegularGridInterpolator((nodes, nodes), self._ellipses[level])
        return np.asarray(grid(np.clip(x, nodes[0], nodes[-1])), dtype=np.float64)

    @cached_property
    def _nodes(self) -> Array:
        return np.linspace(self.schedule.knots[0], self.schedule.knots[-1], BOUND_NODES)

    @cached_property
    def _bounds(self) -> dict[float, Array]:
        return {}

    @cached_property
    def _ellipses(self) -> dict[float, Array]:
        return {}

    @cached_property
    def _informations(self) -> dict[float | None, Array]:
        return {}

    def _information(self, confidence: float | None) -> Array:
        # substitution z = e^s; the interval below 1e-6 px carries nothing
        s = np.linspace(np.log(1e-6), np.log(1e5), 1500)
        if confidence is not None:
            last = np.log(self.bound(self._nodes, confidence))
            s = s[0] + (np.minimum(last, s[-1]) - s[0]) * np.linspace(0, 1, 1500)[:, None]
        z, theta = np.exp(s).reshape(1500, -1), self.schedule.theta(self._nodes)[:, None, :]
        integrand = self.family.gradient(z, theta)[0] ** 2 * self.family.pdf(z, theta) * z
        return np.asarray(2 * trapezoid(integrand, s.reshape(1500, -1), axis=0), dtype=np.float64)
