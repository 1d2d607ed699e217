"""Mixtures of simple families, with stick-breaking weights."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from flowlik.likelihood.families.base import ErrorFamily, weighted_quantile
from flowlik.support.arrays import Array

LEAST_WEIGHT = 1e-300
EM_STEPS = 40


class Mixture(ErrorFamily):
    """Weighted sum of component densities.

    ``theta`` holds the components' parameters in their order, then the stick-breaking weights: the first
    component's share of the whole, the second's of what is left, and so on. Each may take any value in
    (0, 1), so that interpolation between knots stays within bounds.

    Attributes
    ----------
    components : tuple of ErrorFamily
        Each with its own `improve`.
    starts : tuple of tuple of float
        Parameters, lengths in median magnitudes, from which `start` climbs.
    """

    components: ClassVar[tuple[ErrorFamily, ...]]
    starts: ClassVar[tuple[tuple[float, ...], ...]]

    def _split(self, theta: Array) -> tuple[list[Array], Array]:
        """Parameters of each component, and the stick-breaking weights."""
        ends = np.cumsum([len(c.parameters) for c in self.components])
        *parts, sticks = np.split(theta, ends)
        return parts, sticks

    @staticmethod
    def _log_weights(sticks: Array) -> list[Array]:
        """Logarithm of every component's weight."""
        kept = np.log(np.maximum(sticks, LEAST_WEIGHT))
        left = np.cumsum(np.log(np.maximum(1 - sticks, LEAST_WEIGHT)), axis=0)
        return [kept[0], *(left[:-1] + kept[1:]), left[-1]]

    def _total(self, logs: list[Array], sticks: Array) -> tuple[Array, list[Array]]:
        """Log-density of the mixture, and the components' shares of it, of the components' log-densities."""
        logs = [log + weight for log, weight in zip(logs, self._log_weights(sticks))]
        top = logs[0]
        for log in logs[1:]:
            top = np.maximum(top, log)
        shares = [np.exp(log - top) for log in logs]
        total = sum(shares[1:], shares[0])
        over = 1 / total
        return top + np.log(total), [share * over for share in shares]

    def logpdf(self, z: ArrayLike, theta: Array) -> Array:
        """Log-density [nat] at z [px]."""
        parts, sticks = self._split(theta)
        return self._total([c.logpdf(z, part) for c, part in zip(self.components, parts)], sticks)[0]

    def gradient(self, z: ArrayLike, theta: Array) -> tuple[Array, Array]:
        """Derivatives of `logpdf` by z and by the parameters."""
        parts, sticks = self._split(theta)
        logs = [c.logpdf(z, part) for c, part in zip(self.components, parts)]
        _, shares = self._total(logs, sticks)
        gradients = [c.gradient(z, part) for c, part in zip(self.components, parts)]
        by_z = sum(share * by_z for share, (by_z, _) in zip(shares, gradients))
        return np.asarray(by_z), self._by_theta(shares, [g for _, g in gradients], sticks)

    def logpdf_and_gradient(self, z: ArrayLike, theta: Array) -> tuple[Array, Array]:
        """Log-density [nat] and its derivatives by the parameters."""
        parts, sticks = self._split(theta)
        both = [c.logpdf_and_gradient(z, part) for c, part in zip(self.components, parts)]
        total, shares = self._total([log for log, _ in both], sticks)
        return total, self._by_theta(shares, [g for _, g in both], sticks)

    def _by_theta(self, shares: list[Array], gradients: list[Array], sticks: Array) -> Array:
        out = np.empty((len(self.parameters), *shares[0].shape))
        row = 0
        for share, gradient in zip(shares, gradients):
            np.multiply(share, gradient, out=out[row : row + len(gradient)])
            row += len(gradient)
        left = shares[-1]
        for j in reversed(range(len(sticks))):
            kept, rest = np.maximum(sticks[j], LEAST_WEIGHT), np.maximum(1 - sticks[j], LEAST_WEIGHT)
            out[row + j] = shares[j] * (1 / kept) - left * (1 / rest)
            left = left + shares[j]
        return out

    def magnitude_cdf(self, magnitude: ArrayLike, theta: Array) -> Array:
        """Probability that abs(z) is at most ``magnitude`` [px]."""
        parts, sticks = self._split(theta)
        cdf = self.components[-1].magnitude_cdf(magnitude, parts[-1])
        for component, part, stick in zip(self.components[-2::-1], parts[-2::-1], sticks[::-1]):
            cdf = stick * component.magnitude_cdf(magnitude, part) + (1 - stick) * cdf
        return cdf

    def sample_magnitude(self, theta: Array, size: int | tuple[int, ...], rng: np.random.Generator) -> Array:
        """Random abs(z) [px]."""
        parts, sticks = self._split(theta)
        magnitude = self.components[-1].sample_magnitude(parts[-1], size, rng)
        for component, part, stick in zip(self.components[-2::-1], parts[-2::-1], sticks[::-1]):
            drawn = component.sample_magnitude(part, size, rng)
            magnitude = np.where(rng.random(size=size) < stick, drawn, magnitude)
        return magnitude

    def start(self, magnitude: Array, count: Array) -> Array:
        """Likeliest parameters (P,) after expectation maximisation from each of `starts`."""
        median = max(weighted_quantile(magnitude, count, 0.5), 1e-3)
        lengths = np.array([median if p.unit == "px" else 1.0 for p in self.parameters])
        climbed = [self._climb(magnitude, count, lengths * start) for start in self.starts]
        return max(climbed, key=lambda theta: float(count @ self.logpdf(magnitude, theta)))

    def _climb(self, magnitude: Array, count: Array, theta: Array) -> Array:
        for _ in range(EM_STEPS):
            parts, sticks = self._split(theta)
            logs = [c.logpdf(magnitude, part) for c, part in zip(self.components, parts)]
            # a component that holds nothing would have no average
            held = [count * np.maximum(share, 1e-12) for share in self._total(logs, sticks)[1]]
            parts = [c.improve(magnitude, h, part) for c, h, part in zip(self.components, held, parts)]
            mass = np.array([h.sum() for h in held])
            sticks = mass[:-1] / np.cumsum(mass[::-1])[:0:-1]
            theta = np.concatenate([*parts, np.clip(sticks, 0.02, 0.98)])
        return theta
