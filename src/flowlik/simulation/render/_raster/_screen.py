"""Compiled: triangles of copies projected onto the screen."""

# mypy: disable-error-code=no-untyped-def

import numpy as np

from flowlik.simulation.render._compile import inlined, kernel
from flowlik.simulation.render._raster._corners import STEP
from flowlik.simulation.render._raster.packed import OUTLINE

_NEAR_M = 0.02


@kernel
def _emit(screen, owner, count, copy, part, x0, y0, w0, x1, y1, w1, x2, y2, w2, width, height):
    """Store a triangle of screen points (px, px, 1/m) if it may cover a pixel of the picture."""
    if max(x0, max(x1, x2)) < -0.5 or min(x0, min(x1, x2)) > width - 0.5:
        return count
    if max(y0, max(y1, y2)) < -0.5 or min(y0, min(y1, y2)) > height - 0.5:
        return count
    row = screen[count]
    row[0], row[1], row[2] = x0, y0, w0
    row[3], row[4], row[5] = x1, y1, w1
    row[6], row[7], row[8] = x2, y2, w2
    owner[count, 0], owner[count, 1] = copy, part
    return count + 1


@kernel
def _add(screen, owner, count, copy, part, corners, fx, fy, cx, cy, width, height, cut):
    """Project a triangle of camera points (3, 3), cut at the near plane; `cut` is scratch (4, 3)."""
    kept = 0
    for e in range(3):
        a, b = corners[e], corners[(e + 1) % 3]
        a_in, b_in = a[2] > _NEAR_M, b[2] > _NEAR_M
        if a_in:
            w = 1.0 / a[2]
            cut[kept, 0], cut[kept, 1], cut[kept, 2] = a[0] * w * fx + cx, a[1] * w * fy + cy, w
            kept += 1
        if a_in != b_in:
            f = (_NEAR_M - a[2]) / (b[2] - a[2])
            w = 1.0 / _NEAR_M
            cut[kept, 0] = (a[0] + f * (b[0] - a[0])) * w * fx + cx
            cut[kept, 1] = (a[1] + f * (b[1] - a[1])) * w * fy + cy
            cut[kept, 2] = w
            kept += 1
    for e in range(1, kept - 1):
        f = e + 1
        count = _emit(
            screen, owner, count, copy, part,
            cut[0, 0], cut[0, 1], cut[0, 2], cut[e, 0], cut[e, 1], cut[e, 2], cut[f, 0], cut[f, 1], cut[f, 2],
            width, height,
        )  # fmt: skip
    return count


@kernel
def to_screen(
    first, last, shapes, drawn, R_c_n, origin, camera, width, height, points, scratch, screen, owner
):
    """Project the triangles of copies first to last; return how many were stored.

    Parameters
    ----------
    first, last : int
        Copies of `drawn`.
    R_c_n, origin : arrays (3, 3), (3,)
        World to camera rotation; the camera's position in {n} [m].
    camera : array (4,)
        fx, fy, cx, cy [px].
    points, scratch : arrays (most points of a copy or OUTLINE, 5), (10, 4)
        Written on.
    screen : array (K, 9) float32
        Written: column, row [px] and inverse depth [1/m] of each corner.
    owner : array (K, 2) int32
        Written: copy and part of each triangle, as `_corners.corner_in_space` takes them.
    """
    fx, fy, cx, cy = camera
    count = 0
    q, corners, cut = scratch[:3], scratch[3:6, :3], scratch[6:, :3]
    for copy in range(first, last):
        p, m = drawn.prototypes[copy], drawn.transforms[copy]
        for r in range(3):
            for c in range(3):
                q[r, c] = R_c_n[r, 0] * m[0, c] + R_c_n[r, 1] * m[1, c] + R_c_n[r, 2] * m[2, c]
            q[r, 3] = (
                R_c_n[r, 0] * (m[0, 3] - origin[0])
                + R_c_n[r, 1] * (m[1, 3] - origin[1])
                + R_c_n[r, 2] * (m[2, 3] - origin[2])
            )
        v0 = shapes.vertex_starts[p]
        for k in range(drawn.points[copy]):
            v = shapes.vertices[v0 + k]
            _project(points[k], v[0], v[1], v[2], q, fx, fy, cx, cy)
        f0 = shapes.triangle_starts[p]
        mesh = shapes.triangle_starts[p + 1] - f0
        for k in range(drawn.parts[copy]):
            t = shapes.triangles[f0 + k]
            count = _triangle(
                screen, owner, count, copy, k, points, t, corners, fx, fy, cx, cy, width, height, cut
            )
        shape = shapes.outlines[p]
        l0 = shapes.leaf_starts[p]
        scale = np.sqrt(m[0, 0] ** 2 + m[1, 0] ** 2 + m[2, 0] ** 2)
        for k in range(drawn.leaves[copy]):
            centre, along, across = (
                shapes.leaf_centres[l0 + k],
                shapes.leaf_along[l0 + k],
                shapes.leaf_across[l0 + k],
            )
            # skip leaves that cannot reach the picture before their corners are made
            z = q[2, 0] * centre[0] + q[2, 1] * centre[1] + q[2, 2] * centre[2] + q[2, 3]
            reach = (
                scale
                * 1.5
                * (abs(along[0]) + abs(along[1]) + abs(along[2]))
                * max(1.0, drawn.leaf_scale[copy])
            )
            if z + reach < _NEAR_M:
                continue
            if z - reach > _NEAR_M:
                w, near = 1.0 / z, 1.0 / (z - reach)
                x = (q[0, 0] * centre[0] + q[0, 1] * centre[1] + q[0, 2] * centre[2] + q[0, 3]) * w * fx + cx
                y = (q[1, 0] * centre[0] + q[1, 1] * centre[1] + q[1, 2] * centre[2] + q[1, 3]) * w * fy + cy
                margin = 1.0 + reach * near * (max(fx, fy) + abs(x - cx) + abs(y - cy))
                if x < -margin or y < -margin or x > width + margin or y > height + margin:
                    continue
            if k < drawn.fine[copy]:
                for j in range(shapes.outline_sizes[shape, 0]):
                    s, t, h = shapes.outline_vertices[shape, j]
                    _leaf_point(points[j], s, t, h, centre, along, across, q, fx, fy, cx, cy)
                for j in range(shapes.outline_sizes[shape, 1]):
                    t_ = shapes.outline_triangles[shape, j]
                    part = mesh + k * STEP + j
                    count = _triangle(
                        screen,
                        owner,
                        count,
                        copy,
                        part,
                        points,
                        t_,
                        corners,
                        fx,
                        fy,
                        cx,
                        cy,
                        width,
                        height,
                        cut,
                    )
            else:
                size = drawn.leaf_scale[copy] * shapes.outline_rhombus[shape]
                _leaf_point(points[0], -size, 0.0, 0.0, centre, along, across, q, fx, fy, cx, cy)
                _leaf_point(points[1], size, 0.0, 0.0, centre, along, across, q, fx, fy, cx, cy)
                _leaf_point(points[2], 0.0, size, 0.0, centre, along, across, q, fx, fy, cx, cy)
                _leaf_point(points[3], 0.0, -size, 0.0, centre, along, across, q, fx, fy, cx, cy)
                for j in range(2):
                    part = mesh + k * STEP + OUTLINE + j
                    count = _triangle(
                        screen, owner, count, copy, part, points, (0, 1, 2 + j), corners,
                        fx, fy, cx, cy, width, height, cut,
                    )  # fmt: skip
    return count


