"""Compiled: the shadow map, heights towards the sun, and its look-up."""

# mypy: disable-error-code=no-untyped-def

import math

import numpy as np

from flowlik.simulation.render._compile import kernel
from flowlik.simulation.render._raster._corners import STEP, corner_in_space
from flowlik.simulation.render._raster.packed import OUTLINE


@kernel
def cast_shadows(first, last, shapes, drawn, spheres, R_s_n, origin, rate, heights):
    """Write rows first to last of a shadow map: the greatest height towards the sun over each texel.

    Parameters
    ----------
    drawn : Drawn
        Copies that cast shadows; their leaves are drawn as rhombi.
    spheres : array (N, 4)
        Bounding spheres of the copies: centre in {n} [m], radius [m].
    R_s_n : array (3, 3)
        World to sun axes: two across the light, the third towards the sun.
    origin : array (3,)
        Point of {n} at the middle of the map [m].
    rate : float
        Texels a metre.
    heights : array (n, n) float32
        The map.
    """
    n = heights.shape[0]
    heights[first:last] = -np.inf
    for copy in range(len(drawn.prototypes)):
        row = _towards(R_s_n, 1, spheres[copy], origin) * rate + 0.5 * n
        radius = spheres[copy, 3] * rate + 1.0
        if row + radius < first or row - radius > last:
            continue
        p = drawn.prototypes[copy]
        mesh = shapes.triangle_starts[p + 1] - shapes.triangle_starts[p]
        for part in range(drawn.parts[copy]):
            _cast(part, copy, shapes, drawn, R_s_n, origin, rate, heights, first, last)
        for leaf in range(drawn.leaves[copy]):
            for side in range(2):
                part = mesh + leaf * STEP + OUTLINE + side
                _cast(part, copy, shapes, drawn, R_s_n, origin, rate, heights, first, last)


@kernel
def _towards(R, axis, point, origin):
    return (
        R[axis, 0] * (point[0] - origin[0])
        + R[axis, 1] * (point[1] - origin[1])
        + R[axis, 2] * (point[2] - origin[2])
    )


@kernel
def _sun_point(R, p, rate, n):
    return (
        (R[0, 0] * p[0] + R[0, 1] * p[1] + R[0, 2] * p[2]) * rate + 0.5 * n,
        (R[1, 0] * p[0] + R[1, 1] * p[1] + R[1, 2] * p[2]) * rate + 0.5 * n,
        R[2, 0] * p[0] + R[2, 1] * p[1] + R[2, 2] * p[2],
    )


@kernel
def _cast(part, copy, shapes, drawn, R_s_n, origin, rate, heights, first, last):
    n = heights.shape[0]
    x0, y0, h0 = _sun_point(R_s_n, corner_in_space(shapes, drawn, copy, part, 0, origin), rate, n)
    x1, y1, h1 = _sun_point(R_s_n, corner_in_space(shapes, drawn, copy, part, 1, origin), rate, n)
    x2, y2, h2 = _sun_point(R_s_n, corner_in_space(shapes, drawn, copy, part, 2, origin), rate, n)
    u_first, u_last = max(0.0, math.ceil(min(x0, x1, x2))), min(n - 1.0, math.floor(max(x0, x1, x2)))
    v_first, v_last = (
        max(float(first), math.ceil(min(y0, y1, y2))),
        min(last - 1.0, math.floor(max(y0, y1, y2))),
    )
    area = (x1 - x0) * (y2 - y0) - (x2 - x0) * (y1 - y0)
    if u_first > u_last or v_first > v_last or area == 0.0:
        return
    inverse = 1.0 / area
    for v in range(int(v_first), int(v_last) + 1):
        for u in range(int(u_first), int(u_last) + 1):
            b0 = ((x1 - u) * (y2 - v) - (x2 - u) * (y1 - v)) * inverse
            b1 = ((x2 - u) * (y0 - v) - (x0 - u) * (y2 - v)) * inverse
            b2 = 1.0 - b0 - b1
            if b0 >= 0.0 and b1 >= 0.0 and b2 >= 0.0:
                heights[v, u] = max(heights[v, u], np.float32(b0 * h0 + b1 * h1 + b2 * h2))


@kernel
def sunlit(heights, sun, origin, rate, x, y, z, bias):
    """Share 0 to 1 of the sun's light at a point of {n} [m], smoothed over 4 x 4 texels; 1 beyond the map.

    sun: rows towards the sun, and the map's axes (4, 3); bias [m] lifts the point towards the sun.
    """
    n = heights.shape[0]
    a, b, c = x - origin[0], y - origin[1], z - origin[2]
    u = (sun[1, 0] * a + sun[1, 1] * b + sun[1, 2] * c) * rate + 0.5 * n
    v = (sun[2, 0] * a + sun[2, 1] * b + sun[2, 2] * c) * rate + 0.5 * n
    height = sun[3, 0] * a + sun[3, 1] * b + sun[3, 2] * c + bias
    i, j = math.floor(u), math.floor(v)
    if i < 1 or j < 1 or i >= n - 3 or j >= n - 3:
        return 1.0
    s, t = u - i, v - j
    lit = 0.0
    for q in range(-1, 3):
        across = max(0.0, 1.0 - abs(q - t) * 0.5)
        for p in range(-1, 3):
            weight = max(0.0, 1.0 - abs(p - s) * 0.5)
            lit += weight * across if heights[j + q, i + p] <= height else 0.0
    return 0.25 * lit
