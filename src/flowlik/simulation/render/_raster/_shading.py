"""Compiled: the light that a ray brings from sky, leaves and meshes, and the exact depth where it ends."""

# mypy: disable-error-code=no-untyped-def

import math

import numpy as np

from flowlik.simulation.render._compile import inlined
from flowlik.simulation.render._raster._corners import corner_in_space
from flowlik.simulation.render._raster._shadow import sunlit
from flowlik.simulation.render._raster._texturing import look_up, reflectance, slopes

# points are lifted this far towards the sun, so that surfaces do not shade themselves
SOLID_BIAS_M, LEAF_BIAS_M = 0.06, 0.15


@inlined
def _meet(a, e1, e2, d):
    """Where the ray from the origin along d meets the plane a + s e1 + t e2: multiple of d, s, t."""
    px, py, pz = d[1] * e2[2] - d[2] * e2[1], d[2] * e2[0] - d[0] * e2[2], d[0] * e2[1] - d[1] * e2[0]
    det = e1[0] * px + e1[1] * py + e1[2] * pz
    if det == 0.0:
        det = 1e-300
    inverse = 1.0 / det
    s = -(a[0] * px + a[1] * py + a[2] * pz) * inverse
    qx, qy, qz = e1[1] * a[2] - e1[2] * a[1], e1[2] * a[0] - e1[0] * a[2], e1[0] * a[1] - e1[1] * a[0]
    return (e2[0] * qx + e2[1] * qy + e2[2] * qz) * inverse, s, (d[0] * qx + d[1] * qy + d[2] * qz) * inverse


@inlined
def _minus(a, b):
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@inlined
def ray(R_n_c, camera, x, y):
    """Direction in {n} of the ray through pixel position (x, y), of depth 1 along the optical axis."""
    gx, gy = (x - camera[2]) / camera[0], (y - camera[3]) / camera[1]
    return (
        R_n_c[0, 0] * gx + R_n_c[0, 1] * gy + R_n_c[0, 2],
        R_n_c[1, 0] * gx + R_n_c[1, 1] * gy + R_n_c[1, 2],
        R_n_c[2, 0] * gx + R_n_c[2, 1] * gy + R_n_c[2, 2],
    )


@inlined
def _random(a, b):
    """Fraction 0 to 1 that two whole numbers draw."""
    h = (np.uint64(a) * np.uint64(0x9E3779B97F4A7C15)) ^ (np.uint64(b + 1) * np.uint64(0xC2B2AE3D27D4EB4F))
    h ^= h >> np.uint64(29)
    h *= np.uint64(0xBF58476D1CE4E5B9)
    h ^= h >> np.uint64(32)
    return np.float64(h & np.uint64(0xFFFF)) / 65536.0


@inlined
def exact_depth(copy, part, shapes, drawn, origin, R_n_c, camera, x, y):
    """Depth [m] at which the ray through (x, y) meets a triangle's plane."""
    a = corner_in_space(shapes, drawn, copy, part, 0, origin)
    b = corner_in_space(shapes, drawn, copy, part, 1, origin)
    c = corner_in_space(shapes, drawn, copy, part, 2, origin)
    return _meet(a, _minus(b, a), _minus(c, a), ray(R_n_c, camera, x, y))[0]


@inlined
def sky(looks, light, to_sun, d, spread):
    """Radiance of the sky along d; `spread` is the angle of a pixel [rad]. y is down."""
    n = 1.0 / math.sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2])
    x, up, z = d[0] * n, -d[1] * n, d[2] * n
    low = (1.0 - max(up, 0.0)) ** 4
    value = light[4] + (light[3] - light[4]) * low
    if up > 0.02:
        # clouds lie on a plane high above, bent down a little towards the horizon
        far = 1.0 / (up + 0.12)
        size = spread * far
        cloud = look_up(
            looks.pyramids,
            looks.level_offsets,
            looks.cloud_tile,
            0.12,
            x * far,
            z * far,
            size,
            0.0,
            0.0,
            size * far,
        )
        cover = min(1.0, max(0.0, (cloud - 1.0 + light[5]) * 2.0)) * min(1.0, up * 6.0)
        value += (1.05 * light[3] + 0.35 - value) * cover
    glow = max(0.0, x * to_sun[0] - up * to_sun[1] + z * to_sun[2])
    return value + 0.4 * glow**48


@inlined
def _lit(value, normal, depth, x, y, z, translucency, ambient, bias, light, sun, shadows):
    """Radiance of a surface of some reflectance at a point of {n}, from sun, sky and haze."""
    facing = normal[0] * sun[0, 0] + normal[1] * sun[0, 1] + normal[2] * sun[0, 2]
    direct = max(0.0, facing)
    if translucency > 0.0:
        direct = (1.0 - translucency) * direct + translucency * (0.35 + 0.65 * abs(facing))
    if direct > 0.0:
        direct *= sunlit(
            shadows[0], sun, shadows[1], shadows[2],
            x + 0.04 * normal[0], y + 0.04 * normal[1], z + 0.04 * normal[2], bias,
        )  # fmt: skip
    # the sky is above, the ground below sends back a fifth
    radiance = value * (light[0] * direct + light[1] * (0.6 - 0.4 * normal[1]) * ambient)
    clear = math.exp(-light[2] * depth)
    return radiance * clear + light[3] * (1.0 - clear)


