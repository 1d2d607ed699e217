"""Houses and street fronts.

Everything stands with its foot at the origin, its front towards -z, and reaches 1 m into the ground. The
material called *window* shows panes with its first surface and frames with its second.
"""

from __future__ import annotations

import numpy as np

from flowlik.simulation.render import Mesh, box, quad
from flowlik.simulation.things._vectors import UP
from flowlik.simulation.things._walls import UNDERGROUND_M, Plane, door, openings, pierced_wall, sides

STOREY_M = 2.8


def house(
    rng: np.random.Generator,
    wall: int,
    roof: int,
    window: int,
    width_m: float,
    depth_m: float,
    storeys: int,
) -> Mesh:
    """Make a house with a pitched roof, eaves, windows, a door and a chimney.

    Parameters
    ----------
    rng : Generator
        Draws pitch, windows and chimney.
    wall, roof, window : int
        Materials.
    width_m, depth_m : float
        Size along x (the front) and z [m].
    storeys : int
        Storeys below the eaves.
    """
    eaves_m = storeys * STOREY_M + rng.uniform(0.3, 0.9)
    rows = [(storey * STOREY_M + 1.15, storey * STOREY_M + 2.5) for storey in range(storeys)]
    pane_m = rng.uniform(0.95, 1.4)
    planes = sides(width_m, depth_m)
    parts = []
    for i, (plane, length_m) in enumerate(zip(planes, [width_m, depth_m] * 2)):
        bays = max(1, int(length_m / rng.uniform(2.4, 3.4)))
        parts.append(
            pierced_wall(plane, length_m, eaves_m, openings(length_m, bays, pane_m), rows, wall, window)
        )
        if i == 0 and bays > 1:  # between the first two windows
            parts.append(door(plane, length_m * 1.0 / bays, window))
    parts += _gable_roof(width_m, depth_m, eaves_m, rng.uniform(0.55, 1.0), wall, roof)
    x, z = width_m * rng.uniform(-0.3, 0.3), depth_m * rng.uniform(0.05, 0.2)
    top_m = eaves_m + 0.5 * depth_m + 0.4
    parts.append(box((x - 0.35, -top_m, z - 0.25), (x + 0.35, -eaves_m, z + 0.25), wall))
    return Mesh.joined(parts)


def facade_block(
    rng: np.random.Generator, facade: int, trim: int, roof: int, width_m: float, depth_m: float, storeys: int
) -> Mesh:
    """Make a piece of a street front: a textured facade of 3 m a storey, a cornice, bays or balconies.

    Parameters
    ----------
    rng : Generator
        Draws what stands out of the front.
    facade : int
        Material whose first layer is a facade of two storeys by two windows in 6 m.
    trim, roof : int
        Materials of cornice and balconies, and of the roof.
    width_m, depth_m : float
        Size along x (the front) and z [m]; the width a multiple of 3 m, so that no window is cut.
    storeys : int
        Storeys of 3 m.
    """
    height_m = 3.0 * storeys
    x, z = width_m / 2, depth_m / 2
    heights = [-UNDERGROUND_M, height_m]
    parts = [
        plane.cells([0.0, length_m], heights, facade)
        for plane, length_m in zip(sides(width_m, depth_m), [width_m, depth_m] * 2)
    ]
    parts.append(box((-x - 0.35, -height_m - 0.3, -z - 0.35), (x + 0.35, -height_m, z + 0.35), trim))
    parts += _gable_roof(width_m, depth_m, height_m + 0.3, rng.uniform(0.5, 0.9), trim, roof)
    bays = np.arange(int(width_m // 3))
    for bay in rng.permutation(bays)[: rng.integers(1, max(2, len(bays) // 2 + 1))]:
        low, high = -x + 3.0 * bay + 0.3, -x + 3.0 * bay + 2.7
        parts += _bay(low, high, -z, height_m, facade, trim) if rng.random() < 0.4 else []
        parts += [_balcony(low, high, -z, 3.0 * s, trim) for s in range(1, storeys) if rng.random() < 0.7]
    return Mesh.joined(parts)


def _gable_roof(
    width_m: float, depth_m: float, eaves_m: float, pitch: float, wall: int, roof: int
) -> list[Mesh]:
    """Two slopes with eaves 0.4 m beyond the walls, 12 cm thick, the ridge along x; and the gables."""
    x, z, over = width_m / 2, depth_m / 2, 0.4
    ridge_m = eaves_m + pitch * z
    parts = []
    for sign in (-1.0, 1.0):
        out = sign * (z + over)
        low_m = eaves_m - pitch * over
        slope = np.array(
            [
                (-x - over, -low_m, out),
                (x + over, -low_m, out),
                (x + over, -ridge_m, 0),
                (-x - over, -ridge_m, 0),
            ]
        )
        top = slope - [0, 0.12, 0]
        across = np.array([1.0 if sign < 0 else -1.0, 0, 0])
        rise = np.array([0, low_m - ridge_m, -out])
        length = float(np.linalg.norm(rise))
        corner = top[0] if sign < 0 else top[1]
        parts.append(Plane(corner, across, rise / length).cells([0, width_m + 2 * over], [0, length], roof))
        parts += [quad(slope, wall), quad([slope[0], slope[1], top[1], top[0]], wall)]
        for end in ((0, 3), (1, 2)):
            parts.append(quad([slope[end[0]], slope[end[1]], top[end[1]], top[end[0]]], wall))
    for sign in (-1.0, 1.0):
        corners = np.array([(sign * x, -eaves_m, -z), (sign * x, -eaves_m, z), (sign * x, -ridge_m, 0)])
        uv = np.column_stack([corners[:, 2] + z, -corners[:, 1]])
        parts.append(Mesh.of(corners, np.tile([sign, 0.0, 0.0], (3, 1)), uv, np.array([[0, 1, 2]]), wall))
    return parts


def _bay(low: float, high: float, front: float, height_m: float, facade: int, trim: int) -> list[Mesh]:
    """Oriel before the front from the first floor up, 0.8 m deep."""
    plane = Plane(np.array([low, 0.0, front - 0.8]), np.array([1.0, 0, 0]), UP)
    # the facade's windows stand in the middle of 3 m, as here
    shift = np.array([0.3, 0.0], np.float32)
    face = plane.cells([0.0, high - low], [3.0, height_m - 0.6], facade)
    shown = Mesh(face.vertices, face.normals, face.uv + shift, face.triangles, face.materials, face.paint)
    body = box((low, 0.6 - height_m, front - 0.79), (high, -3.0, front), trim)
    cap = box((low - 0.1, 0.5 - height_m, front - 0.9), (high + 0.1, 0.6 - height_m, front), trim)
    return [shown, body, cap]


def _balcony(low: float, high: float, front: float, floor_m: float, trim: int) -> Mesh:
    slab = box((low, -floor_m - 0.0, front - 1.2), (high, -floor_m + 0.16, front), trim)
    rail = box((low, -floor_m - 1.0, front - 1.2), (high, -floor_m - 0.94, front - 1.14), trim)
    bars = [
        box((u, -floor_m - 0.95, front - 1.19), (u + 0.04, -floor_m, front - 1.16), trim)
        for u in np.arange(low, high - 0.03, 0.2)
    ]
    return Mesh.joined([slab, rail, *bars])