@inlined
def _project(point, a, b, c, q, fx, fy, cx, cy):
    """Store camera x, y, z or, where it lies before the near plane, column, row and inverse depth."""
    x = q[0, 0] * a + q[0, 1] * b + q[0, 2] * c + q[0, 3]
    y = q[1, 0] * a + q[1, 1] * b + q[1, 2] * c + q[1, 3]
    z = q[2, 0] * a + q[2, 1] * b + q[2, 2] * c + q[2, 3]
    if z > _NEAR_M:
        w = 1.0 / z
        point[0], point[1], point[2], point[3], point[4] = x * w * fx + cx, y * w * fy + cy, w, 1.0, z
    else:
        point[0], point[1], point[2], point[3], point[4] = x, y, z, 0.0, z


@inlined
def _leaf_point(point, s, t, h, centre, along, across, q, fx, fy, cx, cy):
    a0, a1, a2 = np.float64(along[0]), np.float64(along[1]), np.float64(along[2])
    b0, b1, b2 = np.float64(across[0]), np.float64(across[1]), np.float64(across[2])
    x, y, z = centre[0] + s * a0 + t * b0, centre[1] + s * a1 + t * b1, centre[2] + s * a2 + t * b2
    if h != 0.0:
        n0, n1, n2 = a1 * b2 - a2 * b1, a2 * b0 - a0 * b2, a0 * b1 - a1 * b0
        g = h / np.sqrt(b0 * b0 + b1 * b1 + b2 * b2)
        x, y, z = x + g * n0, y + g * n1, z + g * n2
    _project(point, x, y, z, q, fx, fy, cx, cy)


@kernel
def _triangle(screen, owner, count, copy, part, points, t, corners, fx, fy, cx, cy, width, height, cut):
    a, b, c = points[t[0]], points[t[1]], points[t[2]]
    in_front = a[3] + b[3] + c[3]
    if in_front == 3.0:
        return _emit(
            screen,
            owner,
            count,
            copy,
            part,
            a[0],
            a[1],
            a[2],
            b[0],
            b[1],
            b[2],
            c[0],
            c[1],
            c[2],
            width,
            height,
        )
    if in_front == 0.0:
        return count
    for i in range(3):
        point = points[t[i]]
        if point[3] == 1.0:
            corners[i, 0] = (point[0] - cx) / fx * point[4]
            corners[i, 1] = (point[1] - cy) / fy * point[4]
            corners[i, 2] = point[4]
        else:
            corners[i, 0], corners[i, 1], corners[i, 2] = point[0], point[1], point[2]
    return _add(screen, owner, count, copy, part, corners, fx, fy, cx, cy, width, height, cut)