@inlined
def _turned(transforms, copy, x, y, z):
    """Unit vector in {n} of a direction in a copy's axes."""
    X = transforms[copy, 0, 0] * x + transforms[copy, 0, 1] * y + transforms[copy, 0, 2] * z
    Y = transforms[copy, 1, 0] * x + transforms[copy, 1, 1] * y + transforms[copy, 1, 2] * z
    Z = transforms[copy, 2, 0] * x + transforms[copy, 2, 1] * y + transforms[copy, 2, 2] * z
    inverse = 1.0 / math.sqrt(X * X + Y * Y + Z * Z + 1e-20)
    return X * inverse, Y * inverse, Z * inverse


@inlined
def leaf_tone(copy, leaf, shapes, drawn, looks, light, sun, shadows, origin, R_n_c):
    """Radiance of a leaf, that of its middle."""
    p, m = drawn.prototypes[copy], drawn.transforms
    a, b, c = shapes.leaf_centres[leaf, 0], shapes.leaf_centres[leaf, 1], shapes.leaf_centres[leaf, 2]
    x = m[copy, 0, 0] * a + m[copy, 0, 1] * b + m[copy, 0, 2] * c + m[copy, 0, 3]
    y = m[copy, 1, 0] * a + m[copy, 1, 1] * b + m[copy, 1, 2] * c + m[copy, 1, 3]
    z = m[copy, 2, 0] * a + m[copy, 2, 1] * b + m[copy, 2, 2] * c + m[copy, 2, 3]
    depth = max(
        R_n_c[0, 2] * (x - origin[0]) + R_n_c[1, 2] * (y - origin[1]) + R_n_c[2, 2] * (z - origin[2]), 0.0
    )
    normal = _turned(
        m, copy, shapes.leaf_normals[leaf, 0], shapes.leaf_normals[leaf, 1], shapes.leaf_normals[leaf, 2]
    )
    material = shapes.leaf_materials[p]
    value = looks.reflectance[looks.first_surface[material]]
    value *= 1.0 + looks.leafy[material, 1] * (2.0 * _random(drawn.identities[copy], leaf) - 1.0)
    return _lit(
        value, normal, depth, x, y, z, looks.leafy[material, 0], shapes.leaf_shade[leaf], LEAF_BIAS_M,
        light, sun, shadows,
    )  # fmt: skip


@inlined
def leaf_spot(copy, part, mesh, x, y, shapes, drawn, looks, origin, R_n_c, camera):
    """Factor of a leaf's own texture, as seen from near by through pixel position (x, y)."""
    surface = looks.first_surface[shapes.leaf_materials[drawn.prototypes[copy]]]
    a = corner_in_space(shapes, drawn, copy, part, 0, origin)
    e1 = _minus(corner_in_space(shapes, drawn, copy, part, 1, origin), a)
    e2 = _minus(corner_in_space(shapes, drawn, copy, part, 2, origin), a)
    depth, s, t = _meet(a, e1, e2, ray(R_n_c, camera, x, y))
    size_1 = math.sqrt(e1[0] * e1[0] + e1[1] * e1[1] + e1[2] * e1[2])
    size_2 = math.sqrt(e2[0] * e2[0] + e2[1] * e2[1] + e2[2] * e2[2])
    u, v = min(max(s, 0.0), 1.0) * size_1 + 0.031 * (part - mesh), min(max(t, 0.0), 1.0) * size_2
    step = depth / camera[0]
    return reflectance(looks, surface, u, v, step, 0.0, 0.0, step) / looks.reflectance[surface]


