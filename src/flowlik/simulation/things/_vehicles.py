"""Cars, vans and lorries: lofted bodies with glass, wheels and lamps, and a contact shadow below.

Vehicles stand on y = 0 and drive towards +z. Of the material called *tyre* the first surface is rubber, the
second light metal, for rims, lamps and plates; of *shadow* the first is the darkness below the vehicle, the
second the road around it.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from flowlik.simulation.render import Mesh, box, lattice, quad, tube
from flowlik.simulation.things._bodies import ESTATE, HATCHBACK, SALOON, VAN, Body
from flowlik.support.arrays import Array

SHADOW_HEIGHT_M = 0.02
RUBBER, METAL = 0.0, 1.0


def car(rng: np.random.Generator, paint: int, glass: int, tyre: int, shadow: int) -> Mesh:
    """Make a hatchback, saloon or estate car of one of several sizes.

    Parameters
    ----------
    rng : Generator
        Draws kind and size.
    paint, glass, tyre, shadow : int
        Materials; see the module's text for their surfaces.
    """
    body = (HATCHBACK, SALOON, ESTATE)[rng.integers(3)]
    return _vehicle(_scaled(body, rng.uniform(0.94, 1.05, 3)), paint, glass, tyre, shadow)


def van(rng: np.random.Generator, paint: int, glass: int, tyre: int, shadow: int) -> Mesh:
    """Make a delivery van; parameters are those of `car`."""
    return _vehicle(_scaled(VAN, rng.uniform(0.92, 1.08, 3)), paint, glass, tyre, shadow)


def lorry(rng: np.random.Generator, paint: int, glass: int, tyre: int, shadow: int) -> Mesh:
    """Make a lorry with a box body, 8 to 10 m long; parameters are those of `car`."""
    length_m, height_m = rng.uniform(5.2, 7.0), rng.uniform(3.2, 3.7)
    cab = box((-1.2, -2.75, 0.0), (1.2, -0.55, 1.9), paint)
    load = box((-1.25, -height_m, -length_m - 0.15), (1.25, -1.05, -0.15), paint)
    frame = _painted(box((-0.6, -1.05, -length_m), (0.6, -0.5, 1.6), tyre), RUBBER)
    screen = _front_face(1.908, 1.1, 1.55, 2.5, 1.0, glass)
    windows = [_side_face(side * 1.2, 0.5, 1.5, 1.6, 2.4, side, glass) for side in (-1.0, 1.0)]
    axles = ((1.0, 0.48), (-length_m + 1.6, 0.48), (-length_m + 0.5, 0.48))
    wheels = [_wheel(side * 1.2, z, radius, side, tyre) for z, radius in axles for side in (-1.0, 1.0)]
    lamps = _lamps(1.908, 0.95, 0.85, 1.0, tyre) + _lamps(-length_m - 0.158, 1.0, 1.25, -1.0, tyre)
    bumper = _painted(box((-1.2, -0.7, 1.7), (1.2, -0.35, 2.0), tyre), RUBBER)
    ground = _shadow(1.25, -length_m - 0.15, 1.95, shadow)
    return Mesh.joined([cab, load, frame, screen, *windows, *wheels, *lamps, bumper, ground])


Maker = Callable[[np.random.Generator, int, int, int, int], Mesh]


def _vehicle(body: Body, paint: int, glass: int, tyre: int, shadow: int) -> Mesh:
    sections = body.sections
    tail, nose = sections[0], sections[-1]
    half = float(sections[:, 1].max())
    wheels = [_wheel(side * half, z, radius, side, tyre) for z, radius in body.wheels for side in (-1.0, 1.0)]
    parts = [
        *_shell(body, paint, glass, tyre),
        *wheels,
        *_lamps(nose[0] + 0.008, nose[1] - 0.17, 0.45, 1.0, tyre),
        *_lamps(tail[0] - 0.008, tail[1] - 0.14, 0.55, -1.0, tyre),
        _painted(_front_face(nose[0] + 0.015, 0.27, 0.3, 0.41, 1.0, tyre), METAL),
        _painted(_front_face(tail[0] - 0.015, 0.27, 0.5, 0.61, -1.0, tyre), METAL),
        _painted(_front_face(nose[0] + 0.01, 0.36, 0.43, 0.52, 1.0, tyre), RUBBER),
        *[_mirror(side, half, sections, paint) for side in (-1.0, 1.0)],
        _shadow(half, tail[0], nose[0], shadow),
    ]
    return Mesh.joined(parts)


def _scaled(body: Body, size: Array) -> Body:
    """Body with length, width and height multiplied by size (3,)."""
    length, width, height = size
    wheels = tuple((z * length, radius) for z, radius in body.wheels)
    return Body(
        body.sections * [length, width, height, height, width], body.side_glass, body.end_glass, wheels
    )


def _shell(body: Body, paint: int, glass: int, tyre: int) -> list[Mesh]:
    """Outer skin over the sections, and the flat ends and bottom."""
    z, half, belt, roof, roof_half = body.sections.T
    sill = np.full_like(z, 0.22)
    # half a ring from the sill over the belt line to the middle of the roof
    x = np.stack([0.93 * half, half, half, 0.97 * half, roof_half, 0.7 * roof_half, 0 * half], axis=1)
    h = np.stack([sill, sill + 0.1, 0.7 * belt, belt, roof - 0.05, roof, roof + 0.02], axis=1)
    ring_x = np.concatenate([-x, x[:, -2::-1]], axis=1)
    ring_h = np.concatenate([h, h[:, -2::-1]], axis=1)
    vertices = np.stack([ring_x, -ring_h, np.broadcast_to(z[:, None], ring_x.shape)], axis=-1)
    cells = np.full((len(z) - 1, ring_x.shape[1] - 1), paint)
    for i in body.side_glass:
        cells[i, [3, 8]] = glass
    for i in body.end_glass:
        cells[i, 4:8] = glass
    cells[:, [0, 11]] = tyre  # dark skirts
    cells[np.ix_([0, 1, -2, -1], [2, 9])] = tyre  # lamps around the corners
    metal = np.full(ring_x.shape, METAL)
    metal[:, [0, 1, 11, 12]] = RUBBER
    steps = np.linalg.norm(np.diff(vertices, axis=1), axis=-1)
    along = np.concatenate([np.zeros((len(z), 1)), np.cumsum(steps, axis=1)], axis=1)
    uv = np.stack([vertices[..., 2], along], axis=-1)
    skin = Mesh.of(
        vertices.reshape(-1, 3),
        _smooth_normals(vertices).reshape(-1, 3),
        uv.reshape(-1, 2),
        lattice(*ring_x.shape),
        np.tile(cells.ravel(), 2),
        metal.ravel(),
    )
    ends = [_cap(vertices[i], sign, paint) for i, sign in ((0, -1.0), (-1, 1.0))]
    bottom = quad(
        [
            (-half[1], -0.22, z[0]),
            (half[1], -0.22, z[0]),
            (half[-2], -0.22, z[-1]),
            (-half[-2], -0.22, z[-1]),
        ],
        tyre,
    )
    return [skin, *ends, bottom]


def _smooth_normals(points: Array) -> Array:
    """Unit normals (S, R, 3) of a lattice of points (S, R, 3), pointing away from the body's middle."""
    along, across = np.gradient(points, axis=0), np.gradient(points, axis=1)
    normals = np.cross(along, across)
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    middle = np.array([0.0, -0.6, 0.0])
    inwards = np.einsum("sri,sri->sr", normals, points - middle) < 0
    return np.where(inwards[..., None], -normals, normals)


