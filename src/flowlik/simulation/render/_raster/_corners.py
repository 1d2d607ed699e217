"""Compiled: corners of a copy's triangles, in its prototype's axes and in space."""

# mypy: disable-error-code=no-untyped-def

import numpy as np

from flowlik.simulation.render._compile import inlined, kernel
from flowlik.simulation.render._raster.packed import OUTLINE

STEP = OUTLINE + 2
"""Numbers that a leaf's triangles take: its outline's, and two of its rhombus."""


@inlined
def _leaf_corner(shapes, p, leaf, scale, part, corner):
    """Corner (3,) of a leaf's triangle in its prototype's axes; parts from OUTLINE on make the rhombus."""
    shape = shapes.outlines[p]
    if part < OUTLINE:
        vertex = shapes.outline_vertices[shape, shapes.outline_triangles[shape, part, corner]]
        s, t, h = 1.0 * vertex[0], 1.0 * vertex[1], 1.0 * vertex[2]
    else:
        size = scale * shapes.outline_rhombus[shape]
        # stem, one side, tip, other side: two triangles that share the midrib
        t, h = 0.0, 0.0
        s = -size if corner == 0 else size if corner == 1 else 0.0
        if corner == 2:
            t = size if part == OUTLINE else -size
    a, b = shapes.leaf_along[leaf], shapes.leaf_across[leaf]
    centre = shapes.leaf_centres[leaf]
    a0, a1, a2 = np.float64(a[0]), np.float64(a[1]), np.float64(a[2])
    b0, b1, b2 = np.float64(b[0]), np.float64(b[1]), np.float64(b[2])
    # h is in units of the half length, along the leaf's geometric normal
    n0, n1, n2 = a1 * b2 - a2 * b1, a2 * b0 - a0 * b2, a0 * b1 - a1 * b0
    h /= np.sqrt(b0 * b0 + b1 * b1 + b2 * b2)
    return (
        centre[0] + s * a0 + t * b0 + h * n0,
        centre[1] + s * a1 + t * b1 + h * n1,
        centre[2] + s * a2 + t * b2 + h * n2,
    )


@inlined
def _corner_of(shapes, drawn, copy, part, corner):
    """Corner of one triangle of one copy in its prototype's axes.

    Parts below the mesh's number of triangles are these; the others count the leaves' triangles.
    """
    p = drawn.prototypes[copy]
    mesh = shapes.triangle_starts[p + 1] - shapes.triangle_starts[p]
    if part < mesh:
        v = shapes.vertices[
            shapes.vertex_starts[p] + shapes.triangles[shapes.triangle_starts[p] + part, corner]
        ]
        return np.float64(v[0]), np.float64(v[1]), np.float64(v[2])
    leaf = shapes.leaf_starts[p] + (part - mesh) // STEP
    return _leaf_corner(shapes, p, leaf, drawn.leaf_scale[copy], (part - mesh) % STEP, corner)


@inlined
def corner_in_space(shapes, drawn, copy, part, corner, origin):
    """Corner of one triangle in {n}, relative to an origin (3,) [m]."""
    a, b, c = _corner_of(shapes, drawn, copy, part, corner)
    m = drawn.transforms[copy]
    return (
        m[0, 0] * a + m[0, 1] * b + m[0, 2] * c + (m[0, 3] - origin[0]),
        m[1, 0] * a + m[1, 1] * b + m[1, 2] * c + (m[1, 3] - origin[1]),
        m[2, 0] * a + m[2, 1] * b + m[2, 2] * c + (m[2, 3] - origin[2]),
    )


@kernel
def corners_in_space(shapes, drawn, origin, corners):
    """Write the corners (F, 3, 3) [m] of all triangles drawn, copy by copy, in {n} relative to an origin."""
    count = 0
    for copy in range(len(drawn.prototypes)):
        p = drawn.prototypes[copy]
        mesh = shapes.triangle_starts[p + 1] - shapes.triangle_starts[p]
        for part in range(mesh + drawn.leaves[copy] * STEP):
            if part < mesh:
                if part >= drawn.parts[copy]:
                    continue
            else:
                leaf, side = (part - mesh) // STEP, (part - mesh) % STEP
                is_fine = leaf < drawn.fine[copy]
                if is_fine and side >= shapes.outline_sizes[shapes.outlines[p], 1]:
                    continue
                if not is_fine and side < OUTLINE:
                    continue
            for corner in range(3):
                x, y, z = corner_in_space(shapes, drawn, copy, part, corner, origin)
                corners[count, corner, 0], corners[count, corner, 1], corners[count, corner, 2] = x, y, z
            count += 1