@inlined
def shade_mesh(copy, part, x, y, shapes, drawn, looks, light, sun, shadows, origin, R_n_c, camera):
    """Radiance of a mesh's triangle, seen through pixel position (x, y)."""
    p, m = drawn.prototypes[copy], drawn.transforms
    a = corner_in_space(shapes, drawn, copy, part, 0, origin)
    e1 = _minus(corner_in_space(shapes, drawn, copy, part, 1, origin), a)
    e2 = _minus(corner_in_space(shapes, drawn, copy, part, 2, origin), a)
    d = ray(R_n_c, camera, x, y)
    depth, s, t = _meet(a, e1, e2, d)
    # a sample's middle may lie a little beside the triangle
    s = min(1.0, max(0.0, s))
    t = min(1.0 - s, max(0.0, t))
    r = 1.0 - s - t
    f, v0 = shapes.triangle_starts[p] + part, shapes.vertex_starts[p]
    i0, i1, i2 = v0 + shapes.triangles[f, 0], v0 + shapes.triangles[f, 1], v0 + shapes.triangles[f, 2]
    nx = r * shapes.normals[i0, 0] + s * shapes.normals[i1, 0] + t * shapes.normals[i2, 0]
    ny = r * shapes.normals[i0, 1] + s * shapes.normals[i1, 1] + t * shapes.normals[i2, 1]
    nz = r * shapes.normals[i0, 2] + s * shapes.normals[i1, 2] + t * shapes.normals[i2, 2]
    normal = _turned(m, copy, nx, ny, nz)
    # texture coordinates in metres of {n}, and their steps from one corner to the others
    scale = math.sqrt(m[copy, 0, 0] ** 2 + m[copy, 1, 0] ** 2 + m[copy, 2, 0] ** 2)
    u0, w0 = np.float64(shapes.uv[i0, 0]) * scale, np.float64(shapes.uv[i0, 1]) * scale
    ua, wa = shapes.uv[i1, 0] * scale - u0, shapes.uv[i1, 1] * scale - w0
    ub, wb = shapes.uv[i2, 0] * scale - u0, shapes.uv[i2, 1] * scale - w0
    u, v = u0 + s * ua + t * ub, w0 + s * wa + t * wb
    # their steps to the next column and row, from the rays there
    gx, gy = 1.0 / camera[0], 1.0 / camera[1]
    far_x, sx, tx = _meet(
        a, e1, e2, (d[0] + R_n_c[0, 0] * gx, d[1] + R_n_c[1, 0] * gx, d[2] + R_n_c[2, 0] * gx)
    )
    far_y, sy, ty = _meet(
        a, e1, e2, (d[0] + R_n_c[0, 1] * gy, d[1] + R_n_c[1, 1] * gy, d[2] + R_n_c[2, 1] * gy)
    )
    # a ray past the horizon of the plane meets it behind the camera: blur as far as can be
    ux, vx, uy, vy = 50.0, 0.0, 0.0, 50.0
    if far_x > 0.0:
        ux, vx = (sx - s) * ua + (tx - t) * ub, (sx - s) * wa + (tx - t) * wb
    if far_y > 0.0:
        uy, vy = (sy - s) * ua + (ty - t) * ub, (sy - s) * wa + (ty - t) * wb
    material = shapes.materials[f]
    surface, share = looks.first_surface[material], 0.0
    if looks.surface_count[material] > 1:
        paint = r * shapes.paint[i0] + s * shapes.paint[i1] + t * shapes.paint[i2]
        if looks.fray_tile[material] >= 0:
            frayed = look_up(
                looks.pyramids, looks.level_offsets, looks.fray_tile[material], looks.fray[material, 0],
                u, v, ux, vx, uy, vy,
            )  # fmt: skip
            paint += looks.fray[material, 1] * (2.0 * frayed - 1.0)
        paint = min(max(paint, 0.0), looks.surface_count[material] - 1.0)
        lower = min(int(paint), looks.surface_count[material] - 2)
        surface, share = surface + lower, paint - lower
    value = 0.0
    if share < 1.0:
        value += (1.0 - share) * reflectance(looks, surface, u, v, ux, vx, uy, vy)
    if share > 0.0:
        value += share * reflectance(looks, surface + 1, u, v, ux, vx, uy, vy)
    if share >= 0.5:
        surface += 1
    det = ua * wb - ub * wa
    if looks.relief[surface] > 0.0 and looks.layer_tile[surface, 0] >= 0 and det != 0.0:
        along_u, along_v = slopes(
            looks.pyramids, looks.level_offsets, looks.layer_tile[surface, 0], looks.layers[surface, 0, 0],
            u, v, math.sqrt(max(ux * ux + vx * vx, uy * uy + vy * vy)),
        )  # fmt: skip
        # the gradient of the relief on the surface, from its slopes along u and v
        gu, gv = looks.relief[surface] * along_u / det, looks.relief[surface] * along_v / det
        k1, k2 = gu * wb - gv * ub, gv * ua - gu * wa
        x1 = normal[0] - k1 * e1[0] - k2 * e2[0]
        y1 = normal[1] - k1 * e1[1] - k2 * e2[1]
        z1 = normal[2] - k1 * e1[2] - k2 * e2[2]
        inverse = 1.0 / math.sqrt(x1 * x1 + y1 * y1 + z1 * z1)
        normal = (x1 * inverse, y1 * inverse, z1 * inverse)
    variation = looks.leafy[material, 1]
    if variation > 0.0:
        value *= 1.0 + variation * (2.0 * _random(drawn.identities[copy], material) - 1.0)
    return _lit(
        value, normal, depth, origin[0] + depth * d[0], origin[1] + depth * d[1], origin[2] + depth * d[2],
        looks.leafy[material, 0], 1.0, SOLID_BIAS_M, light, sun, shadows,
    )  # fmt: skip
