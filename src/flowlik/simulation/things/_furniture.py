"""What stands beside roads: lamps, signs, posts, guard rails; the foot at the origin, 0.3 m in the ground."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from flowlik.simulation.render import Mesh, box, quad, tube

FOOT_M = 0.3
POSTER_M = 0.25
"""Part of the tile of posters, in units of its period, that a sign shows."""


def _pole(height_m: float, radius_m: float, metal: int) -> Mesh:
    """Make a round post with a closed top."""
    points = [(0, FOOT_M, 0), (0, -height_m, 0), (0, -height_m - 0.01, 0)]
    return tube(points, [radius_m, 0.8 * radius_m, 0.001], 8, metal)


def street_lamp(metal: int, lamp: int, height_m: float = 6.0) -> Mesh:
    """Make a lamp post whose arm reaches 1.2 m towards -z."""
    reach = 1.2
    arm = tube(
        [(0, -height_m, 0), (0, -height_m - 0.35, -0.4), (0, -height_m - 0.4, -reach)],
        [0.05, 0.04, 0.035],
        6,
        metal,
    )
    head = box((-0.14, -height_m - 0.5, -reach - 0.55), (0.14, -height_m - 0.36, -reach), lamp)
    return Mesh.joined([_pole(height_m, 0.08, metal), arm, head])


def traffic_sign(rng: np.random.Generator, face: int, metal: int, period_m: float) -> Mesh:
    """Make a sign facing -z on a post 2.3 m high: round, three-cornered or square.

    Parameters
    ----------
    rng : Generator
        Draws shape and picture.
    face : int
        Material whose first layer is the tile of posters.
    metal : int
        Material of post and back.
    period_m : float
        Period of the posters' tile [m].
    """
    corners = int(rng.choice([3, 4, 20]))
    radius = {3: 0.5, 4: 0.42, 20: 0.32}[corners]
    turn = 2 * np.pi * (np.arange(corners) + (0.5 if corners == 4 else 0.0)) / corners
    outline = np.column_stack([radius * np.sin(turn), -2.0 - radius * np.cos(turn)])
    picture = (rng.integers(0, 4, 2) + 0.5) * POSTER_M * period_m
    plates = [
        _plate(
            outline,
            -0.06,
            -1.0,
            face,
            picture + (outline - [0, -2.0]) * [0.9 * POSTER_M * period_m / 0.9, -1],
        ),
        _plate(outline, -0.05, 1.0, metal, outline),
    ]
    return Mesh.joined([_pole(2.3, 0.035, metal), *plates])


def billboard(rng: np.random.Generator, face: int, metal: int, period_m: float) -> Mesh:
    """Make a board of 2.4 by 1.6 m facing -z on two posts; parameters are those of `traffic_sign`."""
    size = POSTER_M * period_m
    picture = rng.integers(0, 4, 2) * size
    board = box((-1.2, -2.6, -0.06), (1.2, -1.0, 0.0), metal)
    front = quad(
        [(-1.15, -1.05, -0.07), (1.15, -1.05, -0.07), (1.15, -2.55, -0.07), (-1.15, -2.55, -0.07)], face
    )
    uv = picture + np.array([(0.0, 0.0), (1, 0), (1, 1), (0, 1)]) * size
    shown = Mesh.of(front.vertices, front.normals, uv, front.triangles, face)
    posts = [box((x - 0.05, -2.6, 0.0), (x + 0.05, FOOT_M, 0.1), metal) for x in (-0.9, 0.9)]
    return Mesh.joined([board, shown, *posts])


def bollard(light: int, dark: int) -> Mesh:
    """Make a delineator post of 1 m with a slanting dark band."""
    post = box((-0.06, -1.0, -0.06), (0.06, FOOT_M, 0.06), light)
    band = box((-0.065, -0.85, -0.065), (0.065, -0.65, 0.065), dark)
    return Mesh.joined([post, band])


def guard_rail(length_m: float, metal: int) -> Mesh:
    """Make a steel rail along z, its folded profile facing -x, 0.75 m high, on posts 2 m apart."""
    z = length_m / 2
    profile = np.array(
        [(0, 0.75), (-0.08, 0.70), (-0.08, 0.66), (-0.02, 0.60), (-0.08, 0.53), (-0.08, 0.49), (0, 0.44)]
    )
    faces = []
    for (x0, h0), (x1, h1) in pairwise(profile):
        face = quad([(x0, -h0, -z), (x0, -h0, z), (x1, -h1, z), (x1, -h1, -z)], metal)
        faces.append(face)
    posts = [
        box((0.0, -0.7, place - 0.05), (0.1, FOOT_M, place + 0.05), metal)
        for place in np.arange(-z + 1.0, z, 2.0)
    ]
    return Mesh.joined([*faces, *posts])


def gantry(width_m: float, face: int, metal: int, period_m: float) -> Mesh:
    """Make a sign bridge along x, 6 m above the road, with two boards facing -z.

    The other parameters are those of `traffic_sign`.
    """
    x, size = width_m / 2, POSTER_M * period_m
    legs = [box((s * x - 0.2, -7.2, -0.2), (s * x + 0.2, 1.0, 0.2), metal) for s in (-1.0, 1.0)]
    beam = box((-x, -7.2, -0.25), (x, -6.6, 0.25), metal)
    boards = []
    for i, centre in enumerate((-0.22 * width_m, 0.2 * width_m)):
        corners = [
            (centre - 2, -5.7, -0.35),
            (centre + 2, -5.7, -0.35),
            (centre + 2, -8.1, -0.35),
            (centre - 2, -8.1, -0.35),
        ]
        front = quad(corners, face)
        uv = np.array([(i, 0.0), (i + 1, 0), (i + 1, 1), (i, 1)]) * size
        boards += [
            Mesh.of(front.vertices, front.normals, uv, front.triangles, face),
            box((centre - 2.05, -8.15, -0.33), (centre + 2.05, -5.65, -0.25), metal),
        ]
    return Mesh.joined([*legs, beam, *boards])


def _plate(outline: np.ndarray, z: float, sign: float, material: int, uv: np.ndarray) -> Mesh:
    """Flat convex face across z."""
    i = np.arange(1, len(outline) - 1)
    vertices = np.column_stack([outline, np.full(len(outline), z)])
    triangles = np.column_stack([np.zeros_like(i), i, i + 1])
    return Mesh.of(vertices, np.tile([0.0, 0.0, sign], (len(outline), 1)), uv, triangles, material)
