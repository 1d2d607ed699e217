"""Tables of a likelihood over (x, abs(z)) and the kernels that read them; no family is known here.

The axis of abs(z) is the bit pattern of a float32: 16 linear steps an octave, from 2^-14 to 2^10 px, so
that a look-up needs no logarithm.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from flowlik.support.arrays import Array

STEPS_PER_OCTAVE = 16
SHIFT = 19  # 23 mantissa bits less the 4 that number the steps
FIRST_BITS = (127 - 14) << 23
OCTAVES = 24
Z_NODES = OCTAVES * STEPS_PER_OCTAVE + 1
X_NODES = 257


class LikelihoodTables(NamedTuple):
    """Log-density and weight at nodes of x (rows) and abs(z) (columns)."""

    first_x: float
    step_x: float
    log_prob: NDArray[np.float32]
    weight: NDArray[np.float32]

    def rows(self, x: Array) -> Array:
        """Fractional row of each coordinate x, clamped to the table."""
        return np.clip((x - self.first_x) / self.step_x, 0.0, len(self.log_prob) - 1.0)

    @property
    def x(self) -> Array:
        """Coordinate of each row."""
        return self.first_x + self.step_x * np.arange(len(self.log_prob), dtype=np.float64)

    def times(self, factor: NDArray[np.float32]) -> LikelihoodTables:
        """Tables whose rows are multiplied by factors (X, 1)."""
        return self._replace(log_prob=factor * self.log_prob, weight=factor * self.weight)


def magnitude_nodes() -> Array:
    """Nodes of abs(z) [px] of the tables, and edges of the error bins of sketches."""
    bits = FIRST_BITS + (np.arange(Z_NODES, dtype=np.int32) << SHIFT)
    return bits.view(np.float32).astype(np.float64)


def compile_tables(
    log_prob: Callable[[Array, Array], Array], weight: Callable[[Array, Array], Array], knots: Array
) -> LikelihoodTables:
    """Tabulate ``log_prob(z, x)`` and ``weight(z, x)`` between the outer knots."""
    x = np.linspace(knots[0], knots[-1], X_NODES)
    z, grid = magnitude_nodes()[None, :], x[:, None]
    return LikelihoodTables(
        float(x[0]),
        float(x[1] - x[0]),
        log_prob(z, grid).astype(np.float32),
        weight(z, grid).astype(np.float32),
    )


@njit(cache=True, nogil=True)
def interpolate(x, first, step, values):  # type: ignore[no-untyped-def]
    """Linear interpolation at x (C,) of values at evenly spaced nodes, clamped to the outer ones."""
    out = np.empty(len(x))
    for c in range(len(x)):
        position = min(max((x[c] - first) / step, 0.0), len(values) - 1.0)
        i = min(int(position), len(values) - 2)
        out[c] = values[i] + (position - i) * (values[i + 1] - values[i])
    return out


@njit(cache=True, inline="always")
def magnitude_position(magnitude):  # type: ignore[no-untyped-def]
    """Bin of abs(z) and the fraction within it; clamped to the outer bins."""
    bits = np.float32(magnitude).view(np.int32) - FIRST_BITS
    if bits < 0:
        return 0, 0.0
    column = bits >> SHIFT
    if column >= Z_NODES - 1:
        return Z_NODES - 2, 1.0
    return column, (bits & ((1 << SHIFT) - 1)) / float(1 << SHIFT)


@njit(cache=True, inline="always")
def bilinear(table, i, a, j, f):  # type: ignore[no-untyped-def]
    """Value at fractions a of row i and f of column j."""
    below = table[i, j] + f * (table[i, j + 1] - table[i, j])
    above = table[i + 1, j] + f * (table[i + 1, j + 1] - table[i + 1, j])
    return below + a * (above - below)


@njit(cache=True, nogil=True)
def look_up(table, rows, z):  # type: ignore[no-untyped-def]
    """Values (C,) of a table at fractional rows (C,) and errors z (C,) [px]."""
    out, last_row = np.empty(len(z)), table.shape[0] - 2
    for c in range(len(z)):
        i, (j, f) = min(int(rows[c]), last_row), magnitude_position(abs(z[c]))
        out[c] = bilinear(table, i, rows[c] - i, j, f)
    return out


@njit(cache=True, nogil=True)
def normal_equations(z, J, rows, fisher, used, log_prob, weight):  # type: ignore[no-untyped-def]
    """Fisher scoring of components: H = sum fisher J^T J, b = -sum w z J, and the sum of log_prob.

    b is the gradient of the log-likelihood, since w = -score / z. z, rows, fisher, used are (C,), J is
    (C, 6); components with ``used`` 0 are left out.
    """
    H, b, total = np.zeros((6, 6)), np.zeros(6), 0.0
    last_row = log_prob.shape[0] - 2
    for c in range(len(z)):
        if used[c] == 0:
            continue
        i, (j, f) = min(int(rows[c]), last_row), magnitude_position(abs(z[c]))
        a = rows[c] - i
        total += bilinear(log_prob, i, a, j, f)
        wz = bilinear(weight, i, a, j, f) * z[c]
        for i in range(6):
            b[i] -= wz * J[c, i]
            fj = fisher[c] * J[c, i]
            for j in range(i, 6):
                H[i, j] += fj * J[c, j]
    for i in range(6):
        for j in range(i):
            H[i, j] = H[j, i]
    return H, b, total