def _cap(ring: Array, sign: float, paint: int) -> Mesh:
    """Flat end of the body, a fan around its middle."""
    points = np.concatenate([ring, ring.mean(axis=0, keepdims=True)])
    i = np.arange(len(ring) - 1)
    triangles = np.column_stack([i, i + 1, np.full_like(i, len(ring))])
    closing = np.array([[len(ring) - 1, 0, len(ring)]])
    normals = np.tile([0.0, 0.0, sign], (len(points), 1))
    return Mesh.of(points, normals, points[:, :2], np.concatenate([triangles, closing]), paint)


def _wheel(x: float, z: float, radius: float, side: float, tyre: int) -> Mesh:
    """Arch, tyre and rim on one side of the body."""
    inner, outer = x - 0.2 * side, x + 0.02 * side
    tread = tube([(inner, -radius, z), (outer, -radius, z)], [radius, radius], 14, tyre)
    arch = _disc(x + 0.008 * side, radius + 0.06, z, radius + 0.06, side, tyre, RUBBER)
    wall = _disc(outer, radius, z, radius, side, tyre, RUBBER)
    rim = _disc(outer + 0.006 * side, radius, z, 0.66 * radius, side, tyre, METAL, holes=True)
    return Mesh.joined([tread, arch, wall, rim])


