"""The ErrorFamily protocol: symmetric error densities whose parameters may be arrays."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import expit, logit

from flowlik.support.arrays import Array

# errors below this are beneath what an 8-bit camera can mean; it keeps cusps and poles finite
MAGNITUDE_FLOOR_PX = 1e-4


@dataclass(frozen=True)
class Link:
    """Smooth map of an optimiser's free variable to a bounded parameter, with its derivative."""

    inverse: Callable[[Array], Array]
    forward: Callable[[Array], Array]
    derivative: Callable[[Array], Array]


LOG = Link(np.exp, np.log, np.exp)
LOGIT = Link(expit, logit, lambda u: expit(u) * expit(-u))


def log_between(lower: float, upper: float) -> Link:
    """Link of a positive parameter to its bounds: the logit of its logarithm's place between theirs."""
    span = np.log(upper / lower)

    def inverse(u: Array) -> Array:
        return lower * np.exp(span * expit(u))

    return Link(
        inverse,
        lambda v: logit(np.log(v / lower) / span),
        lambda u: inverse(u) * span * expit(u) * expit(-u),
    )


@dataclass(frozen=True)
class Parameter:
    """One parameter of a family: name, unit, open bounds, and the link that keeps to them."""

    name: str
    unit: str
    lower: float
    upper: float
    link: Link


class ErrorFamily(ABC):
    """Density of a signed error z [px], symmetric about 0 and normalised over the real line.

    ``theta`` stacks the parameters along its first axis: shape (P,) or (P, ...), broadcast against z.
    A family says `parameters`, `logpdf`, `gradient`, `magnitude_cdf`, `sample_magnitude` and `start`.
    """

    name: ClassVar[str]
    parameters: ClassVar[tuple[Parameter, ...]]

    @abstractmethod
    def logpdf(self, z: ArrayLike, theta: Array) -> Array:
        """Log-density [nat] at z [px]."""

    @abstractmethod
    def gradient(self, z: ArrayLike, theta: Array) -> tuple[Array, Array]:
        """Derivatives of `logpdf`: by z, shape (...), and by the parameters, shape (P, ...)."""

    @abstractmethod
    def magnitude_cdf(self, magnitude: ArrayLike, theta: Array) -> Array:
        """Probability that abs(z) is at most ``magnitude`` [px]."""

    @abstractmethod
    def sample_magnitude(self, theta: Array, size: int | tuple[int, ...], rng: np.random.Generator) -> Array:
        """Random abs(z) [px]."""

    @abstractmethod
    def start(self, magnitude: Array, count: Array) -> Array:
        """Rough parameters (P,) of weighted magnitudes [px], from which a fit begins."""

    def logpdf_and_gradient(self, z: ArrayLike, theta: Array) -> tuple[Array, Array]:
        """`logpdf` and its derivatives (P, ...) by the parameters, which is what a fit needs."""
        return self.logpdf(z, theta), self.gradient(z, theta)[1]

    def improve(self, magnitude: Array, count: Array, theta: Array) -> Array:
        """Parameters (P,) a step nearer the likeliest of weighted magnitudes; `start` unless a family says.

        A mixture calls it on its components while it maximises the expectation.
        """
        return self.start(magnitude, count)

    def pdf(self, z: ArrayLike, theta: Array) -> Array:
        """Density [1/px] at z [px]."""
        return np.exp(self.logpdf(z, theta))

    def cdf(self, z: ArrayLike, theta: Array) -> Array:
        """Distribution function at z [px]."""
        z = np.asarray(z, dtype=np.float64)
        return 0.5 + 0.5 * np.sign(z) * self.magnitude_cdf(np.abs(z), theta)

    def ppf(self, p: ArrayLike, theta: Array) -> Array:
        """Quantile [px] of the signed error at probability p."""
        p = np.asarray(p, dtype=np.float64)
        return np.sign(p - 0.5) * self.magnitude_ppf(np.abs(2 * p - 1), theta)

    def magnitude_ppf(self, confidence: ArrayLike, theta: Array) -> Array:
        """Half-width b [px] of the central region: P(abs(z) <= b) = confidence; by bisection in ln b."""
        confidence = np.asarray(confidence, dtype=np.float64)
        shape = np.broadcast_shapes(confidence.shape, np.shape(theta)[1:])
        low, high = np.full(shape, -40.0), np.full(shape, 40.0)
        for _ in range(64):
            middle = 0.5 * (low + high)
            below = self.magnitude_cdf(np.exp(middle), theta) < confidence
            low, high = np.where(below, middle, low), np.where(below, high, middle)
        return np.where(confidence > 0, np.exp(high), 0.0)

    def rvs(self, theta: Array, size: int | tuple[int, ...], rng: np.random.Generator) -> Array:
        """Random signed errors [px]."""
        magnitude = self.sample_magnitude(theta, size, rng)
        return magnitude * rng.choice((-1.0, 1.0), size=magnitude.shape)

    def to_theta(self, free: Array) -> Array:
        """Parameters (P, ...) of the optimiser's free variables (P, ...)."""
        return np.stack([p.link.inverse(u) for p, u in zip(self.parameters, free)])

    def to_free(self, theta: Array) -> Array:
        """Free variables (P, ...) of parameters (P, ...)."""
        return np.stack([p.link.forward(v) for p, v in zip(self.parameters, theta)])

    def link_derivative(self, free: Array) -> Array:
        """Derivative (P, ...) of each parameter by its own free variable."""
        return np.stack([p.link.derivative(u) for p, u in zip(self.parameters, free)])


def weighted_quantile(magnitude: Array, count: Array, q: float) -> float:
    """Quantile of sorted magnitudes with counts."""
    cumulated = np.cumsum(count)
    return float(magnitude[min(np.searchsorted(cumulated, q * cumulated[-1]), len(magnitude) - 1)])
