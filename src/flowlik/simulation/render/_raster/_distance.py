"""Compiled: the distance from points to the nearest surface."""

# mypy: disable-error-code=no-untyped-def

import math

import numpy as np
from numba import njit


@njit(cache=True, inline="always")
def _dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@njit(cache=True, inline="always")
def _minus(a, b):
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@njit(cache=True, inline="always")
def _to_segment(a, e):
    """Squared distance from the origin to the points a + s e, s within 0 to 1."""
    s = min(1.0, max(0.0, -_dot(a, e) / max(_dot(e, e), 1e-300)))
    x, y, z = a[0] + s * e[0], a[1] + s * e[1], a[2] + s * e[2]
    return x * x + y * y + z * z


@njit(cache=True)
def _to_triangle(a, b, c):
    """Squared distance from the origin to a triangle."""
    e1, e2 = _minus(b, a), _minus(c, a)
    n = (e1[1] * e2[2] - e1[2] * e2[1], e1[2] * e2[0] - e1[0] * e2[2], e1[0] * e2[1] - e1[1] * e2[0])
    nn = _dot(n, n)
    if nn > 0.0:
        # barycentric coordinates of the foot of the perpendicular
        cross = (e2[1] * a[2] - e2[2] * a[1], e2[2] * a[0] - e2[0] * a[2], e2[0] * a[1] - e2[1] * a[0])
        s = _dot(cross, n) / nn
        cross = (a[1] * e1[2] - a[2] * e1[1], a[2] * e1[0] - a[0] * e1[2], a[0] * e1[1] - a[1] * e1[0])
        t = _dot(cross, n) / nn
        if s >= 0.0 and t >= 0.0 and s + t <= 1.0:
            return _dot(a, n) ** 2 / nn
    return min(_to_segment(a, e1), _to_segment(a, e2), _to_segment(b, _minus(c, b)))


@njit(cache=True, nogil=True)
def nearest_surface(first, last, points, shapes, drawn, spheres, most, distances):
    """Write distances (N,) [m], at most `most`, of points first to last (N, 3) in {n} to the nearest surface.

    A leaf counts as a ball around its centre.
    """
    for i in range(first, last):
        best = most
        point = points[i]
        for copy in range(len(drawn.prototypes)):
            gap = math.sqrt(
                (point[0] - spheres[copy, 0]) ** 2
                + (point[1] - spheres[copy, 1]) ** 2
                + (point[2] - spheres[copy, 2]) ** 2
            )
            if gap - spheres[copy, 3] >= best:
                continue
            best = min(best, _to_copy(point, copy, shapes, drawn, best))
        distances[i] = best


@njit(cache=True, inline="always")
def _to_copy(point, copy, shapes, drawn, best):
    p, m = drawn.prototypes[copy], drawn.transforms
    v0 = shapes.vertex_starts[p]
    count = shapes.vertex_starts[p + 1] - v0
    local = np.empty((count, 3))
    for k in range(count):
        a, b, c = shapes.vertices[v0 + k, 0], shapes.vertices[v0 + k, 1], shapes.vertices[v0 + k, 2]
        for r in range(3):
            local[k, r] = m[copy, r, 0] * a + m[copy, r, 1] * b + m[copy, r, 2] * c + m[copy, r, 3] - point[r]
    squared = best * best
    for f in range(shapes.triangle_starts[p], shapes.triangle_starts[p + 1]):
        i, j, k = shapes.triangles[f, 0], shapes.triangles[f, 1], shapes.triangles[f, 2]
        # the squared distance to the box around the triangle is no greater
        gap = 0.0
        for r in range(3):
            low = min(local[i, r], min(local[j, r], local[k, r]))
            high = max(local[i, r], max(local[j, r], local[k, r]))
            beyond = max(0.0, max(low, -high))
            gap += beyond * beyond
        if gap < squared:
            a = (local[i, 0], local[i, 1], local[i, 2])
            b = (local[j, 0], local[j, 1], local[j, 2])
            c = (local[k, 0], local[k, 1], local[k, 2])
            squared = min(squared, _to_triangle(a, b, c))
    nearest = math.sqrt(squared)
    scale = math.sqrt(m[copy, 0, 0] ** 2 + m[copy, 1, 0] ** 2 + m[copy, 2, 0] ** 2)
    for leaf in range(shapes.leaf_starts[p], shapes.leaf_starts[p + 1]):
        gap, half = 0.0, 0.0
        for r in range(3):
            c = m[copy, r, 3] - point[r]
            for q in range(3):
                c += m[copy, r, q] * shapes.leaf_centres[leaf, q]
            gap += c * c
            half += np.float64(shapes.leaf_along[leaf, r]) ** 2
        nearest = min(nearest, max(0.0, math.sqrt(gap) - scale * math.sqrt(half)))
    return nearest