def _disc(
    x: float,
    height: float,
    z: float,
    radius: float,
    side: float,
    material: int,
    paint: float,
    holes: bool = False,
) -> Mesh:
    """Round face across x; with holes, every third sector is left out."""
    angles = np.linspace(0, 2 * np.pi, 16)
    rim = np.column_stack([np.full(16, x), radius * np.sin(angles) - height, z + radius * np.cos(angles)])
    points = np.concatenate([rim, [[x, -height, z]]])
    i = np.arange(15)
    i = i[i % 3 > 0] if holes else i
    triangles = np.column_stack([i, i + 1, np.full_like(i, 16)])
    return Mesh.of(points, np.tile([side, 0.0, 0.0], (17, 1)), points[:, 1:], triangles, material, paint)


def _lamps(z: float, x: float, height: float, sign: float, tyre: int) -> list[Mesh]:
    """Two lamps on an end of the body."""
    return [
        _painted(_front_face(z, 0.15, height - 0.06, height + 0.06, sign, tyre, side * x), METAL)
        for side in (-1.0, 1.0)
    ]


def _mirror(side: float, half: float, sections: Array, paint: int) -> Mesh:
    height, z = 1.08 * float(sections[-4, 2]), float(sections[-4, 0]) - 0.35
    near, far = sorted((side * (half - 0.06), side * (half + 0.16)))
    return box((near, -height - 0.12, z), (far, -height, z + 0.09), paint)


def _front_face(
    z: float, half: float, low: float, high: float, sign: float, material: int, x: float = 0.0
) -> Mesh:
    left, right = x - half, x + half
    corners = np.array([(left, -low, z), (right, -low, z), (right, -high, z), (left, -high, z)])
    uv = np.column_stack([corners[:, 0], -corners[:, 1]])
    return Mesh.of(corners, np.tile([0.0, 0.0, sign], (4, 1)), uv, _TWO, material)


def _side_face(
    x: float, back: float, front: float, low: float, high: float, side: float, material: int
) -> Mesh:
    x += 0.006 * side
    corners = np.array([(x, -low, back), (x, -low, front), (x, -high, front), (x, -high, back)])
    uv = np.column_stack([corners[:, 2], -corners[:, 1]])
    return Mesh.of(corners, np.tile([side, 0.0, 0.0], (4, 1)), uv, _TWO, material)


_TWO: NDArray[np.int64] = np.array([[0, 1, 2], [0, 2, 3]])


def _painted(mesh: Mesh, paint: float) -> Mesh:
    return Mesh.of(mesh.vertices, mesh.normals, mesh.uv, mesh.triangles, mesh.materials, paint)


def _shadow(half: float, back: float, front: float, shadow: int, soft_m: float = 0.3) -> Mesh:
    """Face just above the ground, dark under the body and fading outside it."""
    xs = np.array([-half - soft_m / 2, 0.1 - half, half - 0.1, half + soft_m / 2])
    zs = np.array([back - soft_m / 2, back + 0.15, front - 0.15, front + soft_m / 2])
    x, z = np.meshgrid(xs, zs)
    # the corners are cut, so that the outline is round
    corner = np.isin(x, xs[[0, 3]]) & np.isin(z, zs[[0, 3]])
    x, z = np.where(corner, 0.93 * x, x), np.where(corner, z - 0.1 * np.sign(z), z)
    edge = np.ones((4, 4))
    edge[1:3, 1:3] = 0.0
    vertices = np.stack([x, np.full_like(x, -SHADOW_HEIGHT_M), z], axis=-1).reshape(-1, 3)
    return Mesh.of(
        vertices, np.tile([0.0, -1.0, 0.0], (16, 1)), vertices[:, [0, 2]], lattice(4, 4), shadow, edge.ravel()
    )
