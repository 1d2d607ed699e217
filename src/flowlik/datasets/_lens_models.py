"""How lenses bend light: where a point on the plane z = 1 is seen, and how far that holds."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar, Protocol

import numpy as np

from flowlik.errors import DataError
from flowlik.support.arrays import Array

MOST = 1e6
"""A larger coefficient is taken for damage."""

NODES = 2000
WIDEST = np.deg2rad(89.9)
NEWTON_STEPS = 8
TOLERANCE = 1e-9


class LensModel(Protocol):
    """A lens of focal length 1 with its principal point at (0, 0).

    Attributes
    ----------
    bends : bool
        Whether it differs from a pinhole camera.
    magnification : float
        How much larger it shows what is on its axis than a pinhole camera of the same focal length does.
    limit : float
        Distance from the axis of true points from which on the model shows nothing new, since the radius seen
        turns back, or nothing is seen. Infinite where that never happens.
    """

    @property
    def bends(self) -> bool: ...

    @property
    def magnification(self) -> float: ...

    @property
    def limit(self) -> float: ...

    def radius(self, r: Array) -> Array:
        """Distance (N,) from the axis at which true points at distance r (N,) are seen, by symmetry."""
        ...

    def seen(self, points: Array) -> Array:
        """Where true points (N, 2) on the plane z = 1 are seen (N, 2)."""
        ...


@dataclass(frozen=True)
class BrownConrady:
    """Perspective lens of Brown and Conrady in OpenCV's form.

    Parameters
    ----------
    coefficients : tuple of float
        k1 k2 p1 p2 [k3 [k4 k5 k6 [s1 s2 s3 s4 [tx ty]]]], OpenCV's order; none is a pinhole camera.

    Raises
    ------
    DataError
        If there are not 0, 4, 5, 8, 12 or 14 finite coefficients.
    """

    coefficients: tuple[float, ...] = ()
    counts: ClassVar = (0, 4, 5, 8, 12, 14)
    magnification: ClassVar = 1.0

    def __post_init__(self) -> None:
        _check(self.coefficients, self.counts)

    @property
    def bends(self) -> bool:
        """Whether a coefficient is not zero."""
        return any(self.coefficients)

    @cached_property
    def limit(self) -> float:
        """Radius of true points at which the radius seen stops growing."""
        above, below = self._radial
        # slope of r N(q) / D(q), q = r^2: its numerator, (N + 2 q N') D - 2 q N D'
        q = np.poly1d([1.0, 0.0])
        slope = (above + 2 * q * above.deriv()) * below - 2 * q * above * below.deriv()
        return float(np.sqrt(min(_first_root(slope), _first_root(below))))

    def radius(self, r: Array) -> Array:
        """Radius seen, without tangential, prism and tilt terms."""
        above, below = self._radial
        return np.asarray(r * above(r**2) / below(r**2))

    def seen(self, points: Array) -> Array:
        """Where true points (N, 2) are seen (N, 2)."""
        terms = (*self.coefficients, *(0.0,) * 14)[:14]
        p1, p2, (s1, s2, s3, s4), (tilt_x, tilt_y) = terms[2], terms[3], terms[8:12], terms[12:]
        above, below = self._radial
        x, y = np.asarray(points, dtype=np.float64).T
        q = x * x + y * y
        ratio, xy = above(q) / below(q), 2 * x * y
        u = x * ratio + p1 * xy + p2 * (q + 2 * x * x) + q * (s1 + s2 * q)
        v = y * ratio + p2 * xy + p1 * (q + 2 * y * y) + q * (s3 + s4 * q)
        if not (tilt_x or tilt_y):
            return np.stack([u, v], axis=1)
        homogeneous = np.stack([u, v, np.ones_like(u)], axis=1) @ _tilt(tilt_x, tilt_y).T
        return np.asarray(homogeneous[:, :2] / homogeneous[:, 2:])

    @property
    def _radial(self) -> tuple[np.poly1d, np.poly1d]:
        k1, k2, _, _, k3, k4, k5, k6 = (*self.coefficients, *(0.0,) * 8)[:8]
        return np.poly1d([k3, k2, k1, 1.0]), np.poly1d([k6, k5, k4, 1.0])


@dataclass(frozen=True)
class KannalaBrandt:
    """Equidistant fisheye: a ray at the angle a to the axis is seen at a (1 + k1 a^2 + … + k4 a^8).

    Kannala and Brandt 2006; OpenCV's ``fisheye``, Kalibr's ``equi``.

    Parameters
    ----------
    coefficients : tuple of float
        k1 k2 k3 k4.

    Raises
    ------
    DataError
        If there are not four finite coefficients.
    """

    coefficients: tuple[float, ...]
    counts: ClassVar = (4,)
    bends: ClassVar = True
    magnification: ClassVar = 1.0

    def __post_init__(self) -> None:
        _check(self.coefficients, self.counts)

    @cached_property
    def limit(self) -> float:
        """Distance of true points at the angle where the radius seen stops growing."""
        angle = np.sqrt(_first_root(np.poly1d([(2 * i + 1) * k for i, k in self._powers])))
        return float(np.tan(angle)) if angle < np.pi / 2 else np.inf

    def radius(self, r: Array) -> Array:
        """Radius seen of true points at distance r from the axis."""
        angle = np.arctan(r)
        return np.asarray(angle * np.poly1d([k for _, k in self._powers])(angle**2))

    def seen(self, points: Array) -> Array:
        """Where true points (N, 2) are seen (N, 2)."""
        return _radially(points, self)

    @property
    def _powers(self) -> list[tuple[int, float]]:
        """Powers of the squared angle and their factors, the highest first."""
        return list(enumerate((1.0, *self.coefficients)))[::-1]


@dataclass(frozen=True)
class DoubleSphere:
    """Double sphere model (Usenko, Demmel, Cremers 2018, Eq. 40 to 42), Kalibr's and Basalt's ``ds``.

    Parameters
    ----------
    xi : float
        Distance of the spheres' centres.
    alpha : float
        Shift of the pinhole, in [0, 1].

    Raises
    ------
    DataError
        If xi is not above -1, or alpha not in [0, 1].
    """

    xi: float
    alpha: float

    def __post_init__(self) -> None:
        if not (-1 < self.xi < MOST and 0 <= self.alpha <= 1):
            found = f"double sphere with xi {self.xi:g} and alpha {self.alpha:g}"
            raise DataError(f"{found}: xi must be above -1, alpha in [0, 1]")

    @property
    def bends(self) -> bool:
        """Whether it is not a pinhole camera."""
        return bool(self.xi or self.alpha)

    @property
    def magnification(self) -> float:
        """Magnification on the axis, 1 / (1 + xi)."""
        return 1 / (1 + self.xi)

    @cached_property
    def limit(self) -> float:
        """Distance of true points at which the radius seen is infinite (alpha < 1/2) or turns back."""
        # both where the ray's height over the second sphere's centre is -w of its distance from there
        w = min(self.alpha / (1 - self.alpha), (1 - self.alpha) / self.alpha) if 0 < self.alpha < 1 else 0.0
        rest = 1 - w**2
        cosine = -self.xi * rest - w * np.sqrt(max(1 - self.xi**2 * rest, 0.0))
        return float(np.sqrt(1 / cosine**2 - 1)) if cosine > 0 else np.inf

    def radius(self, r: Array) -> Array:
        """Radius seen of true points at distance r from the axis."""
        shifted = self.xi * np.sqrt(r**2 + 1) + 1
        return np.asarray(r / (self.alpha * np.sqrt(r**2 + shifted**2) + (1 - self.alpha) * shifted))

    def seen(self, points: Array) -> Array:
        """Where true points (N, 2) are seen (N, 2)."""
        return _radially(points, self)


def true_points(model: LensModel, seen: Array) -> Array:
    """True points (N, 2) on the plane z = 1 that a lens shows at ``seen`` (N, 2); NaN where it shows none.

    The radius is found in a table, then both coordinates by Newton's method, to 1e-9.
    """
    seen = np.asarray(seen, dtype=np.float64)
    if not model.bends:
        return seen.copy()
    with np.errstate(all="ignore"):
        r = np.tan(np.linspace(0, min(WIDEST, np.arctan(model.limit)), NODES))[:-1]
        rising = np.maximum.accumulate(model.radius(r))
        at = np.linalg.norm(seen, axis=1)
        start = np.interp(at, rising, r, right=np.nan)
        points = seen * (start / np.where(at > 0, at, 1))[:, None]
        for _ in range(NEWTON_STEPS):
            step = 1e-6 * (1 + np.linalg.norm(points, axis=1))[:, None]
            ends = [(model.seen(points + step * e), model.seen(points - step * e)) for e in np.eye(2)]
            (a, c), (b, d) = (((after - before) / (2 * step)).T for after, before in ends)
            u, v = (model.seen(points) - seen).T
            change = np.column_stack([d * u - b * v, a * v - c * u]) / (a * d - b * c)[:, None]
            points = points - change
            if not np.nanmax(np.abs(change), initial=0.0) > 1e-12:
                break
        right = np.linalg.norm(model.seen(points) - seen, axis=1) < TOLERANCE * (1 + at)
        right &= np.linalg.norm(points, axis=1) < model.limit
    return np.where(right[:, None], points, np.nan)


def _tilt(x: float, y: float) -> Array:
    """Matrix (3, 3) of a sensor turned about its axes by x, then y [rad], as OpenCV defines it."""
    about_x = np.array([[1, 0, 0], [0, np.cos(x), np.sin(x)], [0, -np.sin(x), np.cos(x)]])
    R = np.array([[np.cos(y), 0, -np.sin(y)], [0, 1, 0], [np.sin(y), 0, np.cos(y)]]) @ about_x
    return np.array([[R[2, 2], 0, -R[0, 2]], [0, R[2, 2], -R[1, 2]], [0, 0, 1]]) @ R


def _radially(points: Array, model: LensModel) -> Array:
    """Points moved along their radius."""
    r = np.linalg.norm(points, axis=1)
    ratio = np.divide(model.radius(r), r, out=np.full_like(r, model.magnification), where=r > 1e-9)
    return np.asarray(points * ratio[:, None])


def _first_root(polynomial: np.poly1d) -> float:
    """Smallest positive real root, or infinity."""
    roots = polynomial.roots
    real = roots.real[(np.abs(roots.imag) < 1e-9 * (1 + np.abs(roots.real))) & (roots.real > 0)]
    return float(real.min()) if len(real) else np.inf


def _check(coefficients: tuple[float, ...], counts: tuple[int, ...]) -> None:
    if len(coefficients) not in counts:
        expected = ", ".join(map(str, counts))
        raise DataError(f"{len(coefficients)} distortion coefficients, expected {expected}")
    if not (np.abs(coefficients) < MOST).all():
        raise DataError("a distortion coefficient is not a finite number of possible size")
